"""Scoring of answers to the questions of a set. The parsed answer is compared with the correct answer."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.interface.state import in_runs
from betterbench.vqa.coordinates import CONVENTIONS, Coordinates
from betterbench.vqa.parsing import AnswerSpec, Read, read_text
from betterbench.vqa.parsing.points import numbers_of
from betterbench.vqa.question import Form, Question

LEAST_OVERLAP = 0.5
"""Minimum intersection over union of a correct box and the true box.

This is the usual threshold of detection benchmarks (PASCAL VOC).
"""


def spec_of(question: Question, *, coordinates: Coordinates = "pixels") -> AnswerSpec:
    """Return the form of the answer that a question requires."""
    return AnswerSpec(question.form, question.options, question.width, question.height, CONVENTIONS[coordinates])


def parse_answer(question: Question, text: str, *, coordinates: Coordinates = "pixels") -> Read:
    """Parse the answer to a question from a text.

    For a choice, the result is the text of the option instead of its letter.
    """
    read = read_text(spec_of(question, coordinates=coordinates), text)
    if question.form is Form.CHOICE and read.answer is not None:
        return Read(question.options[ord(read.answer) - ord("A")], read.stage)
    return read


def is_right(question: Question, answer: str | None) -> bool:
    """Return whether an answer, in the same format as the stored correct answer, is correct."""
    if answer is None:
        return False
    if question.form is Form.BOX and question.box is not None:
        return is_in_place(numbers_of(answer), box=question.box, runs=None, width=question.width)
    if question.form is Form.POINT and question.runs is not None:
        return is_in_place(numbers_of(answer), box=None, runs=question.runs, width=question.width)
    return answer == question.answer


def is_in_place(
    groups: Sequence[Sequence[float]], *, box: Sequence[float] | None, runs: tuple[int, ...] | None, width: int
) -> bool:
    """Return whether an answer is a single box with enough overlap with the true box, or a point on a visible pixel.

    Args:
        groups: Numbers of each box or point in the answer [pixel].
        box: The true box, for a question about a box.
        runs: The visible pixels, for a question about a point.
        width: Number of columns of the image [pixel].
    """
    if len(groups) != 1:
        return False
    if runs is not None:
        if len(groups[0]) != 2:
            return False
        x, y = (int(v + 0.5) if v >= 0 else -1 for v in groups[0])
        return in_runs(runs, width, x, y)
    return len(groups[0]) == 4 and box is not None and overlap(groups[0], box) >= LEAST_OVERLAP


def overlap(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the intersection over union of two boxes. Each box is given by its left, top, right and bottom edge."""
    across, down = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    if across <= 0.0 or down <= 0.0:
        return 0.0
    both = across * down
    return both / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - both)
