"""Flat foot that keeps an object from rolling. The fruit in the procedural library stands on such a foot, too."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from betterbench.sim.assets.importing.measures import depth_in_hull

_LEANS = tuple(math.radians(lean) for lean in (3.0, 6.0, 9.0, 12.0))
"""Tilts [rad] from which an object must return to its upright pose. Scans of fruit stand on a face of a few
millimeters, and roll onto another face while a scene settles. A task that requires the fruit to be upright (within 5
degrees) could then not begin."""
_LEAST_LEVER = 0.02
"""Minimum horizontal distance between the center of mass and the contact point of a leaning object, relative to the
height of the center of mass. It is 0 for a sphere."""
_WIDTH = math.tan(math.radians(16.0))
"""Half the side of a foot, relative to the height of the center of mass.

The wider the foot, the larger the lean from which the object returns to its upright pose.
"""
_HEIGHT_M = 0.006
_BELOW_M = 0.0003
"""Depth of the foot below the lowest point, so that only the foot touches the ground [m]."""


def foot_under(hulls: Sequence[np.ndarray], center: np.ndarray) -> np.ndarray | None:
    """Return the corners (8, 3) of a foot under the object, in the object's frame [m].

    Returns None if the object needs no foot, or if no foot fits under it.

    Args:
        hulls: Corners of the object's collision hulls, each (n, 3) [m], with z up.
        center: Center of mass of the object, (3,) [m].
    """
    corners = np.concatenate(list(hulls))
    low = float(corners[:, 2].min())
    height = float(center[2]) - low
    if returns_upright(corners, center):
        return None
    half = _WIDTH * height
    square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]]) + center[:2]
    if any(depth_in_hull(corner, corners[corners[:, 2] <= center[2], :2]) < 0.0 for corner in square):
        return None
    bottom, top = low - _BELOW_M, low + min(_HEIGHT_M, height)
    return np.array([[x, y, z] for z in (bottom, top) for x, y in square])


def returns_upright(corners: np.ndarray, center: np.ndarray) -> bool:
    """Return whether an object would right itself after being tilted by up to 12 degrees in any direction.

    Args:
        corners: (n, 3) corners of the object's collision shape [m], with z up.
        center: (3,) center of mass [m].
    """
    arms = corners - center
    least = -_LEAST_LEVER * float(arms[:, 2].min())
    for turn in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
        along = arms[:, :2] @ np.array([math.cos(turn), math.sin(turn)])
        for lean in _LEANS:
            contact = int(np.argmin(arms[:, 2] * math.cos(lean) - along * math.sin(lean)))
            if along[contact] * math.cos(lean) + arms[contact, 2] * math.sin(lean) < least:
                return False
    return True
