"""Lookup of balanced training conditions, and of the slots that only listed regimes use."""

from __future__ import annotations

from dataclasses import replace

from betterbench.tasks.authoring.registry import get_task
from betterbench.tasks.authoring.task import Task
from betterbench.tasks.condition import Condition, Slot
from betterbench.tasks.interventions import listed_regimes


def balanced_conditions(task_id: str) -> tuple[Condition, ...]:
    """Return the balanced conditions of a task (balanced1, balanced2, ...), or an empty tuple if the task has none."""
    return listed_regimes.listed_conditions("balanced", task_id)


def crossed(task_id: str) -> tuple[str, ...]:
    """Return descriptions of the factors that are crossed in a task's balanced conditions, one per line."""
    return listed_regimes.crossed_in("balanced", task_id)


def slots_aside(task_id: str) -> tuple[Slot, ...]:
    """Return the slots of a task that are used only in its listed regimes."""
    return _aside(get_task(task_id))


def _aside(task: Task) -> tuple[Slot, ...]:
    return tuple({slot.name: slot for listed in task.regimes.values() for slot in listed.slots}.values())


def with_slots_of(task: Task, condition: Condition) -> Task:
    """Return the task with the extra slots that a condition uses, or the unchanged task if it uses none."""
    used = tuple(slot for slot in _aside(task) if slot.name in condition.layout.values())
    return replace(task, slots=(*task.slots, *used)) if used else task
