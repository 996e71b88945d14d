"""Mass properties of a body that is composed of primitive shapes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.geometry import Vector, rotate
from betterbench.sim.assets.asset import CollisionPart


@dataclass(frozen=True, slots=True)
class MassProperties:
    """Mass, center of mass and inertia of a rigid body, in the same frames and units as in an asset."""

    mass_kg: float
    center_of_mass: Vector
    inertia: tuple[float, float, float, float, float, float]


def volume_of(part: CollisionPart) -> float:
    """Return the volume of a primitive collision part [m^3].

    Raises:
        InvalidInputError: If the part is a hull.
    """
    a, b, c = part.size
    if part.shape == "box":
        return 8.0 * a * b * c
    if part.shape == "cylinder":
        return 2.0 * math.pi * a * a * b
    if part.shape == "sphere":
        return 4.0 / 3.0 * math.pi * a**3
    if part.shape == "ellipsoid":
        return 4.0 / 3.0 * math.pi * a * b * c
    if part.shape == "capsule":
        return math.pi * a * a * (2.0 * b + 4.0 / 3.0 * a)
    raise InvalidInputError("collision part", f"{part.shape!r} has no volume formula", "Use a primitive shape")


def _own_inertia(part: CollisionPart, mass: float) -> np.ndarray:
    """Return the principal moments of inertia of a primitive about its own center and axes [kg m^2]."""
    a, b, c = part.size
    if part.shape == "box":
        return mass / 3.0 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    if part.shape in ("cylinder", "capsule"):
        # approximate a capsule by a cylinder of the same radius and full length, because capsules are used for thin
        # rods
        half = b + a if part.shape == "capsule" else b
        across = mass * (a * a / 4.0 + half * half / 3.0)
        return np.array([across, across, mass * a * a / 2.0])
    if part.shape == "sphere":
        return np.full(3, 0.4 * mass * a * a)
    return mass / 5.0 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])


def mass_properties(
    parts: Sequence[CollisionPart], mass_kg: float, *, densities: Sequence[float] | None = None
) -> MassProperties:
    """Distribute a mass over primitive collision parts, and return the mass properties of the whole body.

    The densities are relative, one for each part. If there are fewer densities than parts, the remaining parts have no
    mass. If ``densities`` is None, all parts have the same density. The results are rounded to nine digits, so that
    they are equal on all machines.

    Raises:
        InvalidInputError: If a part is a hull, or all densities are zero.
    """
    weights = np.array([volume_of(p) for p in parts])
    if densities is not None:
        weights = weights * [*densities, *[0.0] * (len(parts) - len(densities))]
    if weights.sum() <= 0.0:
        raise InvalidInputError("densities", "all densities are zero", "Set at least one positive density")
    masses = mass_kg * weights / weights.sum()
    centers = np.array([p.position for p in parts])
    center = masses @ centers / mass_kg
    total = np.zeros((3, 3))
    for part, mass, offset in zip(parts, masses.tolist(), centers - center, strict=True):
        axes = np.array([rotate(part.quaternion, axis) for axis in np.eye(3).tolist()]).T
        total += axes @ np.diag(_own_inertia(part, mass)) @ axes.T
        total += mass * (float(offset @ offset) * np.eye(3) - np.outer(offset, offset))
    six = (total[0, 0], total[1, 1], total[2, 2], total[0, 1], total[0, 2], total[1, 2])
    # a product of inertia below the rounding error is zero by symmetry
    scale = max(six[:3])
    ixx, iyy, izz, ixy, ixz, iyz = (0.0 if abs(v) < 1e-9 * scale else float(f"{v:.9g}") for v in six)
    x, y, z = (float(f"{v:.9g}") if abs(v) > 1e-9 else 0.0 for v in center)
    return MassProperties(mass_kg, (x, y, z), (ixx, iyy, izz, ixy, ixz, iyz))
