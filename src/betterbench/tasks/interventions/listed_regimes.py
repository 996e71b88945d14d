"""Listed regimes of tasks: look-up by the name of the regime, and the files with those of the suite.

A task has its listed regimes in the field ``regimes``. Those of the suite are written in one package per regime, with
one file per task: the file lists the conditions in the function ``balanced_TASK`` or ``diverse_TASK``, the crossed and
tied factors in ``CROSSED``, and slots that neither training nor variations use in ``ASIDE``. None of the conditions is
a test: a variation's start and instruction never occur together, unless training contains both.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Mapping
from types import ModuleType

from betterbench.tasks.authoring.regimes import PREFIXES, ListedRegime
from betterbench.tasks.authoring.registry import all_tasks, get_task, regimes_from
from betterbench.tasks.condition import Condition, Slot

LISTED: tuple[str, ...] = tuple(PREFIXES)
"""Names of the listed regimes."""

_PACKAGES: Mapping[str, str] = {
    "balanced": "betterbench.tasks.interventions.balanced",
    "diverse-confounded": "betterbench.tasks.interventions.diverse_confounded",
}
"""Packages with one module per task of the suite, by the name of the regime."""


@regimes_from
def written_regimes(task_id: str) -> dict[str, ListedRegime]:
    """Return the regimes of a task that are written in files of their own; empty for other tasks."""
    modules = {regime: _module(package, task_id) for regime, package in _PACKAGES.items()}
    aside: dict[str, Slot] = {slot.name: slot for m in modules.values() for slot in getattr(m, "ASIDE", ())}
    found = {}
    for regime, module in modules.items():
        if module is not None:
            conditions: tuple[Condition, ...] = tuple(getattr(module, f"{PREFIXES[regime]}_{task_id}")())
            used = {name for condition in conditions for name in condition.layout.values()}
            slots = tuple(slot for name, slot in aside.items() if name in used)
            found[regime] = ListedRegime(conditions, module.CROSSED, slots)
    return found


def listed_conditions(regime: str, task_id: str) -> tuple[Condition, ...]:
    """Return the conditions of a regime, named balanced1, diverse1 and so on; empty if the task does not have it."""
    listed = get_task(task_id).regimes.get(regime)
    return () if listed is None else listed.conditions


def every_listed_condition(task_id: str) -> tuple[Condition, ...]:
    """Return the conditions of a task in all listed regimes."""
    return tuple(condition for listed in get_task(task_id).regimes.values() for condition in listed.conditions)


def crossed_in(regime: str, task_id: str) -> tuple[str, ...]:
    """Return the crossed and tied factors of a regime's conditions, one line each; empty for other regimes."""
    listed = get_task(task_id).regimes.get(regime)
    return () if listed is None else listed.crossed


def listed_tasks(regime: str) -> tuple[str, ...]:
    """Return the tasks that have a listed regime, sorted."""
    return tuple(task.id for task in all_tasks() if regime in task.regimes)


def _module(package: str, task_id: str) -> ModuleType | None:
    name = f"{package}.{task_id}"
    if not task_id.isidentifier() or importlib.util.find_spec(name) is None:
        return None
    return importlib.import_module(name)
