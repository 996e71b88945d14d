"""Baselines that do not see the image: the most frequent answer, and naive Bayes on the words of the question.

The classifier is multinomial naive Bayes over words and pairs of neighboring words, with add-one smoothing. See
McCallum and Nigam, "A comparison of event models for naive Bayes text classification", 1998. The classifier is
tested by cross-validation. For a box or a point, it predicts a cell of the image and gives a typical answer for this
cell.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from betterbench.errors import InvalidInputError
from betterbench.json_form import open_form
from betterbench.statistics import Rate
from betterbench.vqa.question import Form, Question, QuestionType, hash_number
from betterbench.vqa.scoring import is_right, overlap
from betterbench.vqa.types.grounding import CELLS, COARSE_CELLS

FOLDS = 5
"""Number of folds in the cross-validation."""
TARGET_POINTS = 5.0
"""Maximum accepted accuracy of the blind classifier above chance, for a type of question [percentage points]."""


@open_form
@dataclass(frozen=True, slots=True)
class Baseline:
    """Number of questions of one type that are answered correctly without the image.

    Attributes:
        name: Name of the type.
        n: Number of questions.
        blind: Number of correct answers of the classifier.
        majority: Number of questions that are answered correctly by the most frequent answer.
        chance: Expected fraction of correct answers if each question is answered with a random answer from its group.
            For boxes and points, this is the fraction of questions for which the best constant answer is correct.
    """

    name: str
    n: Annotated[int, Field(ge=0, lt=1 << 40)]
    blind: Annotated[int, Field(ge=0, lt=1 << 40)]
    majority: Annotated[int, Field(ge=0, lt=1 << 40)]
    chance: Annotated[float, Field(ge=0.0, le=1.0)]

    def __post_init__(self) -> None:
        """Check that there are at most as many correct answers as questions.

        Raises:
            InvalidInputError: If there are more correct answers than questions.
        """
        if max(self.blind, self.majority) > self.n:
            raise InvalidInputError(
                self.name, f"has more correct answers than its {self.n} questions", "Correct the counts"
            )

    @property
    def excess_points(self) -> float:
        """Accuracy of the classifier minus the accuracy expected by chance [percentage points]."""
        return 100.0 * (self.blind / self.n - self.chance) if self.n else 0.0

    @property
    def is_balanced(self) -> bool:
        """Whether the classifier exceeds chance by at most :data:`TARGET_POINTS`, or chance is in its 95 % interval.

        With a hundred questions, the accuracy of the classifier varies by about 10 percentage points by chance. Without
        the interval, nearly every small set would therefore be rejected.
        """
        return self.excess_points <= TARGET_POINTS or Rate(self.blind, self.n).low <= self.chance

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict with confidence intervals."""
        rates = {"blind_rate": Rate(self.blind, self.n), "majority_rate": Rate(self.majority, self.n)}
        intervals = {name: [rate.low, rate.high] for name, rate in rates.items()}
        return {**asdict(self), **intervals, "excess_points": self.excess_points, "balanced": self.is_balanced}


def baselines(questions: Sequence[Question], turns: Sequence[int]) -> list[Baseline]:
    """Return the baselines for each type of question, and then for each form of answer within the type "grounding".

    Args:
        questions: Questions of the set.
        turns: Attribute ``turn`` of each question, see :class:`~betterbench.vqa.balance.Chosen`.
    """
    right = blind_right(questions, turns)
    constant = _constant_right(questions)
    found = []
    for name, members in _parts(questions):
        spatial = [i for i in members if questions[i].form in (Form.BOX, Form.POINT)]
        closed = [i for i in members if questions[i].chance is not None]
        expected = sum(float(questions[i].chance or 0.0) for i in closed) + sum(constant[i] for i in spatial)
        n = len(members)
        blind, majority = sum(right[i] for i in members), sum(constant[i] for i in members)
        found.append(Baseline(name, n, int(blind), int(majority), expected / n))
    return found


def _parts(questions: Sequence[Question]) -> list[tuple[str, list[int]]]:
    parts: dict[str, list[int]] = {}
    for i, q in enumerate(questions):
        parts.setdefault(q.type.value, []).append(i)
    order = [t.value for t in QuestionType if t.value in parts]
    for i, q in enumerate(questions):
        if q.type is QuestionType.GROUNDING:
            parts.setdefault(f"{q.type.value}: {q.form.value}", []).append(i)
    return [(name, parts[name]) for name in [*order, *sorted(n for n in parts if ":" in n)]]


def _constant_right(questions: Sequence[Question]) -> list[bool]:
    """For each question, return whether the most frequent answer to questions of its type and form is correct."""
    right = [False] * len(questions)
    for members in _by_form(questions):
        constant = _typical([questions[i] for i in members])
        for i in members:
            right[i] = is_right(questions[i], constant)
    return right


