"""The form of a relation: where an object is with respect to a target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from betterbench.state import ObjectInfo, WorldState


@dataclass(frozen=True, slots=True)
class Relation:
    """A relation between an object and a target that may offer several places.

    Attributes:
        name: Identifier ("inside", "beside").
        where: ``where(state, object, target)`` returns the name of the place of the target at which the object is,
            "" if the target offers just one, or None if the object is at none.
        places: Places that an object offers as a target of this relation; none if it cannot be one.
        roles: Roles of the objects that can stand in this relation.
    """

    name: str
    where: Callable[[WorldState, str, str], str | None]
    places: Callable[[ObjectInfo], tuple[str, ...]]
    roles: tuple[str, ...] = ("item", "distractor")

    def holds(self, state: WorldState, name: str, target: str, region: str = "") -> bool:
        """Tell whether an object is at a place of a target."""
        return self.where(state, name, target) == region

    def label(self, name: str, target: str, region: str = "") -> str:
        """Return the name of a predicate: "inside(burger_1, box)", "in_hole(salt, rack.hole_1)"."""
        return f"{self.name}({name}, {target}{'.' if region else ''}{region})"


def one_place(test: Callable[[WorldState, str, str], bool]) -> Callable[[WorldState, str, str], str | None]:
    """Return the ``where`` of a relation whose targets offer a single place."""

    def where(state: WorldState, name: str, target: str) -> str | None:
        return "" if test(state, name, target) else None

    return where


def offers(*regions: str) -> Callable[[ObjectInfo], tuple[str, ...]]:
    """Return the ``places`` of a relation whose targets offer a single place and have all of these regions."""

    def places(info: ObjectInfo) -> tuple[str, ...]:
        return ("",) if set(regions) <= {r.name for r in info.regions} else ()

    return places
