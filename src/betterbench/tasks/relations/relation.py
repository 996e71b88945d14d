"""Relations between an object and a target, and the registry of all relations."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from betterbench.errors import PlanningError, find_named
from betterbench.geometry import Pose, Vector
from betterbench.interface.state import ObjectInfo, Region, WorldState
from betterbench.tasks.relations.rest import on_floor


@dataclass(frozen=True, slots=True)
class PlaceGoal:
    """A pose at which an object is released, and its approach direction.

    Attributes:
        pose: Release pose ``T_world_object``.
        approach: Displacement [m], world frame, from the release pose to the start of the straight approach.
        release_width_m: Gripper opening at the release [m], or None for the full opening.
        alike: Adjacent goals in a list with the same number are equally good, and the expert may use any of them, or
            None for a goal with a fixed rank.
    """

    pose: Pose
    approach: Vector = (0.0, 0.0, 0.08)
    release_width_m: float | None = None
    alike: float | None = None


SHARED = "+"
"""Separator between the names of overlapping regions in the result of ``where``."""


def is_at(place: str | None, region: str) -> bool:
    """Return whether the result of ``where`` includes a region. The result lists all overlapping regions."""
    return place == region or (place is not None and SHARED in place and region in place.split(SHARED))


Where = Callable[[WorldState, str, str], str | None]
Regions = Callable[[ObjectInfo], tuple[str, ...]]
Goals = Callable[[WorldState, str, str, str], tuple[PlaceGoal, ...]]
Surface = Callable[[Mapping[str, Region], str], Vector]


@dataclass(frozen=True, slots=True, kw_only=True)
class Relation:
    """Relation between an object and a target, with the data for judging, planning and documents.

    Attributes:
        name: Identifier ("inside", "beside").
        words: Text for documents, such as "{object} is inside {target}". It contains ``{region}`` if the target has
            several regions.
        where: ``where(state, object, target)`` returns the name of the target region that contains the object, "" if
            the target has only one region, or None if the object is in none. For overlapping regions, it returns all
            their names joined by "+" (see :func:`is_at`).
        loosely: Like ``where``, but for an object in any posture, such as leaning, jammed, on its side, half in, on top
            or held there. It is used after ``where`` returns None, to check that the target is free of an object. It is
            None if ``where`` covers every posture.
        regions: Function that returns the names of an object's target regions. It is empty if the object cannot be a
            target.
        needs: Required regions in a target's asset. All of them are required, or any of them if the target has several
            regions.
        tolerances: Names of the thresholds in ``where``, apart from the rest and posture thresholds.
        goals: ``goals(state, object, target, region)`` returns the poses at which a held object satisfies the relation,
            starting with the best. It is None if the object is not carried but slides in its mount.
        surface: ``surface(regions, region)`` returns the center of the surface on which objects rest [m], in the frame
            of the object that has these regions, or None if objects cannot be pre-placed.
        roles: Roles of the objects that can have this relation.
        counted: Whether the target region depends on objects already there, as for the layer of a stack.
        falls: Whether an object may be dropped into the target.
    """

    name: str
    words: str
    where: Where
    regions: Regions
    needs: tuple[str, ...]
    loosely: Where | None = None
    tolerances: tuple[str, ...] = ()
    goals: Goals | None = None
    surface: Surface | None = None
    roles: tuple[str, ...] = ("item", "distractor")
    counted: bool = False
    falls: bool = False
    wide: bool = False

    @property
    def carried(self) -> bool:
        """Whether the relation is established by carrying the object, as opposed to moving it along its rail."""
        return self.goals is not None

    def holds(self, state: WorldState, name: str, target: str, region: str = "") -> bool:
        """Return whether an object is in a target region."""
        return is_at(self.where(state, name, target), region)

    def anyhow(self, state: WorldState, name: str, target: str) -> str | None:
        """Return the target region of an object, strictly or in any other posture, or None."""
        place = self.where(state, name, target)
        return place if place is not None or self.loosely is None else self.loosely(state, name, target)

    def brought(self, state: WorldState, name: str, target: str) -> str | None:
        """Return the target region to which an object was brought against the instruction, in any posture, or None."""
        return (
            self.anyhow(state, name, target)
            if self.loosely is None or not self.wide
            else self.loosely(state, name, target)
        )

    def label(self, name: str, target: str, region: str = "") -> str:
        """Return the name of a predicate, such as "inside(burger_1, box)" or "in_hole(salt, rack.hole_1)"."""
        return f"{self.name}({name}, {target}{'.' if region else ''}{region})"

    def middle(self, target: ObjectInfo, region: str) -> Vector:
        """Return the center of a target region in the target's frame [m], or its origin if it has no surface."""
        if self.surface is None:
            return (0.0, 0.0, 0.0)
        return self.surface({r.name: r for r in target.regions}, region)

    def place_goals(self, state: WorldState, name: str, target: str, region: str) -> tuple[PlaceGoal, ...]:
        """Return the poses at which an object satisfies the relation, best first.

        Raises:
            PlanningError: If the relation is not established by carrying.
        """
        if self.goals is None:
            raise PlanningError(f"{self.name} is not established by carrying an object")
        return self.goals(state, name, target, region)


RELATIONS: dict[str, Relation] = {}
"""All relations by name."""


def register(relation: Relation) -> Relation:
    """Add a relation to the registry, and return it as registered.

    In every relation, a target on the floor no longer counts as a target, and an object on the floor is not at a
    target. This rule is implemented only here.

    Raises:
        ValueError: If another relation has the same name.
    """
    if relation.name in RELATIONS:
        raise ValueError(f"the relation {relation.name!r} already exists: {RELATIONS[relation.name].words}")
    loosely = None if relation.loosely is None else _on_the_table(relation.loosely)
    relation = replace(relation, where=_on_the_table(relation.where), loosely=loosely)
    RELATIONS[relation.name] = relation
    return relation


def _on_the_table(where: Where) -> Where:
    """Return a ``where`` that returns None for objects and targets on the floor."""

    def guarded(state: WorldState, name: str, target: str) -> str | None:
        place = where(state, name, target)
        return None if place is None or on_floor(state, name) or on_floor(state, target) else place

    return guarded


def relation(name: str) -> Relation:
    """Return a relation by name.

    Raises:
        UnknownNameError: If the relation does not exist.
    """
    return find_named("relation", name, RELATIONS.values())


def single(test: Callable[[WorldState, str, str], bool]) -> Where:
    """Return the ``where`` function for a relation whose targets have only one region."""

    def where(state: WorldState, name: str, target: str) -> str | None:
        return "" if test(state, name, target) else None

    return where


def offers(*names: str) -> Regions:
    """Return the ``regions`` function for a relation whose targets have one region and all of these asset regions."""

    def regions(info: ObjectInfo) -> tuple[str, ...]:
        return ("",) if set(names) <= {r.name for r in info.regions} else ()

    return regions


def offers_each(*names: str) -> Regions:
    """Return the ``regions`` function for a relation whose targets have any of these asset regions."""

    def regions(info: ObjectInfo) -> tuple[str, ...]:
        return tuple(r.name for r in info.regions if r.name in names)

    return regions


def surface_of(*names: str) -> Surface:
    """Return the ``surface`` function for a relation whose objects rest on the first existing asset region.

    Without names, the target region itself is the surface.
    """

    def surface(regions: Mapping[str, Region], region: str) -> Vector:
        return regions[next((name for name in names if name in regions), region)].position

    return surface
