"""The blind test of looks: which answers count, and that no object of a scene is left out."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from legibility_sheet import ACCEPTED, REFUSED, _places, is_right


@pytest.mark.parametrize(
    ("answer", "category", "color", "right"),
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
    ],
)
def test_an_answer_counts_if_it_names_the_object_and_no_other_color(answer, category, color, right):
    assert is_right(answer, category, color) is right


def test_every_category_of_a_scene_has_words():
    shown = set(_places())
    assert shown == set(ACCEPTED)
    assert set(REFUSED) <= shown
