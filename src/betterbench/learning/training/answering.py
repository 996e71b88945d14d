"""Adapter for asking a co-trained learner about recorded frames with ``better vlm``.

A co-trained learner is a policy that was also trained to answer questions. It must belong to the family ``objects``.
Instead of the image that a question is about, the learner receives the recorded state of that frame (see
:mod:`betterbench.learning.training.own_answers`). The learner's answer is the most likely of the answers that the
question allows.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.learning.training.own_answers import answer_scores, require_answers
from betterbench.learning.training.questions import option_class
from betterbench.policies.learned.policy import Learner
from betterbench.records import Record, RunFolder
from betterbench.vqa import Form, Question, QuestionSet
from betterbench.vqa.llm import RefusedError
from betterbench.vqa.question import hash_number, letter
from betterbench.vqa.types.grounding import CELLS

_KEPT_RECORDS = 8


class LearnerModel:
    """Learner that answers the questions in one question set; see :class:`~betterbench.vqa.llm.Model`.

    A model receives only an image and a prompt. They are used to look up the question and the recorded state that it is
    about. If two options lie in the same cell of the image, the learner cannot tell them apart. A hash of the question
    then picks one of the two, so that the answer is right in about half of these cases.
    """

    def __init__(self, name: str, learner: Learner, asked: QuestionSet, run: RunFolder) -> None:
        """Index the questions of a set, and the records that the questions are about.

        Args:
            name: Name of the learner in tables.
            learner: The learner.
            asked: The question set.
            run: Run that contains the records of the frames.

        Raises:
            InvalidInputError: If the learner cannot answer questions or uses images, or the set is about other records.
        """
        require_answers(learner, "--model")
        asked.require_about(run)
        planned = {str(entry.key) for entry in run.entries()}
        other = next((q.source.trial for q in asked.questions if str(q.source.trial) not in planned), None)
        if other is not None:
            problem = f"{run.path} has no trial {other}, but {asked.path} has questions about it"
            raise InvalidInputError("--records", problem, "Use the run from which `better vqa` made the set")
        self.name = name
        self._learner = learner
        self._number = {answer: i for i, answer in enumerate(learner.trained.vocabulary.answers)}
        digests = {place: _digest(asked.image(place)) for place in {q.image for q in asked.questions}}
        self._questions: dict[str, list[Question]] = {}
        for question in asked.questions:
            self._questions.setdefault(digests[question.image], []).append(question)

        @lru_cache(maxsize=_KEPT_RECORDS)
        def record(task: str, condition: str, seed: int) -> Record:
            return run.read_record(task, condition, seed)

        self._record = record

    def answer(self, prompt: str, pictures: Sequence[bytes]) -> str:
        """Return the answer to a question of the set, in the format that its prompt requests.

        Raises:
            RefusedError: If the set does not contain the question, or none of its possible answers occurred in
                training.
        """
        found = self._questions.get(_digest(pictures[0]), ()) if pictures else ()
        question = next((q for q in found if prompt.startswith(q.prompt)), None)
        if question is None:
            raise RefusedError("the learner can only answer the questions of the set, with unchanged images")
        known = [(text, self._number[name]) for text, name in _possible(question) if name in self._number]
        if not known:
            raise RefusedError(f"none of the answers to {question.id} occurred in training")
        s = question.source
        scores = answer_scores(self._learner, self._record(s.task, s.condition, s.seed), s.row, question)
        told = np.array([scores[number] for _, number in known])
        best = [text for (text, _), score in zip(known, told, strict=True) if score == told.max()]
        return best[hash_number("same class", question.id) % len(best)]


def _digest(picture: bytes) -> str:
    return hashlib.sha256(picture).hexdigest()


def _possible(question: Question) -> list[tuple[str, str]]:
    """Return the possible answers to a question, as pairs of the reply and the learner's answer class."""
    if question.form is Form.CHOICE:
        return [(letter(i), option_class(text, question.width)) for i, text in enumerate(question.options)]
    if question.form is Form.YES_NO:
        return [(name, name) for name in ("Yes", "No")]
    if question.form is Form.NUMBER:
        return [(str(n), str(n)) for n in range(100)]
    cells = [(x, y) for x in range(CELLS) for y in range(CELLS)]
    return [(_place(question, x, y), f"{x},{y}") for x, y in cells]


def _place(question: Question, column: int, row: int) -> str:
    """Return an image cell as an answer in pixels: its center if the question asks for a point, otherwise its box."""
    across, down = question.width / CELLS, question.height / CELLS
    if question.form is Form.POINT:
        return f"[{(column + 0.5) * across:g}, {(row + 0.5) * down:g}]"
    ends = (column * across, row * down, (column + 1) * across, (row + 1) * down)
    return f"[{', '.join(f'{v:g}' for v in ends)}]"
