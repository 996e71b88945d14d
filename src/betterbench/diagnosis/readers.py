"""Readers for the records of a run, with one reader for each kind of world."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from pydantic import TypeAdapter

from betterbench.diagnosis import libero
from betterbench.diagnosis.modes.policy_error import label_without_record, without_record
from betterbench.diagnosis.trial import Reading, read_trial
from betterbench.diagnosis.verdict import OUTCOME_ALONE, Evidence, RunDiagnosis, TrialDiagnosis
from betterbench.errors import RecordError
from betterbench.json_form import open_form, read_form
from betterbench.quoting import shell_word
from betterbench.records import Record, RunFolder
from betterbench.tasks import Expected, TrialId
from betterbench.tasks.interventions.resolve import resolve_condition
from betterbench.tasks.labels import Label
from betterbench.tasks.user_files import options_for
from betterbench.tasks.worlds import facts
from betterbench.tasks.worlds.libero_plus import axis_of
from betterbench.tasks.worlds.libero_training import TrainedTask


class Reader(Protocol):
    """Reads the records of a run, and defines how trials are judged in the simulated world of this run."""

    @property
    def twins_elsewhere(self) -> bool:
        """Whether the twins (training trials with the same seeds) of variation trials may come from a different run."""

    @property
    def finds_favorites(self) -> bool:
        """Whether the diagnosis looks for the policy's favorite kind of object."""

    @property
    def twins_cure(self) -> str:
        """Advice on how to obtain missing twins (training trials with the same seeds), as a clause for a note."""

    def read(self, record: Record, *, path: str | None = None) -> Reading:
        """Diagnose a record on its own, without other trials of the policy (first pass)."""

    def without_record(self, trial: TrialId, policy: str, reason: str | None) -> TrialDiagnosis:
        """Return the diagnosis of a planned trial that has no record."""

    def group(self, task: str) -> str:
        """Return the group of a trial. Decision rules are judged for all trials of a group together.

        This is the task, or the suite if each task of the suite has only one instruction.
        """

    def notes(self, run: RunFolder, found: RunDiagnosis) -> tuple[str, ...]:
        """Return notes about the world of a run."""

    def last_notes(self, trials: Sequence[TrialDiagnosis]) -> tuple[str, ...]:
        """Return advice about further runs that would make the diagnosis more informative."""


class OwnReader:
    """Reads runs in betterbench's own scenes. Their tasks define conditions and training distributions."""

    twins_elsewhere = finds_favorites = False
    twins_cure = "run their training conditions with the same seeds"

    def read(self, record: Record, *, path: str | None = None) -> Reading:
        """Diagnose a record on its own, without other trials of the policy (first pass)."""
        return read_trial(record, path=path)

    def without_record(self, trial: TrialId, policy: str, reason: str | None) -> TrialDiagnosis:
        """Return the diagnosis of a planned trial that has no record."""
        resolved = resolve_condition(trial.task, trial.condition)
        return TrialDiagnosis(
            task=trial.task, variation=None if resolved.variation is None else trial.condition,
            condition=resolved.base, axis=resolved.axis, seed=trial.seed, policy=policy,
            instruction=resolved.condition.instruction.text, success=False,
            expected=resolved.condition.expected.value, label=label_without_record(reason), first_attempt=None,
            first_attempt_kind=None, first_slot=None, intended=None, intended_kind=None, intended_any=(),
            intention_correct=None, progress=0.0, attempts=(), evidence=without_record(reason), collisions=None,
            steps=0, duration_s=0.0, record=None,
        )  # fmt: skip

    def group(self, task: str) -> str:
        """Return the task itself, because a policy's rules are judged separately in each task."""
        return task

    def notes(self, run: RunFolder, found: RunDiagnosis) -> tuple[str, ...]:
        """Return an empty tuple, because runs in betterbench's own scenes need no notes."""
        del run, found
        return ()

    def last_notes(self, trials: Sequence[TrialDiagnosis]) -> tuple[str, ...]:
        """Return an empty tuple, because no other runs would improve the diagnosis in betterbench's own scenes."""
        del trials
        return ()


class LiberoReader(libero.LiberoRun):
    """Reads runs in LIBERO and LIBERO-Plus.

    It reads the goals from task files, and the training data from the base suite.
    """

    twins_elsewhere = finds_favorites = True
    twins_cure = libero.TWINS_CURE

    def group(self, task: str) -> str:
        """Return the suite of a task.

        A policy's rules are judged per suite, because each LIBERO task has only one instruction.
        """
        return libero.suite_of(task)

    def notes(self, run: RunFolder, found: RunDiagnosis) -> tuple[str, ...]:
        """Return notes about the limits of LIBERO's suites and about the variants that were not run."""
        return (libero.NOTE, *_plus_notes(run, found))

    def last_notes(self, trials: Sequence[TrialDiagnosis]) -> tuple[str, ...]:
        """Return a note about further suites to run, if the run contains only base suites."""
        untold = libero.untold_by(trials)
        if not untold:
            return ()
        return (f"A base suite contains only training scenes. To learn why the policy succeeds, {untold}.",)


