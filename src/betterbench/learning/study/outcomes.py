"""Outcomes of the learners' trials. The findings of a study are computed from them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from pydantic import TypeAdapter

from betterbench.diagnosis import RunDiagnosis
from betterbench.errors import RecordError
from betterbench.json_form import read_form, strict_form
from betterbench.learning.study.plan import PlannedLearner


@strict_form
@dataclass(frozen=True, slots=True)
class TrialOutcome:
    """Outcome of one trial.

    Attributes:
        variation: Variation name; None for a training condition.
        condition: Training condition; for a variation, the condition of its training twin (the training trial with the
            same seed).
        label: Label that the diagnosis gave to the trial.
        intention: Whether the first grasp attempt was at the right object; None if the trial has no record.
        target: Slot or object of the first grasp attempt; None if there was no attempt.
    """

    variation: str | None
    condition: str
    seed: int
    success: bool
    label: str
    intention: bool | None
    target: str | None

    @property
    def twin(self) -> tuple[str, int]:
        """Training condition and seed. A variation trial and its training twin have the same value."""
        return self.condition, self.seed


@dataclass(frozen=True, slots=True)
class LearnerOutcome:
    """Learner with all its trials."""

    learner: PlannedLearner
    trials: tuple[TrialOutcome, ...]

    def of(self, variation: str | None) -> list[TrialOutcome]:
        """Return the trials of a variation. If ``variation`` is None, return the trials of the training conditions."""
        return [t for t in self.trials if t.variation == variation]

    @property
    def varied(self) -> list[TrialOutcome]:
        """Trials of all variations."""
        return [t for t in self.trials if t.variation is not None]

    def pairs(self, variation: str | None = None) -> list[tuple[TrialOutcome, TrialOutcome]]:
        """Return pairs of a training trial and a variation trial with the same seed (the twin and the trial).

        If ``variation`` is None, the trials of all variations are paired.
        """
        trained = {t.twin: t for t in self.of(None)}
        trials = self.varied if variation is None else self.of(variation)
        return [(trained[t.twin], t) for t in trials if t.twin in trained]


_TRIALS = TypeAdapter(tuple[TrialOutcome, ...])


def outcomes_of(diagnosis: RunDiagnosis) -> tuple[TrialOutcome, ...]:
    """Return the outcomes of all trials in a diagnosed run, except for ambiguous trials."""
    return tuple(
        TrialOutcome(
            t.variation,
            t.condition,
            t.seed,
            t.success,
            t.label.value,
            t.intention_correct,
            t.first_slot or t.first_attempt,
        )
        for t in diagnosis.counted_trials
    )


def trials_form(trials: Iterable[TrialOutcome]) -> list[dict[str, Any]]:
    """Return the outcomes as a JSON-serializable list."""
    return [asdict(trial) for trial in trials]


def read_trials(form: object, where: str) -> tuple[TrialOutcome, ...]:
    """Parse trial outcomes from JSON. Raises RecordError if the JSON has another format."""
    return read_form(_TRIALS, form, where=where, cure="Delete the file to evaluate again", raises=RecordError)
