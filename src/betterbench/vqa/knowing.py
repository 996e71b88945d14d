"""Comparison of a model's answers about decisive moments with the actions of the policy."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from math import prod
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from betterbench.diagnosis import RunDiagnosis
from betterbench.errors import InvalidInputError, RecordError
from betterbench.jobs import write_durably
from betterbench.json_form import open_form, open_seal, read_bounded, read_form, sealed_form
from betterbench.records import RunFolder
from betterbench.statistics import Rate
from betterbench.tasks import Kind, Label, TrialId, all_labels
from betterbench.vqa.asking import Answers
from betterbench.vqa.blind import blind_right
from betterbench.vqa.dataset import QuestionSet
from betterbench.vqa.decisive import DECIDING, ROLES, folds_of
from betterbench.vqa.knowing_groups import GroupKnowledge, group_knowledge
from betterbench.vqa.question import Question

_MAX_BYTES = 1 << 26


class KnowledgeStanding(StrEnum):
    """Relation between a model's knowledge and the policy's action in a trial, such as "knows and does not"."""

    KNOWS_AND_DOES = "knows_and_does"
    KNOWS_AND_DOES_NOT = "knows_and_does_not"
    DOES_NOT_KNOW = "does_not_know"
    """The model does not know the right decision, and the policy does not act correctly either."""
    DOES_WITHOUT_KNOWING = "does_without_knowing"
    NOT_ASKED = "not_asked"
    """The model did not answer the deciding questions.

    Their objects were not clearly visible, the set is about other trials, or the model has not answered all questions
    yet.
    """


@open_form
@dataclass(frozen=True, slots=True)
class TrialKnowledge:
    """Knowledge of a model about the decisive moment of one trial, together with the policy's outcome.

    Attributes:
        key: Key of the trial ("fast_food/T1/3").
        label: Outcome label of the trial.
        success: Whether the trial succeeded.
        standing: Relation between the model's knowledge and the policy's action.
        roles: Whether all questions of a role (such as "where") were answered correctly, for each role with answers.
        deciding: Roles of the questions that show whether the model knew the right decision. They depend on the label.
        chance: Probability of answering all deciding questions correctly without an image. This is the probability of
            guessing the answers or of inferring them from the wording, whichever is larger.
        task: Name of the task. In files of earlier versions, this field and the next two are empty.
        variation: Name of the variation, or None for a training condition.
        axis: Variation axis, or None.
    """

    key: str
    label: str
    success: bool
    standing: KnowledgeStanding
    roles: dict[str, bool]
    deciding: tuple[str, ...]
    chance: float
    task: str = ""
    variation: str | None = None
    axis: str | None = None

    @property
    def is_known(self) -> bool | None:
        """Whether the model knew the right decision, or None if it did not answer the deciding questions."""
        if self.standing is KnowledgeStanding.NOT_ASKED:
            return None
        return self.standing in (KnowledgeStanding.KNOWS_AND_DOES, KnowledgeStanding.KNOWS_AND_DOES_NOT)


@open_form
@dataclass(frozen=True, slots=True)
class LabelKnowledge:
    """Numbers of trials with one label, by the model's knowledge and the policy's action.

    Attributes:
        label: Outcome label.
        n: Number of trials.
        counts: Number of trials for each :class:`KnowledgeStanding`.
        chance: Mean probability of answering the deciding questions correctly without an image.
    """

    label: str
    n: int
    counts: dict[str, int]
    chance: float

    def __post_init__(self) -> None:
        """Check that the counts add up to the number of trials.

        Raises:
            InvalidInputError: If the counts do not add up to this number.
        """
        if set(self.counts) != set(KnowledgeStanding) or min(self.counts.values()) < 0:
            names = ", ".join(KnowledgeStanding)
            raise InvalidInputError(
                self.label, "must have exactly one count for each standing", f"The standings are {names}"
            )
        if sum(self.counts.values()) != self.n:
            problem = f"its counts add up to {sum(self.counts.values())} trials, expected {self.n}"
            raise InvalidInputError(self.label, problem, "Correct the counts")

    @property
    def knows(self) -> Rate:
        """Fraction of trials where the model knew the right decision, among the trials with answers."""
        known = (
            self.counts[KnowledgeStanding.KNOWS_AND_DOES.value]
            + self.counts[KnowledgeStanding.KNOWS_AND_DOES_NOT.value]
        )
        return Rate(known, self.n - self.counts[KnowledgeStanding.NOT_ASKED.value])

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {**asdict(self), "knows": self.knows.to_json()}


@open_form
@dataclass(frozen=True, slots=True)
class Knowledge:
    """Knowledge of a model about the decisive moments in the trials of a policy.

    Attributes:
        model: Name of the model.
        policy: Name of the policy.
        labels: One entry for each label that occurs, in label order.
        trials: One entry for each trial.
        roles: Fraction of correct answers for each role of questions, among the questions with an answer.
        asked: Number of questions in the set that are about moments of the run.
        answered: Number of these questions that have an answer.
    """

    model: str
    policy: str
    labels: tuple[LabelKnowledge, ...]
    trials: tuple[TrialKnowledge, ...]
    roles: dict[str, Rate]
    asked: int = 0
    answered: int = 0

    @property
    def is_complete(self) -> bool:
        """Whether every question was sent to the model."""
        return self.answered == self.asked

    @property
    def groups(self) -> tuple[GroupKnowledge, ...]:
        """Comparison of knowledge and action by axis, variation and failure mode.

        This is empty if the file was written by an earlier version.
        """
        return group_knowledge(self.trials) if all(t.task for t in self.trials) else ()

    def count(self, standing: KnowledgeStanding, *, failed: bool | None = None) -> int:
        """Return the number of trials with a standing. ``failed`` restricts the count to failed or to solved trials."""
        return sum(t.standing is standing and (failed is None or t.success is not failed) for t in self.trials)

    @property
    def sentence(self) -> str:
        """Sentence that states in how many failed trials the model knew the right decision."""
        failed = [t for t in self.trials if not t.success and t.standing is not KnowledgeStanding.NOT_ASKED]
        known = sum(t.standing is KnowledgeStanding.KNOWS_AND_DOES_NOT for t in failed)
        if not failed:
            return f"{self.model} answered no questions about failed trials."
        guessed = sum(t.chance for t in failed)
        return (
            f"Of {len(failed)} failed trials with answers of {self.model}, it knew the right decision in {known} "
            f"(expected without the image: {guessed:.1f})."
        )

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "model": self.model,
            "policy": self.policy,
            "sentence": self.sentence,
            "asked": self.asked,
            "answered": self.answered,
            "labels": [x.to_json() for x in self.labels],
            "groups": [x.to_json() for x in self.groups],
            "roles": {name: rate.to_json() for name, rate in self.roles.items()},
            "trials": [asdict(t) for t in self.trials],
        }


_KNOWLEDGE = TypeAdapter(Knowledge)


def knowledge_of(diagnosis: RunDiagnosis, asked: QuestionSet, answers: Answers) -> Knowledge:
    """Return what a model knows about the decisive moments in the trials of a policy.

    Args:
        diagnosis: Diagnosis of the run.
        asked: Question set about the decisive moments of the run.
        answers: Answers of the model to this set.

    Raises:
        InvalidInputError: If no question of the set is about a trial of the run, or if none of these has an answer.
    """
    by_trial: dict[TrialId, list[Question]] = {}
    for q in asked.questions:
        if q.role is not None:
            by_trial.setdefault(q.source.trial, []).append(q)
    trials = [t for t in diagnosis.counted_trials if t.kind not in (Kind.SYSTEM, Kind.UNFINISHED)]
    if not any(t.trial_id in by_trial for t in trials):
        cure = "Make a set with `better vqa --run RUN --out SET`, and have the model answer it"
        raise InvalidInputError(str(asked.path), "contains no questions about this run", cure)
    mine = [q for t in trials for q in by_trial.get(t.trial_id, [])]
    answered = [q for q in mine if answers.has(q)]
    if not answered:
        cure = "Run `better vqa SET --ask`, or pass a file with answers to that set"
        raise InvalidInputError(
            f"answers of {answers.head.model!r}", f"the file contains no answer to a question of {asked.path}", cure
        )
    blind = _blind_by_role(asked.questions)
    found = tuple(
        replace(
            _trial(t.key, t.label, by_trial.get(t.trial_id, []), answers, blind, success=t.kind is Kind.NONE),
            task=t.task,
            variation=t.variation,
            axis=t.axis,
        )
        for t in trials
    )
    roles = {
        role: Rate(sum(answers.right(q) for q in members), len(members))
        for role in ROLES
        if (members := [q for q in answered if q.role == role])
    }
    labels = tuple(_label(label.value, of) for label in all_labels() if (of := _of(label, found)))
    return Knowledge(answers.head.model, diagnosis.policy, labels, found, roles, len(mine), len(answered))


def _blind_by_role(questions: Sequence[Question]) -> dict[str, float]:
    """For each role, return the fraction of trials where all answers can be inferred from the wording alone."""
    decisive = [q for q in questions if q.role is not None]
    given_away: dict[str, dict[TrialId, bool]] = {}
    for q, right in zip(decisive, blind_right(decisive, folds_of(decisive)), strict=True):
        trials = given_away.setdefault(str(q.role), {})
        trials[q.source.trial] = trials.get(q.source.trial, True) and right
    return {role: sum(trials.values()) / len(trials) for role, trials in given_away.items()}


def knowledge_path(run: RunFolder) -> Path:
    """Return the path of the file that stores a model's knowledge about a run."""
    return run.path / "knowledge.json"


