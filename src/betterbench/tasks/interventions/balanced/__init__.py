"""The balanced regime: conditions of the same skills in which words, places, orders and objects are crossed.

One file per task, see :mod:`betterbench.tasks.interventions.listed_regimes`. Slots that no condition of training and no
variation of the task has stand in its ``ASIDE``; nothing is picked there.
"""

from __future__ import annotations

from dataclasses import replace

from betterbench.tasks.authoring.task import Task
from betterbench.tasks.condition import Condition, Slot
from betterbench.tasks.interventions import listed_regimes


def balanced_conditions(task_id: str) -> tuple[Condition, ...]:
    """Return the balanced conditions of a task, named balanced1, balanced2, ...; none if the suite lists none."""
    return listed_regimes.listed_conditions("balanced", task_id)


def crossed(task_id: str) -> tuple[str, ...]:
    """Return what the balanced conditions of a task cross, one line each."""
    return listed_regimes.crossed_in("balanced", task_id)


def slots_aside(task_id: str) -> tuple[Slot, ...]:
    """Return the slots that conditions of listed regimes have and no other condition of the task."""
    module = listed_regimes.listing_of("balanced", task_id)
    slots: tuple[Slot, ...] = getattr(module, "ASIDE", ())
    return slots


def with_slots_of(task: Task, condition: Condition) -> Task:
    """Return a task with the slots aside that a condition uses; the task itself where it uses none."""
    used = tuple(slot for slot in slots_aside(task.id) if slot.name in condition.layout.values())
    return replace(task, slots=(*task.slots, *used)) if used else task
