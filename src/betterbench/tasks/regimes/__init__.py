"""Listed regimes of the suite, with one package for each regime and one file for each task.

In the file of a task, the function ``balanced_TASK`` or ``diverse_TASK`` returns the conditions. ``CROSSED`` describes
the factors that are crossed or tied to each other, and ``ASIDE`` lists slots that neither training nor variations use.
The conditions do not include tests: the initial scene of a variation never occurs together with its instruction, unless
training contains this pair.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Mapping
from types import ModuleType

from betterbench.tasks.authoring.regimes import PREFIXES, ListedRegime
from betterbench.tasks.authoring.registry import regimes_from
from betterbench.tasks.condition import Condition, Slot

_PACKAGES: Mapping[str, str] = {
    "balanced": "betterbench.tasks.regimes.balanced",
    "diverse-confounded": "betterbench.tasks.regimes.diverse_confounded",
}
"""Package of each regime, with one module for each task of the suite."""


@regimes_from
def written_regimes(task_id: str) -> dict[str, ListedRegime]:
    """Return the regimes of a task that are in separate files, or an empty dict if there are none."""
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


def _module(package: str, task_id: str) -> ModuleType | None:
    name = f"{package}.{task_id}"
    if not task_id.isidentifier() or importlib.util.find_spec(name) is None:
        return None
    return importlib.import_module(name)