def store_knowledge(run: RunFolder, known: Knowledge) -> Path:
    """Write a model's knowledge to the folder of the run, so that the report finds it. Return the path.

    Raises:
        OSError: If the folder cannot be written.
        RunConflictError: If another process is writing to the run.
        StorageError: If the disk is full, broken or write-protected.
        InvalidInputError: If the path is a link that leads out of the folder.
    """
    form = sealed_form({"version": 2, "sentence": known.sentence, **asdict(known)})
    with run.locked():
        write_durably(knowledge_path(run), json.dumps(form, indent=1).encode() + b"\n")
    return knowledge_path(run)


def read_knowledge(run: RunFolder) -> Knowledge | None:
    """Read a model's knowledge about a run, or return None if the run's folder contains none.

    Raises:
        RecordError: If the file cannot be read or is malformed.
    """
    path = knowledge_path(run)
    if not path.exists():
        return None
    cure = "Run `better diagnose RUN --answers FILE` again"
    raw = read_bounded(path, max_bytes=_MAX_BYTES, cure=cure, raises=RecordError)
    form = open_seal(raw, where=str(path), cure=cure, raises=RecordError, since=("version", 2))
    return read_form(_KNOWLEDGE, form, where=str(path), cure=cure, raises=RecordError)


def _of(label: Label, trials: Sequence[TrialKnowledge]) -> list[TrialKnowledge]:
    return [t for t in trials if t.label == label.value]


