"""Constrained positioning: whether an object stands centered on a marked ring with its handle clear of the spout."""

from __future__ import annotations

from betterbench.geometry import Vector, horizontal_distance
from betterbench.state import WorldState
from betterbench.tasks.relations.rest import upright
from betterbench.tasks.thresholds import THRESHOLDS


def on_ring(state: WorldState, name: str, fixture: str) -> bool:
    """Tell whether an object stands on the ring of a fixture.

    Its base is centered within 10 mm of the ring, at the height of the ring's plane; it stands upright; and its handle,
    if it has one, is nowhere under the spout.

    Args:
        state: The state to judge.
        name: Name of the object.
        fixture: Name of the fixture; its asset has the regions "ring" and "spout".
    """
    target = state.info.object(fixture)
    frame = state.pose(fixture)
    ring = frame.apply(target.region("ring").position)
    position = foot(state, name)
    if horizontal_distance(position, ring) > THRESHOLDS.ring_radius:
        return False
    if abs(position[2] - ring[2]) > THRESHOLDS.ring_height or not upright(state, name):
        return False
    return handle_clear(state, name, fixture)


def foot(state: WorldState, name: str) -> Vector:
    """Return the center of an object's foot: of its region "base" if it has one, else of its bounding box [m]."""
    for region in state.info.object(name).regions:
        if region.name == "base":
            return state.pose(name).apply(region.position)
    return state.pose(name).position


def handle_clear(state: WorldState, name: str, fixture: str) -> bool:
    """Tell whether no corner of the object's handle is under the fixture's spout, seen from above."""
    info = state.info.object(name)
    handles = [r for r in info.regions if r.name == "handle"]
    spout = state.info.object(fixture).region("spout")
    to_spout = (state.pose(fixture) @ spout.pose).inverse()
    hx, hy = spout.half_size[0] + THRESHOLDS.spout_margin, spout.half_size[1] + THRESHOLDS.spout_margin
    for handle in handles:
        to_world = state.pose(name) @ handle.pose
        sx, sy, sz = handle.half_size
        for cx in (-sx, 0.0, sx):
            for cy in (-sy, sy):
                x, y, _ = to_spout.apply(to_world.apply((cx, cy, sz)))
                if abs(x) < hx and abs(y) < hy:
                    return False
    return True
