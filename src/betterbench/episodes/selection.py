"""Which conditions somebody else's loop runs, as its configuration names them."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.errors import UnknownNameError
from betterbench.tasks import get_task, suite_tasks


def select_conditions(names: str | Sequence[str] | None) -> tuple[tuple[str, str], ...]:
    """Return the conditions that a list of names stands for, each once, as pairs of task and condition.

    Args:
        names: Tasks, which stand for all their conditions, and conditions as "task/condition"; all of better60 if None
            or empty. One text may hold several, separated by commas.

    Raises:
        UnknownNameError: If a task or condition is unknown.
    """
    listed = [n.strip() for n in (names.split(",") if isinstance(names, str) else names or ())]
    found: dict[tuple[str, str], None] = {}
    for name in [n for n in listed if n] or suite_tasks("better60"):
        task = get_task(name.partition("/")[0])
        known = (*(c.name for c in task.training), *(v.name for v in task.variations))
        condition = name.partition("/")[2]
        if condition and condition not in known:
            raise UnknownNameError(f"condition of {task.id}", condition, known)
        found |= {(task.id, c): None for c in ([condition] if condition else known)}
    return tuple(found)
