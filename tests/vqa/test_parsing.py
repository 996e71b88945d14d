"""Reading of hostile answers: every stage, form and convention, as the documentation says."""

from __future__ import annotations

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.looping import each

from betterbench.vqa.coordinates import CONVENTIONS, convention
from betterbench.vqa.parsing import AnswerSpec, final_text, read_text
from betterbench.vqa.parsing.points import exact_groups, numbers_of
from betterbench.vqa.question import Form

CHOICE = AnswerSpec(Form.CHOICE, ("red mug", "apple", "the left plate", "cabinet"))
YES_NO, NUMBER = AnswerSpec(Form.YES_NO), AnswerSpec(Form.NUMBER)


def points(name, form=Form.POINTS):
    return AnswerSpec(form, (), 640, 480, CONVENTIONS[name])


FRACTIONS, PIXELS = points("fractions"), points("pixels")
GEMINI, QWEN, MOLMO = points("thousandths-yx-json"), points("thousandths-json"), points("percent-xml")
BOX = points("pixels", Form.BOX)
MEGABYTE = "Let me look at the picture again. (A cup?) " * 25_000

HOSTILE = [
    # empty, refusals, and answers that do not answer
    (CHOICE, "", None, "none"),
    (CHOICE, " \n\t ", None, "none"),
    (CHOICE, "I'm sorry, but I can't help with that.", None, "none"),
    (CHOICE, "As a model, I cannot see images.", None, "none"),
    (YES_NO, "No idea.", None, "none"),
    (YES_NO, "I'm not sure, yes or no.", None, "none"),
    (NUMBER, "There is no way to tell.", None, "none"),
    (FRACTIONS, "I cannot locate the object.", None, "none"),
    # letters in prose
    (CHOICE, "Based on the video, the answer is C", "C", "tolerant"),
    (CHOICE, "Considering the progress, D", "D", "tolerant"),
    (CHOICE, "A person should pick C", "C", "tolerant"),
    (CHOICE, "Answer: D", "D", "tolerant"),
    (CHOICE, "The answer is A because it is nearer.", "A", "tolerant"),
    (CHOICE, "b", "B", "tolerant"),
    (CHOICE, "cabinet", "D", "strict"),
    (CHOICE, "A dog and a cat", None, "none"),
    (CHOICE, "**B**", "B", "tolerant"),
    (CHOICE, "B. apple", "B", "strict"),
    (CHOICE, "B. red mug", None, "none"),
    # denials
    (CHOICE, "The answer is not A.", None, "none"),
    (CHOICE, "I am sure it isn't B.", None, "none"),
    (CHOICE, "It is not (A).", None, "none"),
    (CHOICE, "Option A is incorrect.", None, "none"),
    (CHOICE, "It is not A. It is B.", "B", "tolerant"),
    (CHOICE, "The answer cannot be A; it must be D.", "D", "tolerant"),
    (CHOICE, "The answer is B. Option C is wrong.", "B", "tolerant"),
    (CHOICE, "It is not the apple.", None, "none"),
    (CHOICE, "The apple is not the nearest object.", None, "none"),
    (CHOICE, "The red mug, not the apple.", "A", "tolerant"),
    (CHOICE, "I'm not sure. B", "B", "tolerant"),
    (YES_NO, "That is not true.", "No", "tolerant"),
    (YES_NO, "Not true.", "No", "tolerant"),
    (YES_NO, "This isn't false.", "Yes", "tolerant"),
    (YES_NO, "The answer is not yes.", None, "none"),
    (NUMBER, "There are not 3 mugs.", None, "none"),
    (NUMBER, "There are not three but four mugs.", "4", "tolerant"),
    # several answers
    (CHOICE, "A or C", None, "none"),
    (CHOICE, "The answer is A or B.", None, "none"),
    (CHOICE, "The answer is A. Wait, no: the answer is C.", "C", "tolerant"),
    (NUMBER, "2 or 3", None, "none"),
    (NUMBER, "I see 2 mugs and 3 plates. The answer is 5.", "5", "tolerant"),
    # thinking tags
    (CHOICE, "<think>It may be A, or maybe B.</think>\nC", "C", "strict"),
    (CHOICE, "<think>It may be A, so the answer is A", None, "none"),
    (CHOICE, "It may be A.</think> (D)", "D", "strict"),
    (YES_NO, "<thinking>no, no</thinking> Yes", "Yes", "strict"),
    (CHOICE, "B <think>or A?</think>", "B", "strict"),
    (CHOICE, "<think>A</think> B <think>or C", "B", "strict"),
    # non-English
    (CHOICE, "答案是 C", "C", "tolerant"),
    (CHOICE, "La respuesta es B.", "B", "tolerant"),
    (CHOICE, "Die Antwort ist: D", "D", "tolerant"),
    (CHOICE, "Ｃ", "C", "strict"),
    (YES_NO, "Да", "Yes", "strict"),
    # JSON, right and wrong
    (CHOICE, '{"answer": "B"}', "B", "tolerant"),
    (CHOICE, '{"answer": ', None, "none"),
    (CHOICE, "\\boxed{C}", "C", "tolerant"),
    # one megabyte
    (CHOICE, MEGABYTE, None, "none"),
    (CHOICE, MEGABYTE + "The answer is B.", "B", "tolerant"),
    # coordinates in every convention
    (FRACTIONS, "[(0.5, 0.25)]", "[[320, 120]]", "strict"),
    (FRACTIONS, "[( 0.5, 0.25 )]", "[[320, 120]]", "strict"),
    (FRACTIONS, "[(.5, .25)]", "[[320, 120]]", "strict"),
    (FRACTIONS, "[[0.5, 0.25]]", "[[320, 120]]", "strict"),
    (FRACTIONS, "(1, 0)", "[[640, 0]]", "strict"),
    (FRACTIONS, "[(0.5, 1), (0.1, 0.2)]", "[[320, 480], [64, 96]]", "strict"),
    (FRACTIONS, "At first (0.1, 0.1). The answer is [(0.5, 0.5)].", "[[320, 240]]", "tolerant"),
    (FRACTIONS, "(0.25, 0.25, 0.5, 0.5)", "[[160, 120, 320, 240]]", "strict"),
    (PIXELS, "(320.5, 120)", "[[320.5, 120]]", "strict"),
    (PIXELS, "x: 320, y: 120", "[[320, 120]]", "tolerant"),
    (GEMINI, '```json\n[{"point": [250, 500], "label": "cup"}]\n```', "[[320, 120]]", "strict"),
    (GEMINI, '[{"point": [250, 500]}]', "[[320, 120]]", "strict"),
    (GEMINI, "(250, 500)", "[[320, 120]]", "tolerant"),
    (QWEN, '[{"point_2d": [500, 250], "label": "cup"},]', "[[320, 120]]", "strict"),
    (QWEN, 'Here: {"point_2d": [500, 250]}', "[[320, 120]]", "tolerant"),
    (QWEN, '[{"point_2d": [500, 250}]', "[[320, 120]]", "tolerant"),
    (QWEN, '[{"point_2d": [500, ', None, "none"),
    (MOLMO, '<point x="50" y="25" alt="cup">cup</point>', "[[320, 120]]", "strict"),
    (MOLMO, '<points x1="50" y1="25" x2="10" y2="10" alt="cups">cups</points>', "[[320, 120], [64, 48]]", "strict"),
    (FRACTIONS, "[(5e-1, 2.5e-01)]", "[[320, 120]]", "strict"),
    (FRACTIONS, "It is at (5e-1, 2.5E-1).", "[[320, 120]]", "tolerant"),
    (FRACTIONS, "(5e-1x, 2e-1)", None, "none"),
    (QWEN, '[{"point_2d": [1e9999999, 250]}]', None, "none"),
    (QWEN, '[{"point_2d": [500, 1e-9999999]}]', None, "none"),
    (QWEN, '[{"point_2d": [5e2, 2.5e+2]}]', "[[320, 120]]", "strict"),
    (BOX, "[10, 20, 30, 60]", "[10, 20, 30, 60]", "strict"),
    (BOX, '[{"bbox_2d": [10, 20, 30, 60]}]', "[10, 20, 30, 60]", "tolerant"),
    (BOX, "[1, 2, 3]", None, "none"),
    (FRACTIONS, "[(NaN, Infinity)]", None, "none"),
    (FRACTIONS, "(99999999999999999999, 1e999)", None, "none"),
    (FRACTIONS, "(1e99, 1e9)", None, "none"),
]


