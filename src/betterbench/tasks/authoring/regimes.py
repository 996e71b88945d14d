"""Listed regimes of a task: additional sets of conditions for demonstrations, such as a set without confounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from betterbench.errors import UnknownNameError
from betterbench.tasks.condition import Condition, Slot

PREFIXES: Mapping[str, str] = {"balanced": "balanced", "diverse-confounded": "diverse"}
"""Beginning of the condition names in each regime ("balanced1")."""


@dataclass(frozen=True, slots=True)
class ListedRegime:
    """Conditions of a listed regime.

    Attributes:
        conditions: The conditions. The registry names them balanced1, diverse1 and so on, in this order.
        crossed: Descriptions of the factors that are crossed and the factors that are tied to each other, one per line.
        slots: Slots that are used only in listed regimes. Objects are not picked from these slots.
    """

    conditions: tuple[Condition, ...]
    crossed: tuple[str, ...] = ()
    slots: tuple[Slot, ...] = ()


def named_regimes(regimes: Mapping[str, ListedRegime], task: str) -> dict[str, ListedRegime]:
    """Return the regimes of a task, with names for the conditions in them.

    Raises:
        UnknownNameError: If the name of a regime is not a key of :data:`PREFIXES`.
    """
    found = {}
    for regime, listed in regimes.items():
        if regime not in PREFIXES:
            raise UnknownNameError("regime", regime, PREFIXES)
        numbered = enumerate(listed.conditions, start=1)
        conditions = tuple(c.with_(task=task, name=f"{PREFIXES[regime]}{i}") for i, c in numbered)
        found[regime] = replace(listed, conditions=conditions)
    return found
