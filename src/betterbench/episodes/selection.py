"""Selection of conditions by name, for evaluation loops outside betterbench."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.tasks import get_task, suite_tasks
from betterbench.tasks.interventions import condition_names, resolve_condition


def select_conditions(names: str | Sequence[str] | None) -> tuple[tuple[str, str], ...]:
    """Return the conditions selected by names, as pairs (task, condition) without duplicates.

    The name of a task selects all its conditions, and "task/condition" selects a single condition. A string may contain
    several names, separated by commas. Without names, all conditions of the suite better60 are selected. Raises
    UnknownNameError for an unknown name.
    """
    listed = [n.strip() for n in (names.split(",") if isinstance(names, str) else names or ())]
    found: dict[tuple[str, str], None] = {}
    for name in [n for n in listed if n] or suite_tasks("better60"):
        task_id, _, condition = name.partition("/")
        if condition:
            resolve_condition(task_id, condition)
        chosen = [condition] if condition else condition_names(get_task(task_id))
        found |= {(task_id, c): None for c in chosen}
    return tuple(found)
