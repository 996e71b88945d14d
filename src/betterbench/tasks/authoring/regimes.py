"""Listed regimes of a task: further sets of conditions for demonstrations, such as one without confounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from betterbench.errors import UnknownNameError
from betterbench.tasks.condition import Condition, Slot

PREFIXES: Mapping[str, str] = {"balanced": "balanced", "diverse-confounded": "diverse"}
"""Prefix of condition names ("balanced1"), by regime."""


@dataclass(frozen=True, slots=True)
class ListedRegime:
    """Conditions of a regime.

    Attributes:
        conditions: Conditions, which the registry names balanced1, diverse1 and so on, in this order.
        crossed: Crossed and tied factors, one line each.
        slots: Slots that only conditions of listed regimes use. Objects are not picked from these slots.
    """

    conditions: tuple[Condition, ...]
    crossed: tuple[str, ...] = ()
    slots: tuple[Slot, ...] = ()


def named_regimes(regimes: Mapping[str, ListedRegime], task: str) -> dict[str, ListedRegime]:
    """Return the regimes of a task with the names of their conditions.

    Raises:
        UnknownNameError: If a regime has another name than those of :data:`PREFIXES`.
    """
    found = {}
    for regime, listed in regimes.items():
        if regime not in PREFIXES:
            raise UnknownNameError("regime", regime, PREFIXES)
        numbered = enumerate(listed.conditions, start=1)
        conditions = tuple(c.with_(task=task, name=f"{PREFIXES[regime]}{i}") for i, c in numbered)
        found[regime] = replace(listed, conditions=conditions)
    return found