@each("spec, text, answer, stage", HOSTILE)
def test_a_hostile_answer_is_read_as_documented(spec, text, answer, stage):
    began = time.process_time()
    read = read_text(spec, text)
    assert (read.answer, read.stage) == (answer, stage)
    assert time.process_time() - began < 2.0


@pytest.mark.parametrize(
    "text",
    [
        "<think>" * 100_000,
        "<answer>" * 100_000,
        "[(1, 2)" + " " * 500_000,
        "[(1, 2), " * 50_000,
        "```json\n" * 50_000,
        "{" * 100_000,
        "(A) " * 100_000 + "or ",
        "the answer is " * 50_000,
        '<point x="' * 50_000,
        "1," * 200_000,
        "-" * 500_000,
    ],
    ids=lambda text: text[:9].strip(),
)
def test_no_long_text_is_slow(text):
    began = time.process_time()
    for spec in (CHOICE, YES_NO, NUMBER, FRACTIONS, GEMINI, MOLMO, BOX):
        read_text(spec, text)
    assert time.process_time() - began < 4.0


@pytest.mark.parametrize("name", CONVENTIONS)
def test_each_convention_gives_the_same_point_in_its_own_numbers(name):
    spoken = {
        "pixels": "[320, 120]",
        "thousandths": "[500, 250]",
        "fractions": "[0.5, 0.25]",
        "thousandths-json": '[{"point_2d": [500, 250]}]',
        "thousandths-yx-json": '[{"point": [250, 500]}]',
        "percent-xml": '<point x="50" y="25">',
    }
    read = read_text(points(name, Form.POINT), spoken[name])
    assert (read.answer, read.stage) == ("[320, 120]", "strict")
    request = convention(name).request("points", 640, 480)
    assert request.startswith("Answer with ")
    assert ("640" in request) == (name == "pixels")


def test_decimals_are_exact():
    """In binary, 0.29 of 100 pixels is pixel 28."""
    assert read_text(AnswerSpec(Form.POINTS, (), 100, 100, CONVENTIONS["fractions"]), "(0.29, 0.57)").answer == (
        "[[29, 57]]"
    )


def test_a_place_far_outside_a_large_picture_keeps_its_numbers():
    """Pixels that are read as fractions of 1920 columns have seven digits."""
    spec = AnswerSpec(Form.POINTS, (), 1920, 1080, CONVENTIONS["fractions"])
    value = read_text(spec, "[(0.5, 0.5), (1500, 900)]").answer
    assert exact_groups(value) == [[960, 540], [2_880_000, 972_000]]
    assert numbers_of(value) == [[960, 540], [2_880_000, 972_000]]


@settings(max_examples=200, deadline=None)
@given(st.text(alphabet="AB<think/>()[]{}0.5,:\"x='y ", max_size=80))
def test_no_text_breaks_the_parser(text):
    for spec in (CHOICE, YES_NO, NUMBER, FRACTIONS, GEMINI, MOLMO, BOX):
        read = read_text(spec, text)
        assert (read.answer is None) == (read.stage == "none")
    final_text(text)
