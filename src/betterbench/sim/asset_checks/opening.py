"""Required jaw opening for a grasp, measured on the grid cells that the visible shape occupies."""

from __future__ import annotations

import numpy as np

from betterbench.geometry import rotate
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.sim.assets import Grasp
from betterbench.sim.assets.importing.grasping import PAD_HALF_HEIGHT_M, PAD_HALF_WIDTH_M
from betterbench.sim.assets.importing.solid import Solid
from betterbench.sim.robots.spec import robot

_NEAR_M = 0.004
"""The stated width of a grasp defines a region between the fingers. This is the maximum distance of the grasped part
from this region [m]."""


def gripper_opening_m(name: str = USUAL_ROBOT) -> float:
    """Return the maximum opening of a robot's gripper [m]."""
    return robot(name).gripper_opening_m


def needed_opening_m(solid: Solid, grasp: Grasp) -> float | None:
    """Return how wide the jaw must open to grasp a part of the object [m].

    Returns None if there is nothing between the pads. The grasped part is the connected row of occupied cells between
    the pads, along the closing direction of the fingers. The jaw closes symmetrically about the grasp pose, so a part
    that is off center needs a wider opening.
    """
    centers = solid.centers(solid.cells) - np.asarray(grasp.pose.position)
    axes = np.array([rotate(grasp.pose.quaternion, axis) for axis in np.eye(3).tolist()])
    x, y, z = (centers @ axis for axis in axes)
    reach = 0.5 * solid.pitch_m
    between = (np.abs(x) < PAD_HALF_WIDTH_M + reach) & (np.abs(z) < PAD_HALF_HEIGHT_M + reach)
    rows = np.unique(np.round(y[between] / solid.pitch_m).astype(int))
    if len(rows) == 0:
        return None
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    spans = [(run[0] * solid.pitch_m, run[-1] * solid.pitch_m) for run in runs]
    half = 0.5 * grasp.width_m + _NEAR_M
    held = [(low, high) for low, high in spans if low < half and high > -half]
    if not held:
        return None
    return float(2.0 * max(max(abs(low), abs(high)) for low, high in held))
