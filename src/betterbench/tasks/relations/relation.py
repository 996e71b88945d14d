"""Relations between an object and a target, and the registry of all relations."""

import string
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

from betterbench.errors import (
    InvalidInputError,
    Place,
    PlanningError,
    UnknownNameError,
    find_named,
    name_taken,
    registering_place,
    require_parameters,
)
from betterbench.geometry import Pose, Vector
from betterbench.interface.state import ObjectInfo, Region, WorldState
from betterbench.tasks.relations.rest import on_floor
from betterbench.tasks.thresholds import threshold_table


@dataclass(frozen=True, slots=True)
class PlaceGoal:
    """Pose of an object when it is released, with the direction of the approach.

    Attributes:
        pose: Pose ``T_world_object`` at the release.
        approach: Displacement from the release pose to the start of the straight approach, in the world frame [m].
        release_width_m: Opening of the gripper at the release [m], or None for the full opening.
        alike: Number shared by equally good goals. If adjacent goals in a list have the same number, the expert may use
            any of them. None for a goal with a fixed rank.
    """

    pose: Pose
    approach: Vector = (0.0, 0.0, 0.08)
    release_width_m: float | None = None
    alike: float | None = None


SHARED = "+"
"""Text between the names of overlapping regions in the result of ``where``."""


def is_at(place: str | None, region: str) -> bool:
    """Return whether a result of ``where`` includes a region. If regions overlap, the result names all of them."""
    return place == region or (place is not None and SHARED in place and region in place.split(SHARED))


Where = Callable[[WorldState, str, str], str | None]
Regions = Callable[[ObjectInfo], tuple[str, ...]]
Goals = Callable[[WorldState, str, str, str], tuple[PlaceGoal, ...]]
Surface = Callable[[Mapping[str, Region], str], Vector]


