"""Sets of questions that were written by hand."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path

import numpy as np

from betterbench.learning.training.data import TrainingSet
from betterbench.learning.training.questions import TrainingQuestions
from betterbench.policies.learned.vocabulary import Vocabulary
from betterbench.tasks import TrialId
from betterbench.vqa import Difficulty, Form, Question, QuestionSet, QuestionType
from betterbench.vqa.dataset import write_set
from betterbench.vqa.question import FrameSource

SIDE = 256


def question(trial: TrialId, row: int, **changes) -> Question:
    told = f"{trial} {row} {sorted(map(str, changes.items()))}"
    given = {"text": "Is there a mug?", "form": Form.YES_NO, "options": (), "answer": "Yes", "box": None, **changes}
    return Question(
        id=hashlib.sha256(told.encode()).hexdigest()[:16], type=QuestionType.PREMISE, family="by hand",
        image="images/none.jpg", width=SIDE, height=SIDE, difficulty=Difficulty.EASY, tags=(), objects=(), group=("g",),
        words={}, chance=0.5, source=FrameSource(trial.task, trial.condition, trial.seed, row, 0.05 * row, "front"),
        **given,
    )  # fmt: skip


def asked_set(folder: Path, questions: list[Question], *, purpose: str = "training") -> QuestionSet:
    folder.mkdir(exist_ok=True)
    return write_set(folder, questions, [], purpose)


def with_questions(data: TrainingSet) -> TrainingSet:
    """A made-up training set with a question about every fifth frame: on which side is the thing of this color?"""
    frames = np.arange(0, len(data.actions), 5)
    episodes = data.episodes[frames]
    asked = np.arange(len(frames)) % 2
    colors, side = data.vocabulary.word_ids("blue red"), data.vocabulary.word_ids("side")
    words = np.stack([colors[asked], np.repeat(side, len(asked))], axis=1)
    answers = (data.poses[frames, asked, 0] > 0.0).astype(np.int64)
    store = data.frames_of
    found = TrainingQuestions(
        words=words, episodes=episodes, tools=data.tools[frames][:, None], poses=data.poses[frames], answers=answers,
        types=("relation",) * len(frames), frames_of=store, frames=None if store is None else frames,
    )  # fmt: skip
    known = Vocabulary(data.vocabulary.words, data.vocabulary.categories, data.vocabulary.colors, ("left", "right"))
    return dataclasses.replace(data, vocabulary=known, questions=found, sha256=f"{data.sha256} asked")
