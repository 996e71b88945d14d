"""Insertion: in which hole of a rack an object stands."""

from __future__ import annotations

from betterbench.geometry import tilt_of
from betterbench.state import ObjectInfo, WorldState
from betterbench.tasks.relations.on_ring import foot
from betterbench.tasks.thresholds import THRESHOLDS

PREFIX = "hole_"


def in_hole(state: WorldState, name: str, rack: str) -> str | None:
    """Return the hole in which an object stands, or None.

    The object's foot is on the floor of the hole, as near to its middle as the clearance allows, and the object is
    upright. One that leans on the rim or stands on the rack is in no hole.

    Args:
        state: The state to judge.
        name: Name of the object.
        rack: Name of the rack; its asset has regions "hole_1", "hole_2", ... at the floors of its holes.
    """
    frame = state.pose(rack)
    inverse = frame.inverse()
    x, y, z = inverse.apply(foot(state, name))
    for region in state.info.object(rack).regions:
        if not region.name.startswith(PREFIX):
            continue
        hx, hy, hz = region.position
        if abs(x - hx) > region.half_size[0] or abs(y - hy) > region.half_size[1]:
            continue
        seated = abs(z - hz) <= THRESHOLDS.hole_depth
        tilted = tilt_of(state.pose(name).quaternion) > THRESHOLDS.hole_tilt
        return region.name if seated and not tilted else None
    return None


def holes(info: ObjectInfo) -> tuple[str, ...]:
    """Return the holes that an object offers."""
    return tuple(r.name for r in info.regions if r.name.startswith(PREFIX))
