"""A planned trial."""

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
    """Planned trial. ``variation``, ``axis`` and ``base_condition`` are None for a training condition."""

    task: str
    condition: str
    variation: str | None
    axis: str | None
    base_condition: str | None
    seed: Annotated[int, Field(ge=0)]
    expected: str

    @property
    def ambiguous(self) -> bool:
        """Whether the premise is broken, so that the trial is labeled but excluded from all rates."""
        return self.expected == Expected.AMBIGUOUS.value

    @property
    def id(self) -> TrialId:
        """Task, condition and seed."""
        return TrialId(self.task, self.condition, self.seed)

    def resolve(self) -> ResolvedCondition:
        """Return the trial's condition."""
        return resolve_condition(self.task, self.condition)
