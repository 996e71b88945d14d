"""The extractor copies and never answers."""

from __future__ import annotations

import json

from tests.looping import each

from betterbench.vqa.coordinates import CONVENTIONS
from betterbench.vqa.parsing import AnswerSpec
from betterbench.vqa.parsing.extractor import extraction_prompt, read_extraction
from betterbench.vqa.question import Form

CHOICE = AnswerSpec(Form.CHOICE, ("red mug", "apple", "left plate", "cabinet"))
POINTS = AnswerSpec(Form.POINTS, (), 640, 480, CONVENTIONS["thousandths-yx-json"])
LONG = "Both A and C look near. On reflection the closest object must be the third, C, not A."


def copied(*parts):
    return json.dumps({"copied": parts})


@each(
    "spec, text, reply, answer",
    [
        (CHOICE, LONG, copied("C"), "C"),
        (CHOICE, LONG, f"```json\n{copied('C')}\n```", "C"),
        (CHOICE, LONG, copied("B"), None),  # made up
        (CHOICE, LONG, "C", None),  # not in the requested form
        (CHOICE, LONG, copied(), None),
        (CHOICE, "CABINETS are there", copied("C"), None),  # a letter inside a word
        (POINTS, "y = 250 and then x = 500 for the cup", copied("250", "500"), "[[320, 120]]"),
        (POINTS, "y = 250 and then x = 500 for the cup", copied("500", "250"), "[[160, 240]]"),  # never swapped here
        (POINTS, "y = 250 and then x = 500 for the cup", copied("0.25", "0.5"), None),  # scaled
        (POINTS, "y = 2501 and then x = 500", copied("250", "500"), None),  # part of a number
        (POINTS, "1 at 2.5, 3 at 4.5", copied("2.5"), None),
    ],
)
def test_only_parts_of_the_text_count(spec, text, reply, answer):
    read = read_extraction(spec, text, reply)
    assert (read.answer, read.stage) == (answer, "none" if answer is None else "extractor")


def test_the_extractor_sees_options_and_text_and_nothing_else():
    prompt = extraction_prompt(CHOICE, f"<think>secret plan</think>{LONG}")
    assert LONG in prompt
    assert "C. left plate" in prompt
    assert "secret plan" not in prompt
    assert len(extraction_prompt(CHOICE, "x" * 1_000_000)) < 10_000
