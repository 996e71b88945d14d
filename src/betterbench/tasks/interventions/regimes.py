"""Regimes: sets of conditions for the demonstrations that are used in training and in control experiments."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from betterbench.errors import InvalidInputError
from betterbench.tasks import Condition, Task
from betterbench.tasks.interventions.apply import vary
from betterbench.tasks.interventions.listed_regimes import listed_tasks

Regime = Literal["training", "balanced", "diverse-confounded", "covered"]
"""Name of a regime, i.e. of a set of conditions for demonstrations.

- "training": the task's own training conditions, which contain confounds.
- "balanced": conditions without confounds.
- "diverse-confounded": as many conditions as the regime "balanced", but each word always goes with the same slot.
- "covered": the test conditions.
"""


def conditions_of(task: Task, regime: Regime) -> tuple[Condition, ...]:
    """Return the conditions of a task in a regime.

    Raises:
        InvalidInputError: If the task does not have this regime.
    """
    if regime == "training":
        return task.training
    if regime == "covered":
        return tuple(vary(task, variation)[0] for variation in task.variations)
    if regime not in task.regimes:
        problem = f"{task.id} has no {regime} conditions"
        cure = f"Use training or covered, or name tasks that have this regime: {', '.join(listed_tasks(regime))}"
        raise InvalidInputError("--regime", problem, cure)
    return task.regimes[regime].conditions


def in_regime(task: Task, regime: Regime) -> Task:
    """Return a copy of a task with the training conditions and slots of a regime.

    Raises:
        InvalidInputError: If the task does not have this regime.
    """
    if regime == "training":
        return task
    listed = task.regimes.get(regime)
    slots = task.slots if listed is None else (*task.slots, *listed.slots)
    return replace(task, training=conditions_of(task, regime), slots=slots)
