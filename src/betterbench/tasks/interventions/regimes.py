"""Regimes: sets of conditions for demonstrations in training and in control experiments."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from betterbench.errors import InvalidInputError
from betterbench.tasks import Condition, Task
from betterbench.tasks.interventions.apply import vary
from betterbench.tasks.interventions.listed_regimes import listed_tasks

Regime = Literal["training", "balanced", "diverse-confounded", "covered"]
""""training": the task's own training conditions with confounds.

"balanced": conditions without confounds. "diverse-confounded": as many conditions as in "balanced", with each word tied
to its slot. "covered": the test conditions.
"""


def conditions_of(task: Task, regime: Regime) -> tuple[Condition, ...]:
    """Return a task's conditions in a regime. Raises InvalidInputError if the task does not have the regime."""
    if regime == "training":
        return task.training
    if regime == "covered":
        return tuple(vary(task, variation)[0] for variation in task.variations)
    if regime not in task.regimes:
        problem = f"{task.id} has no {regime} conditions"
        cure = f"Choose training or covered for it, or give tasks that have them: {', '.join(listed_tasks(regime))}"
        raise InvalidInputError("--regime", problem, cure)
    return task.regimes[regime].conditions


def in_regime(task: Task, regime: Regime) -> Task:
    """Return a task with a regime's conditions and slots. Raises InvalidInputError if the task lacks the regime."""
    if regime == "training":
        return task
    listed = task.regimes.get(regime)
    slots = task.slots if listed is None else (*task.slots, *listed.slots)
    return replace(task, training=conditions_of(task, regime), slots=slots)
