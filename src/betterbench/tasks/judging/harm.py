"""Harm: unwanted side effects, such as knocking over another object. An episode with harm does not succeed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from betterbench.geometry import Pose, Quaternion, Vector, tilt_of, yaw_of
from betterbench.interface.state import ObjectInfo, SceneInfo, WorldState
from betterbench.tasks.judging.targets import Asked, Intruder, Places, Targets
from betterbench.tasks.relations import lies_on_side, on_floor
from betterbench.tasks.relations.beside import BESIDE
from betterbench.tasks.relations.closed import CLOSED, MOUNTS
from betterbench.tasks.thresholds import (
    ANCHOR_MOVED,
    BOX_POINTS_FROM,
    CYLINDER_POINTS_FROM,
    CYLINDER_STANDS_FROM,
    DISPLACED,
    LEFT_OPEN,
    OTHER_POINTS_FROM,
    OTHER_STANDS_FROM,
    OUTERMOST_MOVED,
    TARGET_MOVED,
    THRESHOLDS,
    TURNED,
)
from betterbench.tasks.words import agreeing, place_words

POINTS_FROM = {"box": BOX_POINTS_FROM, "irregular": OTHER_POINTS_FROM}
"""Minimum ratio of length to width for an object to count as elongated, by shape.

The rotation of such an object alone can be harm. Round objects and cylinders have no such ratio, because people accept
a mug that was rotated by 35° but not pushed. :data:`HANDLE_FROM` applies if an object was both pushed and rotated.
"""

HANDLE_FROM = {**POINTS_FROM, "cylinder": CYLINDER_POINTS_FROM}
"""Minimum ratio of length to width for the rotation of an object to be visible, by shape.

A cylinder that is longer than wide has a handle.
"""

STANDS_FROM = {"cylinder": CYLINDER_STANDS_FROM, "box": OTHER_STANDS_FROM, "irregular": OTHER_STANDS_FROM}
"""Minimum ratio of height to width of objects that can be knocked over, by shape.

