"""Arrangement: on which side of an anchor an object lies or stands."""

from __future__ import annotations

import math

from betterbench.geometry import IDENTITY_QUATERNION, yaw_of
from betterbench.state import ObjectInfo, WorldState
from betterbench.tasks.relations.on_ring import foot
from betterbench.tasks.relations.rest import upright
from betterbench.tasks.thresholds import THRESHOLDS

SIDES = ("left", "right", "behind", "upper_right")
"""Names of the regions that anchors offer, as somebody sees them who sits in front of the anchor."""


def beside(state: WorldState, name: str, anchor: str) -> str | None:
    """Return the side of an anchor at which an object lies, or None.

    The center of the object's foot lies in the region of that side, on the table and not on something; it stands as it
    is meant to stand; and a long object (half as long again as wide) lies along the anchor's front-to-back axis, either
    way round.

    Args:
        state: The state to judge.
        name: Name of the object.
        anchor: Name of the anchor; its asset has some of the regions :data:`SIDES`.
    """
    x, y, z = state.pose(anchor).inverse().apply(foot(state, name))
    if x * x + y * y > THRESHOLDS.side_reach**2 or z > THRESHOLDS.side_height:
        return None
    found = None
    for region in state.info.object(anchor).regions:
        if region.name not in SIDES:
            continue
        if region.quaternion == IDENTITY_QUATERNION:
            dx, dy = x - region.position[0], y - region.position[1]
        else:
            dx, dy, _ = region.pose.inverse().apply((x, y, z))
        if abs(dx) <= region.half_size[0] and abs(dy) <= region.half_size[1]:
            found = region.name
            break
    if found is None or not upright(state, name) or not state.touching(name, "table"):
        return None
    return found if _aligned(state, name, anchor) else None


def sides(info: ObjectInfo) -> tuple[str, ...]:
    """Return the sides that an object offers as an anchor."""
    return tuple(r.name for r in info.regions if r.name in SIDES)


def _aligned(state: WorldState, name: str, anchor: str) -> bool:
    length, width, _ = state.info.object(name).size_m
    if length < THRESHOLDS.long_ratio * width:
        return True
    turn = yaw_of(state.pose(name).quaternion) - yaw_of(state.pose(anchor).quaternion)
    return abs((turn + 0.5 * math.pi) % math.pi - 0.5 * math.pi) <= THRESHOLDS.side_turn
