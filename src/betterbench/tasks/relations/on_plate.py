"""Stacking: whether a plate stands in the middle of another one."""

from __future__ import annotations

from betterbench.geometry import tilt_of
from betterbench.state import WorldState
from betterbench.tasks.relations.on_ring import foot
from betterbench.tasks.thresholds import THRESHOLDS


def on_plate(state: WorldState, name: str, plate: str) -> bool:
    """Tell whether an object stands on a plate.

    Its foot is on the plate's floor, near its middle, it lies flat, and the two touch. An object that rests on the rim
    or on a third one is not on the plate.

    Args:
        state: The state to judge.
        name: Name of the object.
        plate: Name of the plate; its asset has the region "floor".
    """
    if name == plate:
        return False
    frame = state.pose(plate)
    x, y, z = frame.inverse().apply(foot(state, name))
    fx, fy, fz = state.info.object(plate).region("floor").position
    if (x - fx) ** 2 + (y - fy) ** 2 > THRESHOLDS.plate_offset**2 or abs(z - fz) > THRESHOLDS.plate_gap:
        return False
    return tilt_of(state.pose(name).quaternion) <= THRESHOLDS.upright_tilt and state.touching(name, plate)
