"""Regimes with hand-written lists of conditions: one package per regime, with one file per task.

A task's file lists the conditions in the function ``balanced_TASK`` or ``diverse_TASK``, and the crossed and tied
factors in ``CROSSED``. None of the conditions is a test: a variation's start and instruction never occur together,
unless training contains both.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

from betterbench.tasks.condition import Condition


@dataclass(frozen=True, slots=True)
class _Listing:
    """Location of a regime's hand-written conditions.

    Attributes:
        package: Package with one module per task.
        prefix: Prefix of the function's name and of the condition names.
    """

    package: str
    prefix: str


LISTED: Mapping[str, _Listing] = {
    "balanced": _Listing("betterbench.tasks.interventions.balanced", "balanced"),
    "diverse-confounded": _Listing("betterbench.tasks.interventions.diverse_confounded", "diverse"),
}


@functools.cache
def listed_conditions(regime: str, task_id: str) -> tuple[Condition, ...]:
    """Return a regime's conditions, named balanced1, diverse1 and so on; empty if the task has no such file."""
    module = listing_of(regime, task_id)
    if module is None:
        return ()
    prefix = LISTED[regime].prefix
    made = getattr(module, f"{prefix}_{task_id}")()
    return tuple(c.with_(task=task_id, name=f"{prefix}{i}") for i, c in enumerate(made, start=1))


def every_listed_condition(task_id: str) -> tuple[Condition, ...]:
    """Return a task's conditions in all listed regimes."""
    return tuple(condition for regime in LISTED for condition in listed_conditions(regime, task_id))


def crossed_in(regime: str, task_id: str) -> tuple[str, ...]:
    """Return the crossed and tied factors of a regime's conditions, one line each; empty for other regimes."""
    module = listing_of(regime, task_id)
    lines: tuple[str, ...] = () if module is None else module.CROSSED
    return lines


def listed_tasks(regime: str) -> tuple[str, ...]:
    """Return the tasks with listed conditions of a regime, sorted."""
    package = importlib.import_module(LISTED[regime].package)
    return tuple(sorted(module.name for module in pkgutil.iter_modules(package.__path__)))


def listing_of(regime: str, task_id: str) -> ModuleType | None:
    """Return the module with a regime's conditions of a task, or None."""
    if regime not in LISTED:
        return None
    name = f"{LISTED[regime].package}.{task_id}"
    if not task_id.isidentifier() or importlib.util.find_spec(name) is None:
        return None
    return importlib.import_module(name)
