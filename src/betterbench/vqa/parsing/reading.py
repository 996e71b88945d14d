"""Entry point of the parser for answers of models."""

from __future__ import annotations

from betterbench.vqa.parsing.answer import AnswerSpec, Read, final_text
from betterbench.vqa.parsing.choice import read_choice
from betterbench.vqa.parsing.points import read_points
from betterbench.vqa.parsing.words import read_number, read_yes_no
from betterbench.vqa.question import Form


def read_text(spec: AnswerSpec, text: str) -> Read:
    """Read the answer of a model from a text.

    The stage of the result is "none" if the text contains no answer, or several different answers.
    """
    text = final_text(text)
    match spec.form:
        case Form.YES_NO:
            return read_yes_no(text)
        case Form.CHOICE:
            return read_choice(spec.options, text)
        case Form.NUMBER:
            return read_number(text)
        case _:
            return read_points(spec, text)
