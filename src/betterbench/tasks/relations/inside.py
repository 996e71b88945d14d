"""Containment: whether an object is in a container that is open at the top."""

from __future__ import annotations

from betterbench.state import WorldState
from betterbench.tasks.thresholds import THRESHOLDS


def inside(state: WorldState, name: str, container: str) -> bool:
    """Tell whether an object is inside a container.

    The center of the object's bounding box must lie within the container's inner box: between its walls, above its
    floor and below its rim. An object that leans over the rim with its greater part outside is not inside, one that
    sticks out at the top while its center is below the rim is. What still stands on the table is never inside.

    Args:
        state: The state to judge.
        name: Name of the object.
        container: Name of the container; its asset has a region "inside".
    """
    if state.touching(name, "table"):
        return False
    info = state.info.object(name)
    region = state.info.object(container).region("inside")
    center = state.pose(name).apply((0.0, 0.0, 0.5 * info.size_m[2]))
    x, y, z = (state.pose(container) @ region.pose).inverse().apply(center)
    hx, hy, hz = region.half_size
    margin = THRESHOLDS.inside_margin
    return abs(x) <= hx - margin and abs(y) <= hy - margin and -hz <= z <= hz
