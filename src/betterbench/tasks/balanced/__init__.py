"""The balanced regime: conditions of the same skills in which words, places, orders and objects are crossed.

One file per task lists its conditions by the function ``balanced_TASK`` and says in ``CROSSED`` what they cross. None
of them is a test: no start of a variation occurs together with its instruction, unless training has both too. Slots
that no other condition of the task has stand in ``ASIDE``; nothing is picked there.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
from dataclasses import replace

from betterbench.tasks.condition import Condition, Slot
from betterbench.tasks.task import Task


@functools.cache
def balanced_conditions(task_id: str) -> tuple[Condition, ...]:
    """Return the balanced conditions of a task, named balanced1, balanced2, ...; none if the suite lists none."""
    name = f"{__name__}.{task_id}"
    if not task_id.isidentifier() or importlib.util.find_spec(name) is None:
        return ()
    made = getattr(importlib.import_module(name), f"balanced_{task_id}")()
    return tuple(c.with_(task=task_id, name=f"balanced{i}") for i, c in enumerate(made, start=1))


def crossed(task_id: str) -> tuple[str, ...]:
    """Return what the balanced conditions of a task cross, one line each."""
    if not balanced_conditions(task_id):
        return ()
    lines: tuple[str, ...] = importlib.import_module(f"{__name__}.{task_id}").CROSSED
    return lines


def slots_aside(task_id: str) -> tuple[Slot, ...]:
    """Return the slots that balanced conditions of a task have and no other condition of it."""
    if not balanced_conditions(task_id):
        return ()
    slots: tuple[Slot, ...] = getattr(importlib.import_module(f"{__name__}.{task_id}"), "ASIDE", ())
    return slots


def with_slots_of(task: Task, condition: Condition) -> Task:
    """Return a task with the slots aside that a condition uses; the task itself where it uses none."""
    used = tuple(slot for slot in slots_aside(task.id) if slot.name in condition.layout.values())
    return replace(task, slots=(*task.slots, *used)) if used else task
