"""Planned trial of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from betterbench.json_form import strict_form
from betterbench.tasks.axes import Expected
from betterbench.tasks.interventions import ResolvedCondition, resolve_condition
from betterbench.tasks.trial_id import TrialId


@strict_form
@dataclass(frozen=True, slots=True)
class Trial:
    """Planned trial.

    Attributes:
        task: Name of the task.
        condition: Name of the condition.
        variation: Name of the variation, or None for a training condition.
        axis: Axis of the variation, or None for a training condition.
        base_condition: Training condition that the variation is made from, or None for a training condition.
        seed: Seed of the trial.
        expected: Behavior that is expected from a policy that understands the instruction.
    """

    task: str
    condition: str
    variation: str | None
    axis: str | None
    base_condition: str | None
    seed: Annotated[int, Field(ge=0)]
    expected: str

    @property
    def ambiguous(self) -> bool:
        """Whether a premise of the instruction is false in this trial.

        If so, the trial is labeled but not part of any rate.
        """
        return self.expected == Expected.AMBIGUOUS.value

    @property
    def id(self) -> TrialId:
        """Identifier of the trial: task, condition and seed."""
        return TrialId(self.task, self.condition, self.seed)

    def resolve(self) -> ResolvedCondition:
        """Return the condition of the trial."""
        return resolve_condition(self.task, self.condition)
