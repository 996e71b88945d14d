"""Transfer a transit (the motion between two skills) to other end points."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.demonstrations.making.sources import SourceSkill
from betterbench.geometry import Pose, Vector, angle_between, distance, horizontal_distance, slerp, straight_way

LEAST_WAY_M = 0.05
"""Minimum horizontal length for a transit to have a direction [m]."""
STRETCHED = (0.5, 2.0)
"""Minimum and maximum factor by which the distance between a transit's end points may change."""
MOST_STEP_M, MOST_STEP_RAD = 0.03, 0.12
"""Maximum translation [m] and rotation [rad] per control step in a transferred transit (0.6 m/s and 2.4 rad/s)."""
CHECK_RAD = 0.25
"""Maximum rotation between neighboring poses that are checked for collisions [rad]."""


@dataclass(frozen=True, slots=True)
class TransitChange:
    """Difference between a transit and the transit of the source demonstration.

    Attributes:
        aside_m: Displacement of the midpoint to the left, as seen from above [m].
        raise_m: Upward displacement of the midpoint [m].
        faster: Speed as a multiple of the speed in the source demonstration.
    """

    aside_m: float = 0.0
    raise_m: float = 0.0
    faster: float = 1.0


def carry_transit(
    skill: SourceSkill, begin: int, start: Pose, goal: Pose, variation: TransitChange
) -> tuple[Pose, ...] | None:
    """Transfer the transit that leads to the step ``begin`` of a skill to another start pose and end pose.

    Return one pose per control step.

    Seen from above, the transit is rotated, and stretched along the line between its end points. Its height and its
    sideways offset from this line do not change, except for the requested variation.

    Args:
        skill: The skill in the source demonstration.
        begin: Step of the skill at which the transit ends.
        start: Pose ``T_world_tcp`` at the start of the new transit.
        goal: Pose ``T_world_tcp`` at the end of the new transit.
        variation: Difference from the transit of the source demonstration.

    Returns:
        The new transit; None if the transit of the source demonstration contains a missed grasp or would be stretched
        too much.
    """
    if skill.lead_in is None:
        return None
    way = (*skill.lead_in, *skill.targets[: begin + 1])
    turned = _turned(way, start, goal)
    if turned is None:
        return None
    shares = [0.0]
    for before, point in itertools.pairwise(turned):
        shares.append(shares[-1] + distance(before, point))
    if shares[-1] < LEAST_WAY_M:
        return None
    ox, oy, oz = (g - p for g, p in zip(goal.position, turned[-1], strict=True))
    vx, vy = (g - s for g, s in zip(goal.position[:2], start.position[:2], strict=True))
    aside = variation.aside_m / math.hypot(vx, vy) if math.hypot(vx, vy) >= LEAST_WAY_M else 0.0
    moved = []
    for (x, y, z), share in zip(turned, (length / shares[-1] for length in shares), strict=True):
        # The displacement and its slope are zero at both end points.
        most = math.sin(math.pi * share) ** 2
        point = (
            x + share * ox - most * aside * vy,
            y + share * oy + most * aside * vx,
            z + share * oz + most * variation.raise_m,
        )
        moved.append(Pose(point, slerp(start.quaternion, goal.quaternion, share)))
    return retimed(moved, variation.faster)


def _turned(way: Sequence[Pose], start: Pose, goal: Pose) -> list[Vector] | None:
    """Rotate and stretch a transit so that it leads from start to goal.

    Return None if the transit would be stretched too much.
    """
    (ax, ay, az), b = way[0].position, way[-1].position
    there, here = horizontal_distance((ax, ay), b), horizontal_distance(start.position, goal.position)
    cos, sin, ux, uy, stretch = 1.0, 0.0, 1.0, 0.0, 1.0
    if there >= LEAST_WAY_M and here >= LEAST_WAY_M:
        stretch = here / there
        if not STRETCHED[0] <= stretch <= STRETCHED[1]:
            return None
        ux, uy = (b[0] - ax) / there, (b[1] - ay) / there
        vx, vy = (goal.position[0] - start.position[0]) / here, (goal.position[1] - start.position[1]) / here
        cos, sin = ux * vx + uy * vy, ux * vy - uy * vx
    sx, sy, sz = start.position
    found = []
    for pose in way:
        x, y, z = pose.position
        dx, dy = x - ax, y - ay
        more = (stretch - 1.0) * (dx * ux + dy * uy)
        dx, dy = dx + more * ux, dy + more * uy
        found.append((sx + cos * dx - sin * dy, sy + sin * dx + cos * dy, sz + z - az))
    return found


def retimed(way: Sequence[Pose], faster: float) -> tuple[Pose, ...]:
    """Change the speed of a motion that has one pose per control step. The first and the last pose stay the same.

    Translation and rotation per step are limited, so the result may be slower than requested.
    """
    if len(way) < 2:
        return tuple(way)
    steps = _at_speed(way, faster)
    pairs = list(itertools.pairwise(steps))
    most = max(
        max(distance(a.position, b.position) / MOST_STEP_M, angle_between(a.quaternion, b.quaternion) / MOST_STEP_RAD)
        for a, b in pairs
    )
    return steps if most <= 1.0 else _at_speed(way, faster / most)


def _at_speed(way: Sequence[Pose], faster: float) -> tuple[Pose, ...]:
    number = max(1, math.ceil((len(way) - 1) / faster - 1e-9))
    if number == len(way) - 1:
        return tuple(way)
    found = []
    for i in range(number):
        at = i * (len(way) - 1) / number
        before = int(at)
        found.append(straight_way(way[before], way[before + 1])(at - before))
    return (*found, way[-1])


def checkpoints(way: Sequence[Pose], step_m: float) -> list[Pose]:
    """Return the poses along a transit at which to check for collisions.

    Neighboring poses are at most ``step_m`` apart [m].
    """
    found = [way[0]]
    for pose, after in itertools.pairwise(way[1:]):
        far = distance(after.position, found[-1].position) > step_m
        if far or angle_between(after.quaternion, found[-1].quaternion) > CHECK_RAD:
            found.append(pose)
    return [*found, way[-1]]
