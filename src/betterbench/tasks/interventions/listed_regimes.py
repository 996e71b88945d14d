"""Lookup of listed regimes by name, in the ``regimes`` field of a task."""

from __future__ import annotations

from betterbench.tasks.authoring.regimes import PREFIXES
from betterbench.tasks.authoring.registry import all_tasks, get_task
from betterbench.tasks.condition import Condition

LISTED: tuple[str, ...] = tuple(PREFIXES)
"""Names of the listed regimes."""


def listed_conditions(regime: str, task_id: str) -> tuple[Condition, ...]:
    """Return the conditions of a task in a listed regime. They are named balanced1, diverse1 and so on.

    The result is empty if the task does not have this regime.
    """
    listed = get_task(task_id).regimes.get(regime)
    return () if listed is None else listed.conditions


def every_listed_condition(task_id: str) -> tuple[Condition, ...]:
    """Return the conditions of a task in all listed regimes together."""
    return tuple(condition for listed in get_task(task_id).regimes.values() for condition in listed.conditions)


def crossed_in(regime: str, task_id: str) -> tuple[str, ...]:
    """Return descriptions of the factors that are crossed or tied together in a regime's conditions, one per line.

    The result is empty if the task does not have this regime.
    """
    listed = get_task(task_id).regimes.get(regime)
    return () if listed is None else listed.crossed


def listed_tasks(regime: str) -> tuple[str, ...]:
    """Return the tasks that have a listed regime, sorted by id."""
    return tuple(task.id for task in all_tasks() if regime in task.regimes)