@dataclass(frozen=True, slots=True, kw_only=True)
class Relation:
    """Relation between an object and a target, with the data that judging, planning and documents need.

    Attributes:
        name: Identifier ("inside", "beside").
        words: Text for documents, such as "{object} is inside {target}". It contains ``{region}`` if the target has
            several regions.
        where: ``where(state, object, target)`` returns the name of the target region that contains the object, or "" if
            the target has only one region. It returns None if the object is in no region. If regions overlap, it
            returns the names of all of them, joined by "+" (see :func:`is_at`).
        regions: Function that returns the names of an object's target regions. The result is empty if the object cannot
            be a target.
        needs: Regions that the asset of a target must have. If a target has several regions, one of them is enough.
        loosely: Like ``where``, but for an object in any posture, such as leaning, jammed, on its side, half in, on top
            or held there. It is called when ``where`` has returned None, to check that the object is really not at the
            target. It is None if ``where`` already covers every posture.
        tolerances: Names of the thresholds that ``where`` uses, except for the thresholds of rest and posture.
        goals: ``goals(state, object, target, region)`` returns the poses where a held object satisfies the relation,
            best first. It is None if the object is not carried, because it slides in its mount.
        surface: ``surface(regions, region)`` returns the center of the surface that objects rest on, in the frame of
            the object that has these regions [m]. It is None if objects cannot start at the target.
        roles: Roles of the objects that can have this relation to a target.
        counted: Whether the region depends on the objects that are already at the target, as for the layers of a stack.
        falls: Whether an object may be dropped into the target.
        wide: Whether the regions are so wide that an object may be in one without having been brought there.
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
        """Whether the relation is established by carrying the object.

        Otherwise, the object moves along a rail, like a drawer.
        """
        return self.goals is not None

    def holds(self, state: WorldState, name: str, target: str, region: str = "") -> bool:
        """Return whether an object is in a region of a target."""
        return is_at(self.where(state, name, target), region)

    def anyhow(self, state: WorldState, name: str, target: str) -> str | None:
        """Return the target region that contains an object in any posture, or None."""
        place = self.where(state, name, target)
        return place if place is not None or self.loosely is None else self.loosely(state, name, target)

    def brought(self, state: WorldState, name: str, target: str) -> str | None:
        """Return the target region to which an object was wrongly brought, in any posture, or None."""
        return (
            self.anyhow(state, name, target)
            if self.loosely is None or not self.wide
            else self.loosely(state, name, target)
        )

    def label(self, name: str, target: str, region: str = "") -> str:
        """Return the name of the predicate, such as "inside(burger_1, box)" or "in_hole(salt, rack.hole_1)"."""
        return f"{self.name}({name}, {target}{'.' if region else ''}{region})"

    def middle(self, target: ObjectInfo, region: str) -> Vector:
        """Return the center of a target region in the frame of the target [m].

        If the relation has no surface, this is the origin of the target.
        """
        if self.surface is None:
            return (0.0, 0.0, 0.0)
        return self.surface({r.name: r for r in target.regions}, region)

    def place_goals(self, state: WorldState, name: str, target: str, region: str) -> tuple[PlaceGoal, ...]:
        """Return the poses where an object satisfies the relation, best first.

        Raises:
            PlanningError: If the relation is not established by carrying the object.
        """
        if self.goals is None:
            raise PlanningError(f"the relation {self.name} is not established by carrying an object")
        return self.goals(state, name, target, region)


RELATIONS: dict[str, Relation] = {}
"""All relations by name."""

_REGISTERED_AT: dict[str, Place] = {}


def register(relation: Relation) -> Relation:
    """Add a relation to the registry, and return the registered relation.

    One rule is added to every registered relation: a target on the floor no longer counts as a target, and an object on
    the floor is not at any target. This rule is implemented only here.

    Raises:
        InvalidInputError: If there is already a relation with this name, or a field has an invalid value.
        UnknownNameError: If a tolerance is not the name of a threshold.
    """
    here = registering_place()
    if relation.name in RELATIONS:
        raise name_taken(f"relation {relation.name!r}", _REGISTERED_AT[relation.name], here)
    _require_complete(relation)
    loosely = None if relation.loosely is None else _on_the_table(relation.loosely, relation.name)
    relation = replace(relation, where=_on_the_table(relation.where, relation.name), loosely=loosely)
    RELATIONS[relation.name] = relation
    _REGISTERED_AT[relation.name] = here
    return relation


def places_of_relations() -> Collection[Place]:
    """Return the places at which relations have been registered."""
    return _REGISTERED_AT.values()


_FUNCTIONS = {
    "where": ("state, object, target", "Use where=single(test) for a test that returns True or False"),
    "loosely": ("state, object, target", 'Return the name of a region, "" or None, as where does'),
    "regions": ("info", 'Use regions=offers("top"), or offers_each("left", "right")'),
    "goals": ("state, object, target, region", "Return a tuple of PlaceGoal"),
    "surface": ("regions, region", 'Use surface=surface_of("top")'),
}
"""Parameters of each function of a relation, and advice for messages."""


def _require_complete(relation: Relation) -> None:
    """Raise InvalidInputError or UnknownNameError if a field of a relation has an invalid value."""
    title = f"relation {relation.name}"
    for name, (parameters, advice) in _FUNCTIONS.items():
        function = getattr(relation, name)
        if function is None and name in ("loosely", "goals", "surface"):
            continue
        if not callable(function):
            raise InvalidInputError(title, f"{name} is not a function, but {function!r}", advice)
        require_parameters(title, name, function, parameters)
    if getattr(relation.where, "__annotations__", {}).get("return") in (bool, "bool"):
        raise InvalidInputError(title, "where returns True or False, not a region", _FUNCTIONS["where"][1])
    fields = [field for _, field, *_ in string.Formatter().parse(relation.words) if field is not None]
    if not {"object", "target"} <= set(fields) <= {"object", "target", "region"}:
        cure = 'Write a phrase such as "{object} stands on {target}", with {region} if a target has several regions'
        raise InvalidInputError(title, f"words is {relation.words!r}", cure)
    for name in ("needs", "tolerances", "roles"):
        if not isinstance(getattr(relation, name), tuple):
            problem = f"{name} must be a tuple of names, got {getattr(relation, name)!r}"
            raise InvalidInputError(title, problem, f'Write {name}=("NAME",), with a comma')
    known = {entry.name for entry in threshold_table()}
    for name in relation.tolerances:
        if name not in known:
            raise UnknownNameError(f"threshold in the tolerances of the relation {relation.name}", name, known)
    needed = tuple(Region(name, (0.0, 0.0, 0.0), (0.01, 0.01, 0.01)) for name in relation.needs)
    targets = [
        ObjectInfo("target", "", "", "", "", "", role, False, 1.0, (0.1, 0.1, 0.1), regions=needed)
        for role in ("container", "fixture", "drawer", "item")
    ]
    if needed and not any(map(relation.regions, targets)):
        problem = f"an asset with the regions in needs ({', '.join(relation.needs)}) is not a target for regions"
        raise InvalidInputError(title, problem, "Name the same regions in needs and in regions")
    if relation.goals is None and relation.roles != ("drawer",):
        problem = "it has no goals, so the expert cannot achieve it"
        raise InvalidInputError(title, problem, 'Give goals, or roles=("drawer",) for objects that slide in a mount')


def _on_the_table(where: Where, relation: str) -> Where:
    """Return a variant of ``where`` that returns None if the object or the target is on the floor."""

    def guarded(state: WorldState, name: str, target: str) -> str | None:
        place = where(state, name, target)
        if place is None:
            return None
        found: object = place
        if not isinstance(found, str):
            problem = f"where or loosely returned {found!r}, not the name of a region, an empty text or None"
            raise InvalidInputError(f"relation {relation}", problem, _FUNCTIONS["where"][1])
        return None if on_floor(state, name) or on_floor(state, target) else place

    return guarded


def relation(name: str) -> Relation:
    """Return a relation by its name.

    Raises:
        UnknownNameError: If there is no such relation.
    """
    return find_named("relation", name, RELATIONS.values())


def single(test: Callable[[WorldState, str, str], bool]) -> Where:
    """Convert a test with a boolean result to the ``where`` function of a relation with single-region targets.

    Raises:
        InvalidInputError: If the test is not a function of a state, an object and a target.
    """
    given: object = test
    if not callable(given):
        advice = "Pass the name of the test, without parentheses"
        raise InvalidInputError("single(test)", f"the test is not a function, but {given!r}", advice)
    require_parameters(f"single({getattr(test, '__name__', 'test')})", "test", test, _FUNCTIONS["where"][0])

    def where(state: WorldState, name: str, target: str) -> str | None:
        return "" if test(state, name, target) else None

    return where


def offers(*names: str) -> Regions:
    """Return the ``regions`` function of a relation whose targets have a single region.

    An object is a target if its asset has all of the named regions.
    """

    def regions(info: ObjectInfo) -> tuple[str, ...]:
        return ("",) if set(names) <= {r.name for r in info.regions} else ()

    return regions


def offers_each(*names: str) -> Regions:
    """Return the ``regions`` function of a relation. Each of the named asset regions is a target region."""

    def regions(info: ObjectInfo) -> tuple[str, ...]:
        return tuple(r.name for r in info.regions if r.name in names)

    return regions


def surface_of(*names: str) -> Surface:
    """Return the ``surface`` function of a relation whose objects rest on a region of the target's asset.

    The objects rest on the first of the named asset regions that the asset has. If no names are given, they rest on the
    target region itself.
    """

    def surface(regions: Mapping[str, Region], region: str) -> Vector:
        return regions[next((name for name in names if name in regions), region)].position

    return surface
