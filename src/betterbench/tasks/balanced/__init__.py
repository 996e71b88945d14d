"""The balanced regime: conditions of the same skills in which words, places, orders and objects are crossed.

One file per task lists its conditions by the function ``balanced_TASK`` and says in ``CROSSED`` what they cross. None
of them is a test: no start of a variation occurs together with its instruction, unless training has both too.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util

from betterbench.tasks.condition import Condition


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
