"""Loose variants of relations. They hold for any posture of an object: leaning, jammed, upside down or held.

A strict relation requires the posture that the instruction asks for. An object in another posture may still be at the
target. The rule "no other object is at the target" therefore uses loose variants of the relations. They are built from
these functions.
"""

import itertools
import math

from betterbench.geometry import Pose, Vector, horizontal_distance, rotate
from betterbench.interface.state import WorldState
from betterbench.tasks.thresholds import threshold

OVERLAP = threshold(
    "loose_overlap",
    0.005,
    "m",
    "An object is in a target at all if part of it reaches in by at least this depth. An object that only leans "
    "against the outside is not in the target.",
    "Larger: objects that reach in by less are not in the target; more success, fewer execution_failure with harm, "
    "fewer behavioral_inertia of badly placed objects.",
)
_STEPS = (-1.0, -0.5, 0.0, 0.5, 1.0)
_HIGHER_M = 0.001
"""An object is above another one if its lowest point is higher by at least this distance [m]."""
_ROUNDING_M = 1e-9
"""Margin that is larger than the rounding error of a distance [m]."""


def middle(state: WorldState, name: str) -> Vector:
    """Return the center of an object's bounding box in the world [m]. It hardly moves when the object tips over."""
    return state.pose(name).apply((0.0, 0.0, 0.5 * state.info.object(name).size_m[2]))


def lowest(state: WorldState, name: str) -> float:
    """Return the height of the lowest corner of an object's bounding box [m]."""
    x, y, z = (0.5 * v for v in state.info.object(name).size_m)
    q = state.pose(name).quaternion
    reach = abs(rotate(q, (x, 0.0, 0.0))[2]) + abs(rotate(q, (0.0, y, 0.0))[2]) + abs(rotate(q, (0.0, 0.0, z))[2])
    return middle(state, name)[2] - reach


def reaches_into(state: WorldState, name: str, space: Pose, half_size: Vector) -> bool:
    """Return whether a part of an object's bounding box reaches deeper than ``loose_overlap`` into a box.

    Args:
        state: The state.
        name: Name of the object.
        space: Pose ``T_world_box`` of the center of the box.
        half_size: Half the size of the box along its axes [m].
    """
    sx, sy, sz = (0.5 * v for v in state.info.object(name).size_m)
    hx, hy, hz = (max(h - OVERLAP, 0.0) for h in half_size)
    to_space = space.inverse() @ state.pose(name)
    x, y, z = to_space.apply((0.0, 0.0, sz))
    if math.dist((x, y, z), (0.0, 0.0, 0.0)) > math.hypot(sx, sy, sz) + math.hypot(hx, hy, hz):
        return False
    # The extent of the object from its center along the axes of the box. Objects farther away cannot reach in.
    q = to_space.quaternion
    edges = zip(rotate(q, (sx, 0.0, 0.0)), rotate(q, (0.0, sy, 0.0)), rotate(q, (0.0, 0.0, sz)), strict=True)
    for at, edge, half in zip((x, y, z), edges, (hx, hy, hz), strict=True):
        if abs(at) - sum(map(abs, edge)) > half + _ROUNDING_M:
            return False
    for fx, fy, fz in itertools.product(_STEPS, _STEPS, _STEPS):
        x, y, z = to_space.apply((fx * sx, fy * sy, sz + fz * sz))
        if abs(x) <= hx and abs(y) <= hy and abs(z) <= hz:
            return True
    return False


def rests_on(state: WorldState, name: str, target: str) -> bool:
    """Return whether an object lies on a target, or on another object on the target, in any posture.

    The center of the object must be over the target's bounding box and not lower than the target, and a chain of
    contacts must connect the two. Fixed objects, the gripper and the table are not part of a chain. If each of the two
    objects is above the other by this rule, the object that reaches lower carries the other. For example, a thin plate
    under a bowl does not rest on the bowl.
    """
    if target not in _carriers(state, name) or not _over(state, name, target):
        return False
    return not (_over(state, target, name) and lowest(state, name) < lowest(state, target) - _HIGHER_M)


def held_upon(state: WorldState, name: str, target: str) -> bool:
    """Return whether the gripper holds an object just over a target.

    The lowest point of the object must not be higher than the highest point of the target and the objects on it. A
    difference of up to ``loose_overlap`` is allowed.
    """
    if state.held != name or not _over(state, name, target):
        return False
    lying = (o.name for o in state.info.objects if not o.fixed and rests_on(state, o.name, target))
    return lowest(state, name) <= OVERLAP + max(_highest(state, other) for other in (target, *lying))


def _highest(state: WorldState, name: str) -> float:
    """Return the height of the highest corner of an object's bounding box [m]."""
    return 2.0 * middle(state, name)[2] - lowest(state, name)


def _over(state: WorldState, name: str, target: str) -> bool:
    sx, sy, _ = state.info.object(target).size_m
    center = middle(state, name)
    x, y, _ = state.pose(target).inverse().apply(center)
    bottom = lowest(state, target)
    return abs(x) <= 0.5 * sx and abs(y) <= 0.5 * sy and center[2] > bottom and lowest(state, name) > bottom - OVERLAP


def _carriers(state: WorldState, name: str) -> frozenset[str]:
    """Return all objects that are connected to a given object by a chain of contacts."""
    touching: dict[str, set[str]] = {}
    for a, b, _ in state.contacts:
        if a in state.info and b in state.info:
            touching.setdefault(a, set()).add(b)
            touching.setdefault(b, set()).add(a)
    found, waiting = {name}, [name]
    while waiting:
        thing = waiting.pop()
        if thing != name and state.info.object(thing).fixed:
            continue
        for other in sorted(touching.get(thing, set()) - found):
            found.add(other)
            waiting.append(other)
    return frozenset(found - {name})


def nearest(points: dict[str, Vector], point: Vector) -> str | None:
    """Return the name of the horizontally nearest point, or None if there are no points.

    If several points are equally near, the first one is returned.
    """
    return min(points, key=lambda n: horizontal_distance(points[n], point), default=None)