def _trial(
    key: str,
    label: Label,
    questions: Sequence[Question],
    answers: Answers,
    blind: Mapping[str, float],
    *,
    success: bool,
) -> TrialKnowledge:
    of_role: dict[str, list[Question]] = {}
    for q in questions:
        of_role.setdefault(str(q.role), []).append(q)
    told = {role: members for role, members in of_role.items() if all(answers.has(q) for q in members)}
    roles = {role: all(answers.right(q) for q in members) for role, members in told.items()}
    deciding = tuple(role for role in DECIDING.get(label, ROLES) if role in of_role)
    chance = prod(max(blind[role], prod(q.chance or 0.0 for q in of_role[role])) for role in deciding)
    if not deciding or not all(role in told for role in deciding):
        return TrialKnowledge(key, label.value, success, KnowledgeStanding.NOT_ASKED, roles, (), 0.0)
    if all(roles[role] for role in deciding):
        standing = KnowledgeStanding.KNOWS_AND_DOES if success else KnowledgeStanding.KNOWS_AND_DOES_NOT
    else:
        standing = KnowledgeStanding.DOES_WITHOUT_KNOWING if success else KnowledgeStanding.DOES_NOT_KNOW
    return TrialKnowledge(key, label.value, success, standing, roles, deciding, chance)


def _label(label: str, members: Sequence[TrialKnowledge]) -> LabelKnowledge:
    counts = {s.value: sum(t.standing is s for t in members) for s in KnowledgeStanding}
    asked = [t for t in members if t.standing is not KnowledgeStanding.NOT_ASKED]
    chance = sum(t.chance for t in asked) / len(asked) if asked else 0.0
    return LabelKnowledge(label, len(members), counts, chance)
