"""Articulation: whether a drawer is shut."""

from __future__ import annotations

from betterbench.geometry import distance
from betterbench.state import ObjectInfo, WorldState
from betterbench.tasks.thresholds import THRESHOLDS

MOUNTS = ("upper", "lower")
"""Names of the regions in which a cabinet takes drawers."""


def closed(state: WorldState, drawer: str, cabinet: str) -> str | None:
    """Return the mount of a cabinet in which a drawer is pushed home, or None while it stands open.

    Args:
        state: The state to judge.
        drawer: Name of the drawer.
        cabinet: Name of the cabinet; its asset has the regions :data:`MOUNTS`, where closed drawers have their origin.
    """
    frame = state.pose(cabinet)
    position = state.pose(drawer).position
    for region in state.info.object(cabinet).regions:
        if region.name in MOUNTS and distance(position, frame.apply(region.position)) <= THRESHOLDS.closed_gap:
            return region.name
    return None


def mounts(info: ObjectInfo) -> tuple[str, ...]:
    """Return the mounts that an object offers."""
    return tuple(r.name for r in info.regions if r.name in MOUNTS)
