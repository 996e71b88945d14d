"""Rigid bodies in URDF and MJCF files: poses, meshes of primitive shapes, and the combined mass of several parts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from betterbench.errors import InvalidInputError, one_line

MOST_BODIES = 200
"""Maximum number of links or bodies of an object."""
MOST_SHAPES = 500
"""Maximum number of visual and collision shapes of an object."""
_FARTHEST_M = 1000.0
_CURE = "Correct the number in the file"


@dataclass(frozen=True, slots=True, eq=False)
class PointMass:
    """Mass properties of one part of an object.

    Attributes:
        mass_kg: Mass.
        center: (3,) center of mass.
        inertia: (3, 3) inertia tensor about the center of mass.
    """

    mass_kg: float
    center: np.ndarray
    inertia: np.ndarray


def combined(parts: Sequence[PointMass]) -> PointMass | None:
    """Combine the mass properties of rigidly connected parts, using the parallel axis theorem.

    Returns None if the parts have no mass.
    """
    total = sum(part.mass_kg for part in parts)
    if total <= 0.0:
        return None
    center = np.asarray(sum(part.mass_kg * part.center for part in parts)) / total
    inertia = np.zeros((3, 3))
    for part in parts:
        d = part.center - center
        inertia += part.inertia + part.mass_kg * (d @ d * np.eye(3) - np.outer(d, d))
    return PointMass(total, center, inertia)


def numbers(text: str, count: int, where: str, field: str) -> np.ndarray:
    """Parse the numbers in an XML attribute, and return them as a (count,) array.

    Raises:
        InvalidInputError: If there are not exactly ``count`` numbers, or a number is not finite or too large.
    """
    shown = one_line(repr(text), most=60)
    words = text.split()[: count + 1]
    try:
        found = [float(word) for word in words]
    except ValueError:
        found = []
    if len(found) != count or not all(map(math.isfinite, found)):
        raise InvalidInputError(where, f"{field} is {shown}, expected {count} finite numbers", _CURE)
    if max(map(abs, found)) > _FARTHEST_M:
        raise InvalidInputError(where, f"{field} is {shown}, expected numbers of at most {_FARTHEST_M:g}", _CURE)
    return np.array(found)


def pose(xyz: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Combine a position and a (3, 3) rotation into a (4, 4) transform."""
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation, xyz
    return found


def rotation_of_rpy(rpy: np.ndarray) -> np.ndarray:
    """Return the (3, 3) rotation for roll, pitch and yaw [rad] about the fixed axes x, y and z, in this order."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def box(half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and faces of a box with the given half side lengths (3,)."""
    return _arrays(trimesh.creation.box(2.0 * np.asarray(half)))


def ellipsoid(half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and faces of an ellipsoid with the given half axes (3,)."""
    vertices, faces = _arrays(trimesh.creation.icosphere(subdivisions=2))
    return vertices * np.asarray(half), faces


def cylinder(radius: float, half_length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and faces of a cylinder along z."""
    return _arrays(trimesh.creation.cylinder(radius, 2.0 * half_length, sections=32))


def capsule(radius: float, half_length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and faces of a capsule along z. ``half_length`` is half the length of its straight part."""
    vertices, faces = _arrays(trimesh.creation.capsule(2.0 * half_length, radius, count=[16, 16]))
    return vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0)), faces


def _arrays(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