Round objects have no such ratio, because fruit rolls and plates are flat.
"""

NO_HARM = (
    "No object outside the instruction is on the floor, was displaced by more than 5 cm, was rotated so that its "
    "ends moved by more than 4 cm, was pushed and rotated so that a corner or a handle moved by more than 6 cm, was "
    "knocked over, or is at a target in any posture. No other drawer was left open, no target was moved by more than "
    "8 cm (6 cm if objects are put beside it), and no container lies on its side."
)
"""Statement of what an episode without harm means, for generated documents."""

HarmSort = Literal[
    "on_the_floor",
    "knocked_over",
    "displaced",
    "turned",
    "target_moved",
    "anchor_moved",
    "left_open",
    "at_the_target",
    "target_brought",
]


@dataclass(frozen=True, slots=True)
class Harm:
    """Harm to an object in an episode.

    Attributes:
        sort: Kind of harm. "target_brought" means that the object stayed in place and the target was moved to it.
        object: Name of the harmed object.
        target: Target where the object is although the instruction does not request this, or None.
        region: Region of that target, if the target has several.
    """

    sort: HarmSort
    object: str
    target: str | None = None
    region: str = ""

    def words(self, info: SceneInfo) -> str:
        """Describe the harm in a clause such as "the mouse lies on the floor"."""
        kind = info.object(self.object).kind
        if self.sort == "on_the_floor":
            return f"the {kind} {agreeing(kind, 'lies', 'lie')} on the floor"
        if self.sort == "knocked_over":
            return f"the {kind} {agreeing(kind, 'was', 'were')} knocked over"
        if self.sort == "displaced":
            was, its = agreeing(kind, "was", "were"), agreeing(kind, "its", "their")
            return f"the {kind} {was} moved out of {its} place by more than {100 * DISPLACED:.0f} cm"
        if self.sort in ("target_moved", "anchor_moved"):
            was, its = agreeing(kind, "was", "were"), agreeing(kind, "its", "their")
            limit = TARGET_MOVED if self.sort == "target_moved" else ANCHOR_MOVED
            return f"the {kind} {was} moved out of {its} place by more than {100 * limit:.0f} cm"
        if self.sort == "turned":
            was, its = agreeing(kind, "was", "were"), agreeing(kind, "its", "their")
            return f"the {kind} {was} turned out of {its} place"
        if self.sort == "left_open":
            return f"the {kind} {agreeing(kind, 'was', 'were')} left open"
        if self.sort == "target_brought" and self.target is not None:
            target = info.object(self.target).kind
            return f"the {target} {agreeing(target, 'was', 'were')} brought to the {kind} without being requested"
        where = "" if self.target is None else place_words(info.object(self.target).kind, self.region)
        return f"the {kind} {agreeing(kind, 'is', 'are')} at {where} without being requested there"


def bystanders(asked: Sequence[Asked], info: SceneInfo) -> tuple[str, ...]:
    """Return the names of the loose objects that the instruction mentions neither as an object to move nor as a target.

    Drawers are left out, because it may be necessary to move them.
    """
    named = _named(asked)
    return tuple(o.name for o in info.objects if not o.fixed and o.role != "drawer" and o.name not in named)


def _named(asked: Sequence[Asked]) -> set[str]:
    """Return the names of all objects and targets of the instruction."""
    return {name for a in asked for name in (*a.candidates, a.target)}


def mere_targets(asked: Sequence[Asked], info: SceneInfo) -> tuple[str, ...]:
    """Return the names of all loose targets that the instruction does not ask to move. Drawers are left out."""
    moved = {name for a in asked for name in a.candidates}
    targets = {a.target for a in asked} - moved
    return tuple(o.name for o in info.objects if o.name in targets and not o.fixed and o.role != "drawer")


def anchors(asked: Sequence[Asked]) -> frozenset[str]:
    """Return the names of the targets that objects are placed beside.

    An object at such a target does not have to touch it.
    """
    return frozenset(a.target for a in asked) - {a.target for a in asked if a.relation != BESIDE.name}


def shut_drawers(asked: Sequence[Asked], state: WorldState) -> tuple[str, ...]:
    """Return the names of the drawers that are closed in a state and are not part of the instruction."""
    named = _named(asked)
    drawers = [o.name for o in state.info.objects if o.role == "drawer" and o.name not in named]
    cabinets = [o.name for o in state.info.objects if any(r.name in MOUNTS for r in o.regions)]
    return tuple(d for d in drawers if any(CLOSED.where(state, d, c) is not None for c in cabinets))


class HarmWatch:
    """Detector of harm in an episode. It must be given every state in order, starting at reset."""

    def __init__(self, asked: Sequence[Asked], targets: Targets, info: SceneInfo, *, exclusive: bool) -> None:
        """Prepare for an episode.

        Args:
            asked: Subgoals of the condition.
            targets: Targets that are watched.
            info: The scene.
            exclusive: Whether only requested objects may be at the targets.
        """
        self._targets, self._exclusive = targets, exclusive
        self._asked = tuple(asked)
        self._watched = tuple(info.index(name) for name in bystanders(asked, info))
        self._mere_targets = tuple(info.index(name) for name in mere_targets(asked, info))
        self._anchors = anchors(asked)
        self._shut: tuple[int, ...] = ()
        self._loose = tuple(o.name for o in info.objects if not o.fixed)
        self._containers = tuple(o.name for o in info.objects if not o.fixed and o.role == "container")
        self._has_upright = frozenset(o.name for o in info.objects if not o.fixed and has_upright(o))
        self._standing: frozenset[str] = frozenset()
        self._middles = tuple((0.0, 0.0, 0.5 * o.size_m[2]) for o in info.objects)
        self._start: tuple[Vector, ...] = ()
        self._start_positions: tuple[Vector, ...] = ()
        self._start_quaternions: tuple[Quaternion, ...] = ()
        self._before: tuple[tuple[Vector, ...], tuple[Quaternion, ...]] = ((), ())
        self._at_start: Places = ()
        self._displaced: dict[str, None] = {}

    def see(self, state: WorldState, places: Places) -> None:
        """Process the next state.

        ``places`` contains the region that each watched object is in. It is None for an object that is outside all
        regions or in a wrong posture.
        """
        if not self._start:
            self._start = tuple(self._middle(state, i) for i in range(len(state.positions)))
            self._start_positions = tuple(state.positions)
            self._start_quaternions = tuple(state.quaternions)
            self._shut = tuple(state.info.index(name) for name in shut_drawers(self._asked, state))
            self._at_start = self._targets.in_any_posture(state, places)
            self._standing = frozenset(n for n in self._has_upright if _tilt(state, n) <= THRESHOLDS.upright_tilt)
        positions, quaternions = state.positions, state.quaternions
        was, turned = self._before
        if positions == was and quaternions == turned:
            return  # The center of an object is computed only after the object has moved.
        self._before = positions, quaternions
        for i in self._watched:
            if was and positions[i] == was[i] and quaternions[i] == turned[i]:
                continue
            if self._moved(state, i) > DISPLACED:
                self._displaced[state.info.objects[i].name] = None

    def _middle(self, state: WorldState, i: int) -> Vector:
        """Return the center of an object.

        Unlike the center of the base, this point moves sideways when the object is knocked over.
        """
        return Pose(state.positions[i], state.quaternions[i]).apply(self._middles[i])

    def _moved(self, state: WorldState, i: int) -> float:
        return math.dist(self._middle(state, i), self._start[i])

    def found(self, state: WorldState, places: Places) -> tuple[Harm, ...]:
        """Return all harm up to the given state. The state must already have been processed."""
        floor = {name: Harm("on_the_floor", name) for name in self._loose if on_floor(state, name)}
        upright = [state.info.objects[i].name for i in self._watched]
        upright += self._targets.left_over(places)
        upright = [n for n in dict.fromkeys(upright) if n in self._standing]
        over = {
            n: Harm("knocked_over", n)
            for n in (*self._containers, *upright)
            if n not in floor and lies_on_side(state, n)
        }
        away = [*self._displaced, *self._left_over_away(state, places)]
        moved = [Harm("displaced", name) for name in away if name not in floor and name not in over]
        gone = {*floor, *over, *away}
        moved += [harm for harm in self._out_of_place(state) if harm.object not in gone]
        intruder = self._targets.intruder(state, places, self._at_start) if self._exclusive else None
        there = [] if intruder is None else [self._at_target(state, intruder)]
        return (*floor.values(), *over.values(), *moved, *there)

    def _out_of_place(self, state: WorldState) -> list[Harm]:
        """Return the harm in a state: targets that were moved, objects that were rotated, and drawers that are open.

        There is at most one harm for each object.
        """
        objects = state.info.objects
        sorts: dict[str, HarmSort] = {
            objects[i].name: "left_open" for i in self._shut if self._moved(state, i) > LEFT_OPEN
        }
        for i in (*self._watched, *self._mere_targets):
            start = Pose(self._start_positions[i], self._start_quaternions[i])
            now = Pose(state.positions[i], state.quaternions[i])
            if is_turned_away(objects[i], start, now, target=i in self._mere_targets):
                sorts[objects[i].name] = "turned"
        for i in self._mere_targets:
            is_anchor = objects[i].name in self._anchors
            if self._moved(state, i) > (ANCHOR_MOVED if is_anchor else TARGET_MOVED):
                sorts[objects[i].name] = "anchor_moved" if is_anchor else "target_moved"
        return [Harm(sort, name) for name, sort in sorts.items()]

    def _at_target(self, state: WorldState, intruder: Intruder) -> Harm:
        """Return the harm of an object being at a target where it was not requested.

        The kind of harm depends on whether the object or the target was moved.
        """
        moved, other = (
            self._moved(state, state.info.index(name)) > DISPLACED for name in (intruder.target, intruder.object)
        )
        return Harm("target_brought" if moved and not other else "at_the_target", *intruder)

    def _left_over_away(self, state: WorldState, places: Places) -> list[str]:
        """Return the surplus objects that are out of place in a state.

        A surplus object is of a requested kind but is not needed. The policy may take such an object if it brings the
        object back.
        """
        index = state.info.index
        return [name for name in self._targets.left_over(places) if self._moved(state, index(name)) > DISPLACED]


def can_stand(thing: ObjectInfo) -> bool:
    """Return whether an object can stand upright and be knocked over, i.e. whether it is not flat and does not roll."""
    width, depth, height = thing.size_m
    return thing.shape in STANDS_FROM and height >= STANDS_FROM[thing.shape] * min(width, depth)


def has_upright(thing: ObjectInfo) -> bool:
    """Return whether a person who found the object on its side would put it upright again.

    This holds if the object can stand, or if it is a plate, a bowl or a drink. Plates are recognized by their region
    "floor". Bowls and drinks are registered with ``keeps_upright``.
    """
    return can_stand(thing) or thing.keeps_upright or any(region.name == "floor" for region in thing.regions)


def has_direction(thing: ObjectInfo, least_by_shape: Mapping[str, float] = POINTS_FROM) -> bool:
    """Return whether the rotation of an object is visible.

    The rotation is visible if the object is longer than wide, or if it is a box with a front.
    """
    width, depth, _ = thing.size_m
    least = least_by_shape.get(thing.shape)
    if least is None:
        return False
    return max(width, depth) >= least * min(width, depth) or (thing.shape == "box" and can_stand(thing))


def is_turned_away(thing: ObjectInfo, before: Pose, after: Pose, *, target: bool) -> bool:
    """Return whether an object that stays near its place was rotated so far that a person would turn it back.

    Either the rotation alone moved the ends of the object too far, or a push and a rotation together moved the
    outermost point too far. The second rule does not apply to targets, because these may be pushed farther.
    """
    if way_of_ends(thing, before.quaternion, after.quaternion) > TURNED:
        return True
    return not target and way_of_outermost(thing, before, after) > OUTERMOST_MOVED


def way_of_outermost(thing: ObjectInfo, before: Pose, after: Pose) -> float:
    """Return how far the outermost point of an object moved [m], for example a corner or the handle of a mug.

    This is 0 if the rotation of the object is not visible, or if its tilt changed because it was lifted or knocked
    over.
    """
    if not has_direction(thing, HANDLE_FROM) or _is_tipped(before.quaternion, after.quaternion):
        return 0.0
    half_x, half_y, half_z = (0.5 * size for size in thing.size_m)
    points = tuple((x, y) for x in (-half_x, half_x) for y in (-half_y, half_y))
    if thing.shape == "cylinder":  # the corners of the bounding box are not on the object
        points = ((-half_x, 0.0), (half_x, 0.0), (0.0, -half_y), (0.0, half_y))
    middle = (0.0, 0.0, half_z)
    dx, dy, dz = (b - a for a, b in zip(before.apply(middle), after.apply(middle), strict=True))
    was, now = yaw_of(before.quaternion), yaw_of(after.quaternion)
    # The motion of each point is the motion of the center plus a rotation around the center.
    cos, sin = math.cos(now) - math.cos(was), math.sin(now) - math.sin(was)
    return max(math.hypot(dx + cos * x - sin * y, dy + sin * x + cos * y, dz) for x, y in points)


def way_of_ends(thing: ObjectInfo, before: Quaternion, after: Quaternion) -> float:
    """Return how far the corners of an object moved because of its rotation about the vertical axis [m].

    This is 0 if the rotation of the object is not visible, or if its tilt changed because it was lifted or knocked
    over.
    """
    if not has_direction(thing) or _is_tipped(before, after):
        return 0.0
    width, depth, _ = thing.size_m
    # A corner moves along the circle through the corners. The distance is the chord of the rotation angle.
    return math.hypot(width, depth) * abs(math.sin(0.5 * (yaw_of(after) - yaw_of(before))))


def _is_tipped(before: Quaternion, after: Quaternion) -> bool:
    """Return whether the tilt of an object changed so much that the object counts as knocked over."""
    return abs(tilt_of(after) - tilt_of(before)) > THRESHOLDS.knocked_tilt


def _tilt(state: WorldState, name: str) -> float:
    return tilt_of(state.quaternions[state.info.index(name)])
