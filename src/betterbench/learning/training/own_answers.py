"""Answers of a co-trained learner about the position of the instructed object in its own trials.

A co-trained learner is a policy that was also trained to answer questions. It may know where an object is and still
reach elsewhere. To find out, it is asked about the recorded states of its own trials, and receives the same inputs that
it received when it acted. Answers are cells of the image, see :mod:`betterbench.learning.training.questions`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from betterbench.diagnosis import RunDiagnosis, TrialDiagnosis
from betterbench.errors import InvalidInputError
from betterbench.jobs import OnCount
from betterbench.learning.training.questions import question_text
from betterbench.policies.learned.network import ObjectsBatch
from betterbench.policies.learned.policy import Learner
from betterbench.policies.learned.tokens import pose_numbers, things_of, tool_numbers
from betterbench.records import Record, RunFolder
from betterbench.statistics import Rate
from betterbench.tasks import Kind
from betterbench.vqa.blind import answer_class
from betterbench.vqa.dataset import OpenPhotos
from betterbench.vqa.named_object import NamedObject, named_object
from betterbench.vqa.question import Question

_CELL = re.compile(r"([0-7]),([0-7])")
"""Pattern of an answer that is an image cell: column and row."""


@dataclass(frozen=True, slots=True)
class OwnAnswer:
    """Answer of a learner to a question about one of its own trials.

    Attributes:
        trial: Task, condition and seed.
        where: Task with the name of the variation or of the training condition.
        label: Label that was assigned to the trial by the diagnosis.
        success: Whether the trial succeeded.
        object: Name of the object that is mentioned in the instruction.
        row: Row of the record.
        question: Question that the learner was asked.
        cell: Correct answer: "column,row" in a grid of 8 x 8 cells over the image.
        answer: Answer of the learner.
        nearest: Name of the loose object nearest to the center of the answered cell; "" if the answer is not a cell.
            Since a cell is about as large as an object, an object often extends into a neighboring cell, which then
            counts as an answer near the object.
    """

    trial: str
    where: str
    label: str
    success: bool
    object: str
    row: int
    question: str
    cell: str
    answer: str
    nearest: str

    @property
    def right(self) -> bool:
        """Whether the answer is the cell that contains the object."""
        return self.answer == self.cell

    @property
    def means_it(self) -> bool:
        """Whether the answered cell is nearer to the object of the question than to any other object."""
        return self.nearest == self.object


@dataclass(frozen=True, slots=True)
class OwnAnswers:
    """Rates of a learner's correct answers about the trials of one condition.

    Attributes:
        where: Task with the name of the variation or of the training condition.
        cells: Fraction of the answers that name the cell of the object.
        nearest: Fraction of the answers that name a cell nearer to the object than to any other object.
        trials: Fraction of the trials in which all answers name such a cell.
    """

    where: str
    cells: Rate
    nearest: Rate
    trials: Rate

    def to_json(self) -> dict[str, Any]:
        """Return the rates as a JSON-serializable dict."""
        rates = {"cells": self.cells, "nearest": self.nearest, "trials": self.trials}
        return {"where": self.where, **{name: rate.to_json() for name, rate in rates.items()}}


def ask_about_run(
    learner: Learner,
    run: RunFolder,
    diagnosis: RunDiagnosis,
    *,
    open_photos: OpenPhotos,
    camera: str = "front",
    tasks: Sequence[str] = (),
    failures_only: bool = False,
    on_progress: OnCount | None = None,
) -> tuple[OwnAnswer, ...]:
    """Ask a learner about the instructed object in the trials of its own run.

    Args:
        learner: The learner.
        run: Run in which the learner was the policy.
        diagnosis: Diagnosis of this run.
        open_photos: Function that opens a source of frames. Only the positions of objects in the images are used.
        camera: Camera that the training questions were about.
        tasks: Tasks to include; empty for all tasks.
        failures_only: Whether to leave out successful trials.
        on_progress: Called with the number of finished trials and the total number.

    Raises:
        InvalidInputError: If the learner cannot answer questions, uses images, or is not the policy of the run, or if
            no trial is left.
        RecordError: If a record or its scene is damaged.
    """
    _require_asked(learner, run)
    chosen = [
        t
        for t in diagnosis.trials
        if t.record is not None
        and t.kind not in (Kind.SYSTEM, Kind.UNFINISHED)
        and (not tasks or t.task in tasks)
        and not (failures_only and (t.kind is Kind.NONE or t.ambiguous))
    ]
    if not chosen:
        raise InvalidInputError(str(run.path), "no trials are left", "Leave out --failures-only or --tasks")
    found: list[OwnAnswer] = []
    with open_photos() as photos:
        for number, trial in enumerate(chosen, start=1):
            key = trial.trial_id
            record = run.read_record(key.task, key.condition, key.seed)
            about = named_object(record, trial, photos, camera=camera)
            if about is not None:
                said = own_answers(learner, record, about.row, about.questions)
                found += [_own(q, answer, about, trial) for q, answer in zip(about.questions, said, strict=True)]
            if on_progress is not None:
                on_progress(number, len(chosen))
    return tuple(found)


def own_answers(learner: Learner, record: Record, row: int, questions: Iterable[Question]) -> tuple[str, ...]:
    """Return the answers of a learner of the family ``objects`` to questions about one row of a record."""
    known = learner.trained.vocabulary.answers
    return tuple(known[int(answer_scores(learner, record, row, q).argmax())] for q in questions)


def answer_scores(learner: Learner, record: Record, row: int, question: Question) -> np.ndarray:
    """Return a learner's logits for all possible answers to a question about one row of a record, (answers,) float32.

    The learner must belong to the family ``objects``. Its input is the same as when it acts at that row, with the
    question in place of the instruction.
    """
    recipe, known = learner.trained.recipe, learner.trained.vocabulary
    rows = np.maximum(row - recipe.history_stride * np.arange(recipe.history), 0)
    tools = tool_numbers(record.ee_position[rows], record.ee_quaternion[rows], record.finger_width[rows])
    poses = pose_numbers(record.object_positions[row], record.object_quaternions[row]).astype(np.float32)
    things = things_of(question_text(question), record.state(row).info.objects, known)
    shown = ObjectsBatch(
        words=learner.batch(things.words),
        tools=learner.batch(tools),
        poses=learner.batch(poses),
        sizes=learner.batch(things.sizes),
        categories=learner.batch(things.categories),
        colors=learner.batch(things.colors),
    )
    with torch.inference_mode():
        scores: np.ndarray = learner.network.reply(shown)[0].cpu().numpy()
    return scores


def summaries_of(answers: Sequence[OwnAnswer]) -> Iterator[OwnAnswers]:
    """Yield the rates of correct answers for each condition, and then for all answers together ("all").

    The conditions come in the order in which they first occur among the answers.
    """
    groups: dict[str, list[OwnAnswer]] = {}
    for answer in answers:
        groups.setdefault(answer.where, []).append(answer)
    for where, members in (*groups.items(), ("all", list(answers))):
        by_trial: dict[str, bool] = {}
        for answer in members:
            by_trial[answer.trial] = by_trial.get(answer.trial, True) and answer.means_it
        cells, nearest, n = sum(a.right for a in members), sum(a.means_it for a in members), len(members)
        yield OwnAnswers(where, Rate(cells, n), Rate(nearest, n), Rate(sum(by_trial.values()), len(by_trial)))


def answers_form(answers: Sequence[OwnAnswer]) -> list[dict[str, Any]]:
    """Return the answers as a JSON-serializable list."""
    return [{**asdict(a), "right": a.right, "means_it": a.means_it} for a in answers]


def _own(question: Question, answer: str, about: NamedObject, trial: TrialDiagnosis) -> OwnAnswer:
    return OwnAnswer(
        trial=str(trial.trial_id),
        where=f"{trial.task}/{trial.variation or trial.condition}",
        label=trial.label.value,
        success=trial.success,
        object=about.name,
        row=about.row,
        question=question_text(question),
        cell=answer_class(question),
        answer=answer,
        nearest=_nearest(answer, about),
    )


def _nearest(answer: str, about: NamedObject) -> str:
    """Return the name of the loose object nearest to the center of the answered cell.

    Return "" if the answer is not a cell.
    """
    found = _CELL.fullmatch(answer)
    if found is None:
        return ""
    x, y = (int(number) + 0.5 for number in found.groups())
    return min(about.middles, key=lambda name: math.dist((x, y), about.middles[name]))


def require_answers(learner: Learner, option: str = "--learner") -> None:
    """Raise InvalidInputError if a learner cannot answer questions or uses images.

    Args:
        learner: The learner.
        option: Command-line option that selected the learner, for the error message.
    """
    recipe = learner.trained.recipe
    if not learner.trained.vocabulary.answers:
        problem = "the learner was trained without questions, so it cannot answer questions"
        raise InvalidInputError(option, problem, "Train a learner with co_training in its recipe")
    if recipe.sees != "objects":
        problem = f"the learner of family {recipe.family!r} uses images, but only the family 'objects' is supported"
        raise InvalidInputError(option, problem, "Use a learner of the family 'objects'")


def _require_asked(learner: Learner, run: RunFolder) -> None:
    """Raise InvalidInputError if a learner cannot answer questions, uses images, or is not the policy of the run."""
    require_answers(learner)
    told = run.context.get("policy")
    metadata = told.get("metadata") if isinstance(told, Mapping) else None
    played = metadata.get("checkpoint") if isinstance(metadata, Mapping) else None
    if played != f"sha256 {learner.fingerprint}":
        problem = f"the run {run.path} used {'other weights' if played else 'another kind of policy'}"
        raise InvalidInputError("--learner", problem, "Use the checkpoint that was evaluated in this run")
