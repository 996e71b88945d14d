"""Nouns of instructions, and what is left undecided."""

from __future__ import annotations

import pytest
from tests.generation.better_release.writing import APPLE, BOX, LEMON, ORANGE, lunch, thing, write_task

from betterbench.generation.better_release.files import ReleaseInstance
from betterbench.generation.better_release.sentence import Lexicon, color_of, nouns_of

# by instruction: the nouns with their objects; "*" for all of them, ">" for a target
READ = {
    "Put the apple and the orange into the box.": ["apple apple_1", "orange orange_1", "box > box_1"],
    "Pack the fruits into the takeaway box.": ["fruit * apple_1 orange_1 lemon_1", "takeaway box > box_1"],
    "Put all lemons in the box, then pick up the can.": ["lemon * lemon_1", "box > box_1", "can can_1"],
    "Place an apple next to the lemon.": ["apple apple_1", "lemon > lemon_1"],
    "Move the orange block.": ["block block_1"],
    "Move the shiny red block onto the box.": ["block block_1", "box > box_1"],
    "Take the banana.": ["banana"],
}


@pytest.fixture
def lexicon(tmp_path, reading):
    return Lexicon(reading(write_task(tmp_path, lunch())))


@pytest.mark.parametrize("text", READ)
def test_nouns_are_found_with_their_objects(lexicon, text):
    sentence = lexicon.parse(text)
    shown = [
        " ".join([n.text, *("*" for _ in "x" if n.every), *(">" for _ in "x" if n.is_target), *n.objects])
        for n in sentence.nouns
    ]
    assert shown == READ[text]
    assert sentence.undecided == ()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("Put everything except the lemon into the box.", "the word 'except' may change the meaning"),
        ("Do not touch the can.", "the word 'not' may change the meaning"),
        ("Put the gizmo into the box.", "the word 'gizmo' is not a known noun"),
        ("Juggle the apple.", "the verb 'juggle' is not known"),
        ("Go on.", "no known noun"),
    ],
)
def test_what_is_not_known_is_undecided(lexicon, text, reason):
    assert any(reason in said for said in lexicon.parse(text).undecided), lexicon.parse(text)


def test_colors_choose_between_objects_of_one_noun(tmp_path, reading):
    files = lunch()
    blue = thing("block_2", "block", "blue block")
    files["object_universe.yaml"]["fail_objects"].append(blue)
    lexicon = Lexicon(reading(write_task(tmp_path, files)))
    assert [n.objects for n in lexicon.parse("Move the blue block.").nouns] == [("block_2",)]
    assert [n.objects for n in lexicon.parse("Move the block.").nouns] == [("block_1", "block_2")]
    assert lexicon.noun("block_2") == "block"


def test_an_object_without_a_semantic_name_has_the_nouns_of_its_texts():
    lunchbox = ReleaseInstance("c", description="A blue box with a lid.", retrieval_query="open lunchbox")
    assert nouns_of(lunchbox)[:2] == (("lunchbox",), ("box",))
    assert color_of(lunchbox) == "blue"
    assert color_of(ReleaseInstance("o", semantic_name="orange", retrieval_query="orange fruit")) is None
    assert nouns_of(ReleaseInstance("x_7")) == (("x", "7"),)


def test_every_object_of_the_task_has_a_noun(lexicon):
    assert [lexicon.noun(name) for name in (BOX, APPLE, ORANGE, LEMON)] == ["takeaway box", "apple", "orange", "lemon"]
