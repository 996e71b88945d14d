"""Balanced training conditions: the same skills with words, slots, orders and objects crossed.

One file per task, see :mod:`betterbench.tasks.interventions.listed_regimes`. Slots that are used neither in training
nor in variations are listed in ``ASIDE``; nothing is picked from these slots.
"""

from __future__ import annotations

from dataclasses import replace

from betterbench.tasks.authoring.task import Task
from betterbench.tasks.condition import Condition, Slot
from betterbench.tasks.interventions import listed_regimes


def balanced_conditions(task_id: str) -> tuple[Condition, ...]:
    """Return a task's balanced conditions, named balanced1, balanced2, ...; empty if the suite lists none."""
    return listed_regimes.listed_conditions("balanced", task_id)


def crossed(task_id: str) -> tuple[str, ...]:
    """Return the crossed factors of a task's balanced conditions, one line each."""
    return listed_regimes.crossed_in("balanced", task_id)


def slots_aside(task_id: str) -> tuple[Slot, ...]:
    """Return the task slots that occur only in hand-written regimes."""
    module = listed_regimes.listing_of("balanced", task_id)
    slots: tuple[Slot, ...] = getattr(module, "ASIDE", ())
    return slots


def with_slots_of(task: Task, condition: Condition) -> Task:
    """Return a task with the additional slots of a condition; the task itself if there are none."""
    used = tuple(slot for slot in slots_aside(task.id) if slot.name in condition.layout.values())
    return replace(task, slots=(*task.slots, *used)) if used else task
