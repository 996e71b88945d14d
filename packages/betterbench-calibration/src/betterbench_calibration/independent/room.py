"""Free space for the gripper, and heights of objects, computed from the bounding boxes of objects."""

from __future__ import annotations

import itertools
import math

from betterbench.geometry import Pose, Vector, horizontal_distance, rotate
from betterbench.interface.state import WorldState

FINGER_X_M, FINGER_THICK_M = 0.011, 0.020
TIP_M, FINGER_TOP_M = 0.008, -0.045
HAND_X_M, HAND_Y_M, HAND_TOP_M = 0.033, 0.102, -0.11
NEAR_M = 0.010
CORRIDOR_M = 0.07
FARTHEST_BOX_M = 0.45


def crowding(state: WorldState, tool: Pose, opening_m: float, *, ignore: frozenset[str]) -> float:
    """Return how much the gripper at a pose violates the clearance of objects and of the table [m].

    The violation is summed over sample points of the fingers and the hand. It is 0 if there is enough space.
    """
    points = [tool.apply(p) for p in _gripper_points(opening_m)]
    total = sum(max(0.0, 0.002 - z) for _, _, z in points)
    for info in state.info.objects:
        if info.name in ignore:
            continue
        pose = state.pose(info.name)
        if horizontal_distance(pose.position, tool.position) > FARTHEST_BOX_M:
            continue
        inverse = pose.inverse()
        sx, sy, sz = (0.5 * v for v in info.size_m)
        for point in points:
            x, y, z = inverse.apply(point)
            outside = math.hypot(max(abs(x) - sx, 0.0), max(abs(y) - sy, 0.0), max(abs(z - sz) - sz, 0.0))
            total += max(0.0, NEAR_M - outside)
    return total


def _gripper_points(opening_m: float) -> list[Vector]:
    half = 0.5 * opening_m
    fingers = itertools.product(
        (-FINGER_X_M, FINGER_X_M),
        (half, half + FINGER_THICK_M, -half, -half - FINGER_THICK_M),
        (TIP_M, FINGER_TOP_M),
    )
    hand = itertools.product((-HAND_X_M, HAND_X_M), (-HAND_Y_M, -0.05, 0.0, 0.05, HAND_Y_M), (FINGER_TOP_M, HAND_TOP_M))
    return [*fingers, *hand]


def height_of(state: WorldState, name: str) -> float:
    """Return the height of the top of an object, or of the walls of a container, above the table [m]."""
    info, pose = state.info.object(name), state.pose(name)
    for region in info.regions:
        if region.name == "inside":
            return pose.position[2] + region.position[2] + region.half_size[2]
    x, y, z = (0.5 * v for v in info.size_m)
    q = pose.quaternion
    reach = sum(abs(rotate(q, v)[2]) for v in ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z)))
    return pose.apply((0.0, 0.0, z))[2] + reach


def lowest_of(state: WorldState, name: str) -> float:
    """Return the height of the lowest corner of an object's bounding box above the table [m]."""
    middle = state.pose(name).apply((0.0, 0.0, 0.5 * state.info.object(name).size_m[2]))[2]
    x, y, z = (0.5 * v for v in state.info.object(name).size_m)
    q = state.pose(name).quaternion
    return middle - sum(abs(rotate(q, v)[2]) for v in ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z)))


def highest_between(state: WorldState, a: Vector, b: Vector, *, ignore: frozenset[str] = frozenset()) -> float:
    """Return the height of the tallest object near the straight horizontal path from a to b above the table [m]."""
    tops = [0.0]
    for info in state.info.objects:
        if info.name in ignore:
            continue
        x, y, _ = state.pose(info.name).position
        reach = 0.5 * math.hypot(info.size_m[0], info.size_m[1]) + CORRIDOR_M
        if _distance_to_segment((x, y), a, b) < reach:
            tops.append(height_of(state, info.name))
    return max(tops)


def _distance_to_segment(p: tuple[float, float], a: Vector, b: Vector) -> float:
    ax, ay, bx, by = a[0], a[1], b[0], b[1]
    length2 = (bx - ax) ** 2 + (by - ay) ** 2
    t = 0.0 if length2 == 0.0 else ((p[0] - ax) * (bx - ax) + (p[1] - ay) * (by - ay)) / length2
    t = max(0.0, min(1.0, t))
    return math.hypot(p[0] - ax - t * (bx - ax), p[1] - ay - t * (by - ay))