def blind_right(questions: Sequence[Question], turns: Sequence[int]) -> list[bool]:
    """For each question, return whether the classifier answers it correctly after training on the other folds.

    The fold of a question is its turn modulo :data:`FOLDS`.
    """
    right = [False] * len(questions)
    fold = np.array(turns) % FOLDS
    for members in _by_form(questions):
        words = [_words(questions[i]) for i in members]
        classes = [answer_class(questions[i]) for i in members]
        for f in range(FOLDS):
            test = [k for k, i in enumerate(members) if fold[i] == f]
            train = [k for k, i in enumerate(members) if fold[i] != f]
            if not test or not train:
                continue
            bayes = _NaiveBayes([words[k] for k in train], [classes[k] for k in train])
            answers = _answers(bayes.classes, [questions[members[k]] for k in train])
            for k in test:
                question = questions[members[k]]
                allowed = set(question.options) if question.options else None
                guess = bayes.predict(words[k], allowed, tie=question.id)
                right[members[k]] = guess is not None and is_right(question, answers[guess])
    return right


def _by_form(questions: Sequence[Question]) -> list[list[int]]:
    parts: dict[tuple[str, str], list[int]] = {}
    for i, q in enumerate(questions):
        parts.setdefault((q.type.value, q.form.value), []).append(i)
    return list(parts.values())


def answer_class(question: Question) -> str:
    """Return the class of a question's answer.

    This is the answer itself or, for a box or a point, the image cell that contains its center.
    """
    if question.form not in (Form.BOX, Form.POINT) or question.box is None:
        return question.answer
    return _cell(question.box, question.width, CELLS)


def _cell(box: Sequence[int], width: int, cells: int) -> str:
    step = width / cells
    return f"{int(0.5 * (box[0] + box[2]) // step)},{int(0.5 * (box[1] + box[3]) // step)}"


def _answers(classes: Sequence[str], train: Sequence[Question]) -> dict[str, str]:
    """Return the answer that the classifier gives for each of its classes."""
    members: dict[str, list[Question]] = defaultdict(list)
    for question in train:
        members[answer_class(question)].append(question)
    return {name: _typical(members[name]) for name in classes}


def _typical(questions: Sequence[Question]) -> str:
    """Return the answer that is correct for the largest number of the given questions.

    For boxes and points, this is the box or point that matches the largest number of correct answers.
    """
    if questions[0].form not in (Form.BOX, Form.POINT):
        counts = Counter(q.answer for q in questions)
        return min(counts, key=lambda a: (-counts[a], a))
    tried = sorted({q.answer for q in questions})[:: max(1, len(questions) // _MOST_TRIED)]
    sample = questions[:: max(1, len(questions) // _MOST_SCORED)]
    if questions[0].form is Form.POINT:
        return max(tried, key=lambda a: sum(is_right(q, a) for q in sample))
    boxes = [q.box for q in sample if q.box is not None]
    return max(tried, key=lambda a: sum(overlap(_numbers(a), box) >= 0.5 for box in boxes))


_MOST_TRIED, _MOST_SCORED = 60, 300


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(part) for part in re.findall(r"-?\d+(?:\.\d+)?", text))


def box_cell(text: str, width: int, cells: int) -> str | None:
    """Return the cell "column,row" that contains the center of a box, or None if the text is not a box.

    Args:
        text: Text of the box.
        width: Width of the image in pixels.
        cells: Number of cells along each side of the image.
    """
    if re.fullmatch(r"\[[\d, ]+\]", text) is None:
        return None
    box = [int(v) for v in _numbers(text)]
    return _cell(box, width, cells) if len(box) == 4 else None


def in_cells(text: str, width: int, cells: int = COARSE_CELLS) -> str:
    """Replace each box in a text by a word for the image cell that contains the center of the box."""
    for found in re.findall(r"\[[\d, ]+\]", text):
        cell = box_cell(found, width, cells)
        if cell is not None:
            text = text.replace(found, f" cell{cell.replace(',', 'x')} ")
    return text


def _words(question: Question) -> list[str]:
    """Return the words of a question and all pairs of neighboring words, with coordinates replaced by image cells."""
    words = re.findall(r"[a-z0-9'-]+", in_cells(question.text.lower(), question.width))
    return words + [f"{a} {b}" for a, b in itertools.pairwise(words)]


class _NaiveBayes:
    """Multinomial naive Bayes with add-one smoothing."""

    def __init__(self, texts: Sequence[Sequence[str]], classes: Sequence[str]) -> None:
        self.classes = sorted(set(classes))
        vocabulary = {w: i for i, w in enumerate(sorted({w for words in texts for w in words}))}
        counts = np.ones((len(self.classes), len(vocabulary)))
        number = {c: i for i, c in enumerate(self.classes)}
        for words, name in zip(texts, classes, strict=True):
            np.add.at(counts[number[name]], [vocabulary[w] for w in words], 1.0)
        self._vocabulary = vocabulary
        self._log_words = np.log(counts / counts.sum(axis=1, keepdims=True))
        prior = np.array([sum(c == name for c in classes) for name in self.classes], dtype=np.float64)
        self._log_prior = np.log(prior / prior.sum())

    def predict(self, words: Sequence[str], allowed: set[str] | None, *, tie: str) -> str | None:
        """Return the most likely of the allowed classes. If several are equally likely, a hash of ``tie`` decides."""
        known = [self._vocabulary[w] for w in words if w in self._vocabulary]
        scores = self._log_prior + self._log_words[:, known].sum(axis=1)
        open_to = [i for i, c in enumerate(self.classes) if allowed is None or c in allowed]
        if not open_to:
            return None
        best = max(scores[i] for i in open_to)
        equal = [i for i in open_to if scores[i] >= best - 1e-9]
        return self.classes[equal[hash_number("tie", tie) % len(equal)]]
