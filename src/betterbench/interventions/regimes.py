"""Regimes: the sets of conditions that demonstrations are drawn from, for training and for its two control arms."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from betterbench.errors import InvalidInputError
from betterbench.interventions.apply import vary
from betterbench.tasks import Condition, Task
from betterbench.tasks.balanced import balanced_conditions, slots_aside

Regime = Literal["training", "balanced", "covered"]
"""The conditions of the task with their confounds; others of the same skills without them; the test conditions."""


def conditions_of(task: Task, regime: Regime) -> tuple[Condition, ...]:
    """Return the conditions of a task that a regime demonstrates; InvalidInputError if the task has none of it."""
    if regime == "training":
        return task.training
    if regime == "covered":
        return tuple(vary(task, variation)[0] for variation in task.variations)
    found = balanced_conditions(task.id)
    if not found:
        problem = f"{task.id} has no balanced conditions"
        raise InvalidInputError("--regime", problem, "Choose training or covered for it, or name tasks of the suite")
    return found


def in_regime(task: Task, regime: Regime) -> Task:
    """Return a task with conditions and slots of a regime in place of those of training; raises the same."""
    if regime == "training":
        return task
    slots = (*task.slots, *slots_aside(task.id)) if regime == "balanced" else task.slots
    return replace(task, training=conditions_of(task, regime), slots=slots)
