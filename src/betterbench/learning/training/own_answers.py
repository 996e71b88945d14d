"""Answers of a co-trained learner about the position of the instructed object in its own trials.

A learner that also answers questions may know the position of the object and still reach elsewhere. Its answer head is
evaluated on the recorded states of its own trials, with the same inputs as for acting. Answers are cells of the image,
see :mod:`betterbench.learning.training.questions`.
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
"""Regular expression for an answer that is a cell: column and row."""


@dataclass(frozen=True, slots=True)
class OwnAnswer:
    """Answer of a learner about one of its own trials.

    Attributes:
        trial: Task, condition and seed.
        where: Variation name or training condition.
        label: Label of the diagnosis.
        success: Whether the trial succeeded.
        object: Object name in the instruction.
        row: Row of the record.
        question: The question that the learner got.
        cell: The correct answer: "column,row" in a grid of 8 x 8 over the image.
        answer: Answer of the learner.
        nearest: Name of the loose object nearest to the center of the answered cell, or "" if the answer is not a cell.
            A cell is about as large as an object, so a neighboring cell often shows the object too.
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
        """Whether the answer is the object's cell."""
        return self.answer == self.cell

    @property
    def means_it(self) -> bool:
        """Whether the answered cell is nearer to this object than to any other."""
        return self.nearest == self.object


@dataclass(frozen=True, slots=True)
class OwnAnswers:
    """Rates of a learner's correct answers about one condition's trials.

    Attributes:
        where: Task with variation or training condition.
        cells: Share of answers that are the object's cell.
        nearest: Share of answers whose cell is nearer to the object than to any other object.
        trials: Share of trials in which this is true of all answers.
    """

    where: str
    cells: Rate
    nearest: Rate
    trials: Rate

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
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
    """Evaluate a learner's answers about the instructed object in the trials of its own run.

    Args:
        learner: The learner.
        run: The run of the learner.
        diagnosis: That run's diagnosis.
        open_photos: Opens the source of frames; only the image positions of objects are used.
        camera: Camera of the training questions.
        tasks: Tasks to include; all if empty.
        failures_only: True to exclude successful trials.
        on_progress: Called with the number of trials done and planned.

    Raises:
        InvalidInputError: If the learner does not answer questions, uses images, or is not the run's policy, or if no
            trial is left.
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
    """Return the answers of an ``objects`` learner to questions about one row of a record."""
    known = learner.trained.vocabulary.answers
    return tuple(known[int(answer_scores(learner, record, row, q).argmax())] for q in questions)


def answer_scores(learner: Learner, record: Record, row: int, question: Question) -> np.ndarray:
    """Return the logits of a learner's answers to a question about a row of a record, shape (answers,) float32.

    The learner belongs to the family ``objects``. Its input is the same as for acting at that row, with the question in
    place of the instruction.
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
    """Yield the rates by condition, in answer order, and then over all answers ("all")."""
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
    """Return answers as a JSON-serializable list."""
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
    """Return the name of the loose object nearest to the center of the answered cell, or ""."""
    found = _CELL.fullmatch(answer)
    if found is None:
        return ""
    x, y = (int(number) + 0.5 for number in found.groups())
    return min(about.middles, key=lambda name: math.dist((x, y), about.middles[name]))


def require_answers(learner: Learner, option: str = "--learner") -> None:
    """Raise an InvalidInputError that names an option for a learner that does not answer questions or uses images."""
    recipe = learner.trained.recipe
    if not learner.trained.vocabulary.answers:
        problem = "the learner was trained without questions, so it cannot answer any"
        raise InvalidInputError(option, problem, "Train a learner with co_training in its recipe")
    if recipe.sees != "objects":
        problem = f"the learner of family {recipe.family!r} uses images, but only the family 'objects' is supported"
        raise InvalidInputError(option, problem, "Give a learner of the family 'objects'")


def _require_asked(learner: Learner, run: RunFolder) -> None:
    """Raise InvalidInputError for a learner that does not answer questions, uses images, or is not a run's policy."""
    require_answers(learner)
    told = run.context.get("policy")
    metadata = told.get("metadata") if isinstance(told, Mapping) else None
    played = metadata.get("checkpoint") if isinstance(metadata, Mapping) else None
    if played != f"sha256 {learner.fingerprint}":
        problem = f"{run.path} is a run of {'other weights' if played else 'another kind of policy'}"
        raise InvalidInputError("--learner", problem, "Give the checkpoint of the run")