@dataclass(frozen=True, slots=True)
class OutcomeReader:
    """Reads runs in a world where only the outcome of each trial is judged.

    Attributes:
        title: Name of the world in messages.
        twins_elsewhere: Whether the training twins of a run's variation trials may come from another run.
        finds_favorites: Whether the diagnosis looks for the policy's favorite kind of object.
        twins_cure: Advice on how to obtain missing training twins, as a clause for a note.
    """

    title: str
    twins_elsewhere: bool = False
    finds_favorites: bool = False
    twins_cure: str = OwnReader.twins_cure

    def read(self, record: Record, *, path: str | None = None) -> Reading:
        """Diagnose a record on its own, by its outcome alone (first pass).

        The label is success, policy error if the episode ended early, or timeout.
        """
        m = record.metadata
        text = (
            f"The goal {', '.join(m.subgoal_names)} is not met at the end. betterbench does not judge the cause of "
            f"failures in {self.title}."
        )
        unmet = (Label.TIMEOUT, Evidence(OUTCOME_ALONE, text, float(record.time[-1]), float(record.time[-1])))
        found = libero.by_outcome(record, path, unmet=unmet, condition=m.base_condition or m.condition, axis=m.axis)
        return Reading(found, (), None)

    def without_record(self, trial: TrialId, policy: str, reason: str | None) -> TrialDiagnosis:
        """Return the diagnosis of a planned trial that has no record."""
        return TrialDiagnosis(
            task=trial.task, variation=None, condition=trial.condition, axis=None, seed=trial.seed, policy=policy,
            instruction="", success=False, expected=Expected.SUCCEED.value, label=label_without_record(reason),
            first_attempt=None, first_attempt_kind=None, first_slot=None, intended=None, intended_kind=None,
            intended_any=(), intention_correct=None, progress=0.0, attempts=(), evidence=without_record(reason),
            collisions=None, steps=0, duration_s=0.0, record=None,
        )  # fmt: skip

    def group(self, task: str) -> str:
        """Return the task itself, because a policy's rules are judged separately in each task."""
        return task

    def notes(self, run: RunFolder, found: RunDiagnosis) -> tuple[str, ...]:
        """Return a note which states that only the outcome of each trial is judged."""
        del run, found
        return (facts.outcomes_note(self.title),)

    def last_notes(self, trials: Sequence[TrialDiagnosis]) -> tuple[str, ...]:
        """Return an empty tuple, because no other runs would improve the diagnosis."""
        del trials
        return ()


@open_form
@dataclass(frozen=True, slots=True)
class _WorldTaskForm:
    """Fields of a stored LIBERO task that the diagnosis reads."""

    instruction: str


@open_form
@dataclass(frozen=True, slots=True)
class _WorldForm:
    """Fields of a run's stored world settings that the diagnosis reads."""

    regime: tuple[TrainedTask, ...]
    tasks: dict[str, _WorldTaskForm]


_WORLD = TypeAdapter(_WorldForm)


def reader_of(run: RunFolder) -> Reader:
    """Return the reader for the world of a run.

    Raises:
        RecordError: If the plan of the run lacks data that the reader needs.
    """
    return _READERS[run.world.reading](run)


def _own(run: RunFolder) -> Reader:
    del run
    return OwnReader()


def _libero(run: RunFolder) -> Reader:
    """Return the reader of a run in LIBERO, with the training distribution and the instructions of the run."""
    where, cure = f"{run.path / 'run.json'}: plan.world", "Restore the file, or start the run again"
    form = read_form(_WORLD, run.plan["world"], where=where, cure=cure, raises=RecordError)
    return LiberoReader.of(form.regime, {name: task.instruction for name, task in form.tasks.items()})


def _by_outcomes(run: RunFolder) -> Reader:
    return OutcomeReader(run.world.title)


def _of_chains(run: RunFolder) -> Reader:
    following = f"better compare {shell_word(run.path)}{options_for((), worlds=(run.world.name,))}"
    raise RecordError(
        f"{run.path}: a run in {run.world.title} gets no labels, because the success rules of some subtasks name no "
        f"target. Run `{following}` for the five rates, the average length and the rates "
        "per subtask."
    )


_READERS: Mapping[facts.Reading, Callable[[RunFolder], Reader]] = {
    "conditions": _own,
    "goals": _libero,
    "outcomes": _by_outcomes,
    "chains": _of_chains,
}


def _plus_notes(run: RunFolder, found: RunDiagnosis) -> Iterator[str]:
    """Yield notes for runs in LIBERO-Plus, including a note about the variants that were not run."""
    if not any(axis_of(trial.variation) for trial in found.trials):
        return
    yield libero.PLUS_NOTE
    left_out = run.plan["world"].get("left_out", {})
    if left_out:
        counted = ", ".join(f"{axis} {number}" for axis, number in left_out.items())
        yield f"Variants that were not run, because they need the assets of LIBERO-Plus's authors: {counted}."
