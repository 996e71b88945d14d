"""Assembly: which layer of a stack an object is, counted from the base."""

from __future__ import annotations

from betterbench.geometry import horizontal_distance, tilt_of
from betterbench.state import ObjectInfo, WorldState
from betterbench.tasks.relations.on_ring import foot
from betterbench.tasks.thresholds import THRESHOLDS

LAYERS = ("1", "2", "3", "4")
"""Layers that a base offers; the longest stack of the suite has three."""


def layer(state: WorldState, name: str, base: str) -> str | None:
    """Return the layer of a stack that an object is, "1" being what lies on the base itself, or None.

    Every layer from the base up to the object lies flat on the one below, touches it, and is centered over the base.

    Args:
        state: The state to judge.
        name: Name of the object.
        base: Name of the base.
    """
    position = foot(state, name)
    if not _over(state, name, base) or position[2] <= state.pose(base).position[2]:
        return None
    below = base
    seen = {base}
    for number in LAYERS:
        top = _top(state, below)
        above = [
            o.name
            for o in state.info.objects
            if o.name not in seen
            and not o.fixed
            and _over(state, o.name, base)
            and abs(foot(state, o.name)[2] - top) <= THRESHOLDS.layer_gap
            and state.touching(o.name, below)
        ]
        if len(above) != 1:
            return None  # nothing there, or two things share the layer
        if name in above:
            return number
        below = above[0]
        seen.add(below)
    return None


def layers(info: ObjectInfo) -> tuple[str, ...]:
    """Return the layers that an object offers as a base."""
    return LAYERS if info.role == "container" and any(r.name == "top" for r in info.regions) else ()


def _over(state: WorldState, name: str, base: str) -> bool:
    middle = state.pose(base).position
    if horizontal_distance(foot(state, name), middle) > THRESHOLDS.layer_offset:
        return False
    return tilt_of(state.pose(name).quaternion) <= THRESHOLDS.layer_tilt


def _top(state: WorldState, name: str) -> float:
    """Return the height of the surface that the next layer lies on [m]."""
    info = state.info.object(name)
    pose = state.pose(name)
    for region in info.regions:
        if region.name == "top":
            return pose.apply(region.position)[2]
    return pose.position[2] + info.size_m[2]
