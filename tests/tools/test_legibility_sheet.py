"""The blind test of looks: which answers count, and that no object of a scene is left out."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.looping import each

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from legibility_sheet import ACCEPTED, REFUSED, _places, is_right


@each(
    "answer, category, color, right",
    [
        ("red mug", "mug", "red", True),
        ("a coffee cup", "mug", "red", True),
        ("blue mug", "mug", "red", False),
        ("plate", "shallow_bowl", "red", False),
        ("bowl", "dinner_plate", "blue", False),
        ("soda can", "crushed_can", "red", False),
        ("crushed soda can", "crushed_can", "red", True),
        ("crushed can", "can", "red", False),
        ("red stapler", "stapler_block", "red", False),
        ("flower pot", "waste_bin", "black", False),
        ("Lettuce leaf", "lettuce_leaf", "green", True),
        ("lime", "lettuce_leaf", "green", False),
        ("", "fork", "silver", False),
        ("blue glass", "tumbler", "blue", True),
        ("blue cup", "tumbler", "blue", False),
        ("wooden block with a K", "round_block", "brown", True),
        ("round wooden box", "round_block", "brown", False),
        ("stack of cookies", "round_block", "brown", False),
        ("gray computer mouse", "computer_mouse", "black", False),
        ("white keyboard", "keyboard", "black", False),
        ("gray fork", "fork", "silver", True),
        ("jam jar, white lid", "jam_jar", "red", True),
        ("white jam jar", "jam_jar", "red", False),
        ("blue and white drink cup", "drink_cup", "blue", True),
        ("pepper shaker", "spice_jar", "white", False),
        ("red chili pepper jar", "spice_jar", "red", True),
        ("black pepper jar", "spice_jar", "red", False),
        ("salt shaker", "pill_bottle", "white", False),
        ("top of a bun", "bun_bottom", "brown", False),
        ("orange", "orange", "orange", True),
        ("medicine bottle", "spice_jar", "white", False),
        ("crumpled can", "crumpled_napkin", "white", False),
        ("burger bun", "burger", "brown", False),
        ("soda can", "drink_cup", "blue", False),
        ("trash can", "can", "red", False),
        ("trash can", "waste_bin", "black", True),
        ("soda can", "waste_bin", "black", False),
        ("computer mouse", "laptop", "silver", False),
        ("coffee mug", "coffee_machine", "black", False),
        ("mug, blue", "mug", "red", False),
        ("teal mug", "mug", "red", False),
        ("navy mug", "mug", "blue", True),
        ("brown egg in white cup", "egg_cup", "white", True),
        ("brown cup with an egg", "egg_cup", "white", False),
        ("gray salt shaker", "plain_salt_jar", "gray", True),
        ("gray salt shaker", "salt_shaker", "white", False),
        ("red jar of salt", "plain_salt_jar", "gray", False),
    ],
)
def test_an_answer_counts_if_it_names_the_object_and_no_other_color(answer, category, color, right):
    assert is_right(answer, category, color) is right


def test_every_category_of_a_scene_has_words():
    shown = set(_places())
    assert shown == set(ACCEPTED)
    assert {key.split()[0] for key in REFUSED} <= shown
