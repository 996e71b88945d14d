"""Where a held object has to go: the poses that satisfy a subgoal, the best first."""

from __future__ import annotations

import math
from dataclasses import dataclass

from betterbench.errors import PlanningError
from betterbench.geometry import Pose, Quaternion, Vector, conjugate, from_yaw, multiply, normalize, rotate, yaw_of
from betterbench.state import ObjectInfo, WorldState
from betterbench.tasks import THRESHOLDS, TargetRegion
from betterbench.tasks.relations import relation as relation_named

RELEASE_GAP_M = 0.002
"""Height above its resting place at which an object is let go [m]."""
ENTRY_M, ENTRY_RISE_M = 0.13, 0.012
"""Length and rise of the way in below an overhang [m]."""
SPOTS = ((-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (0.0, 1.0), (0.0, -1.0), (-1.0, 0.0), (1.0, 0.0))
"""Places within a container, as fractions of the distance that an item's center may have from the middle."""
RIM_RELEASE_M = 0.03
"""Opening of the hand that lets go of a rim, with a finger inside and one outside it [m]."""
FINGER_ROOM_M = 0.072
"""Distance from a wall at which the fingers can open to their full width: half the opening, a finger and a margin."""


@dataclass(frozen=True, slots=True)
class PlaceGoal:
    """A pose at which an object is to be let go, and the side from which it comes there.

    Attributes:
        pose: Pose ``T_world_object`` to let go at.
        approach: Displacement [m], world frame, from that pose to where the straight approach begins.
        release_width_m: How far the hand opens to let go [m]; None for all the way.
    """

    pose: Pose
    approach: Vector = (0.0, 0.0, 0.08)
    release_width_m: float | None = None


def place_goals(state: WorldState, name: str, place: TargetRegion, relation: str) -> tuple[PlaceGoal, ...]:
    """Return poses at which an object satisfies a relation to a target, the best first.

    Args:
        state: State now.
        name: Name of the object.
        place: Container, fixture or other target, and which of its places.
        relation: Name of the relation.

    Raises:
        PlanningError: If the relation is not one that these skills can bring about.
    """
    if relation == "on_ring":
        return _on_ring(state, name, place.target)
    if relation == "inside":
        return _inside(state, name, place.target)
    if relation == "beside":
        return _beside(state, name, place)
    if relation == "in_hole":
        return _in_hole(state, name, place)
    if relation in ("layer", "on_plate"):
        return _on_top(state, name, place, relation)
    raise PlanningError(f"no skill brings about the relation {relation!r}")


def _on_ring(state: WorldState, name: str, fixture: str) -> tuple[PlaceGoal, ...]:
    """Return goals on the ring; the object slides in from the front of the fixture, below its overhanging head."""
    frame = state.pose(fixture)
    ring = state.info.object(fixture).region("ring")
    x, y, z = frame.apply(ring.position)
    facing = yaw_of(frame.quaternion)
    base = (
        0.0
        if any(r.name == "handle" for r in state.info.object(name).regions)
        else yaw_of(state.pose(name).quaternion) - facing
    )
    turns = [0.0] + [sign * step for step in (0.15, 0.3, 0.5, 0.7) for sign in (1.0, -1.0)]
    foot = next((r.position for r in state.info.object(name).regions if r.name == "base"), (0.0, 0.0, 0.0))
    front = rotate(frame.quaternion, (ENTRY_M, 0.0, 0.0))
    approach = (front[0], front[1], ENTRY_RISE_M)
    goals = []
    for turn in turns:
        turned = from_yaw(facing + base + turn)
        fx, fy, fz = rotate(turned, foot)
        goals.append(PlaceGoal(Pose((x - fx, y - fy, z - fz + RELEASE_GAP_M), turned), approach))
    return tuple(goals)


def _beside(state: WorldState, name: str, place: TargetRegion) -> tuple[PlaceGoal, ...]:
    """Return goals in the zone of a side; long things lie along the anchor, either way round."""
    frame, info = state.pose(place.target), state.info.object(name)
    zone = frame @ state.info.object(place.target).region(place.at).pose
    facing = yaw_of(frame.quaternion)
    now = yaw_of(state.pose(name).quaternion)
    if info.size_m[0] >= THRESHOLDS.long_ratio * info.size_m[1]:
        turns = sorted((facing, facing + math.pi), key=lambda yaw: abs(math.remainder(yaw - now, 2.0 * math.pi)))
    else:
        turns = [now + turn for turn in (0.0, 0.4, -0.4, 0.8, -0.8, 1.6, -1.6)]
    return tuple(
        _standing(state, name, zone.position, from_yaw(yaw), gap_m=RELEASE_GAP_M, release_width_m=_narrow(info))
        for yaw in turns
    )


def _in_hole(state: WorldState, name: str, place: TargetRegion) -> tuple[PlaceGoal, ...]:
    """Return goals on the floor of a hole: straight down, let go just above it."""
    frame = state.pose(place.target)
    floor = frame.apply(state.info.object(place.target).region(place.at).position)
    now = yaw_of(state.pose(name).quaternion)
    turns = [now + turn for turn in (0.0, 0.5, -0.5, 1.0, -1.0, 1.57, -1.57)]
    width = _narrow(state.info.object(name))
    return tuple(
        _standing(state, name, floor, from_yaw(turn), gap_m=RELEASE_GAP_M, release_width_m=width) for turn in turns
    )


def _on_top(state: WorldState, name: str, place: TargetRegion, relation: str) -> tuple[PlaceGoal, ...]:
    """Return goals on a plate, or on the uppermost thing of a stack below the layer that is asked for."""
    below = place.target
    if relation == "layer":
        beneath = {where: o.name for o in state.info.objects if (where := _layer(state, o.name, place)) is not None}
        below = beneath.get(str(int(place.at) - 1), place.target)
    region = "floor" if relation == "on_plate" else "top"
    x, y, z = state.pose(below).apply(state.info.object(below).region(region).position)
    if relation == "layer":
        x, y, _ = state.pose(place.target).position  # centered over the base, so that small offsets do not add up
    now = yaw_of(state.pose(name).quaternion)
    turns = [now + turn for turn in (0.0, 0.4, -0.4, 0.8, -0.8, 1.6, -1.6)]
    width = _narrow(state.info.object(name)) if relation == "layer" else RIM_RELEASE_M
    return tuple(
        _standing(state, name, (x, y, z), from_yaw(turn), gap_m=RELEASE_GAP_M, release_width_m=width) for turn in turns
    )


def _layer(state: WorldState, name: str, place: TargetRegion) -> str | None:
    return None if name == place.target else relation_named("layer").where(state, name, place.target)


def _standing(
    state: WorldState, name: str, point: Vector, turned: Quaternion, *, gap_m: float, release_width_m: float | None
) -> PlaceGoal:
    """Return the goal to let go of an object with its foot at a point."""
    foot_at = next((r.position for r in state.info.object(name).regions if r.name == "base"), (0.0, 0.0, 0.0))
    fx, fy, fz = rotate(turned, foot_at)
    pose = Pose((point[0] - fx, point[1] - fy, point[2] - fz + gap_m), turned)
    return PlaceGoal(pose, release_width_m=release_width_m)


def _narrow(info: ObjectInfo) -> float | None:
    """Return how far the hand opens to let go of a slim thing among others [m]; None for all the way."""
    least = min(info.size_m[0], info.size_m[1])
    return least + 0.022 if least < 0.05 else None


def _inside(state: WorldState, name: str, container: str) -> tuple[PlaceGoal, ...]:
    frame = state.pose(container)
    info = state.info.object(container)
    region = info.region("inside")
    size = state.info.object(name).size_m
    hx, hy, hz = region.half_size
    item = 0.5 * max(size[:2]) + 0.005
    across = (min(hx - FINGER_ROOM_M, hx - item), hy - item)
    along = (hx - item, min(hy - FINGER_ROOM_M, hy - item))
    opening = rotate(multiply(conjugate(frame.quaternion), state.ee_pose.quaternion), (0.0, 1.0, 0.0))
    floor = region.position[2] - hz
    taken = [
        (frame.inverse().apply(state.positions[i]), o.size_m)
        for i, o in enumerate(state.info.objects)
        if o.name not in (name, container) and not o.fixed and _within(state, i, container)
    ]
    now = yaw_of(state.pose(name).quaternion)
    goals: list[tuple[float, Pose]] = []
    for turn in (0.0, math.pi / 2, -math.pi / 2):
        x_opening, y_opening, _ = rotate(from_yaw(turn), opening)
        room_x, room_y = across if abs(x_opening) > abs(y_opening) else along
        for preference, (fx, fy) in enumerate(SPOTS):
            spot = (region.position[0] + fx * max(room_x, 0.0), region.position[1] + fy * max(room_y, 0.0))
            gap = min((math.dist(spot, p[:2]) - 0.5 * max(s[:2]) for p, s in taken), default=1.0) - item
            crowding = max(0.0, -gap)
            for drop in (RELEASE_GAP_M, 0.015, 0.03, 0.045, 0.06, 0.085):
                place = frame.apply((spot[0], spot[1], floor + drop))
                cost = 60.0 * crowding + 40.0 * drop + 0.15 * abs(turn) + 0.05 * preference
                goals.append((cost, Pose(place, normalize(from_yaw(now + turn)))))
    return tuple(PlaceGoal(pose) for _, pose in sorted(goals, key=lambda g: g[0]))


def _within(state: WorldState, i: int, container: str) -> bool:
    region = state.info.object(container).region("inside")
    x, y, _ = (state.pose(container) @ region.pose).inverse().apply(state.positions[i])
    return abs(x) <= region.half_size[0] and abs(y) <= region.half_size[1]
