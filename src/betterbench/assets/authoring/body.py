"""Mass, centre of mass and inertia of a body made of simple solids."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from betterbench.assets.asset import CollisionPart
from betterbench.errors import InvalidInputError
from betterbench.geometry import Vector, from_axis_angle, from_yaw, multiply, rotate

Inertia = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class MassProperties:
    """Mass properties of a rigid body.

    Attributes:
        mass_kg: Mass [kg].
        centre_of_mass: In the object frame [m].
        inertia: About the centre of mass, axes of the object frame (ixx, iyy, izz, ixy, ixz, iyz) [kg m^2].
    """

    mass_kg: float
    centre_of_mass: Vector
    inertia: Inertia


def volume_of(part: CollisionPart) -> float:
    """Return the volume of a primitive [m^3].

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
    """Return the principal moments of a primitive about its own centre and axes [kg m^2]."""
    a, b, c = part.size
    if part.shape == "box":
        return mass / 3.0 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    if part.shape == "cylinder":
        across = mass * (a * a / 4.0 + b * b / 3.0)
        return np.array([across, across, mass * a * a / 2.0])
    if part.shape == "capsule":
        # Close enough for the thin rods it is used for: a cylinder of the same radius and full length.
        half = b + a
        across = mass * (a * a / 4.0 + half * half / 3.0)
        return np.array([across, across, mass * a * a / 2.0])
    if part.shape == "sphere":
        return np.full(3, 0.4 * mass * a * a)
    return mass / 5.0 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])


def mass_properties(
    parts: Sequence[CollisionPart], mass_kg: float, *, densities: Sequence[float] | None = None
) -> MassProperties:
    """Spread a mass over solids.

    Args:
        parts: Primitives that stand for the material (usually the collision parts).
        mass_kg: Total mass [kg].
        densities: Relative density of each part, zero for those after the last number; equal if not given.

    Returns:
        The mass properties, rounded to nine digits so that the last bits of a sine do not matter.

    Raises:
        InvalidInputError: If a part is a hull, or all densities are zero.
    """
    weights = np.array([volume_of(p) for p in parts])
    if densities is not None:
        weights = weights * [*densities, *[0.0] * (len(parts) - len(densities))]
    if weights.sum() <= 0.0:
        raise InvalidInputError("densities", "no part has any mass", "Give at least one positive density")
    masses = mass_kg * weights / weights.sum()
    centres = np.array([p.position for p in parts])
    centre = masses @ centres / mass_kg
    total = np.zeros((3, 3))
    for part, mass, offset in zip(parts, masses.tolist(), centres - centre, strict=True):
        axes = np.array([rotate(part.quaternion, axis) for axis in np.eye(3).tolist()]).T
        total += axes @ np.diag(_own_inertia(part, mass)) @ axes.T
        total += mass * (float(offset @ offset) * np.eye(3) - np.outer(offset, offset))
    six = (total[0, 0], total[1, 1], total[2, 2], total[0, 1], total[0, 2], total[1, 2])
    # A product of inertia far below rounding is zero by symmetry.
    scale = max(six[:3])
    ixx, iyy, izz, ixy, ixz, iyz = (0.0 if abs(v) < 1e-9 * scale else float(f"{v:.9g}") for v in six)
    x, y, z = (float(f"{v:.9g}") if abs(v) > 1e-9 else 0.0 for v in centre)
    return MassProperties(mass_kg, (x, y, z), (ixx, iyy, izz, ixy, ixz, iyz))


def foot(half: float, *, height: float = 0.004) -> CollisionPart:
    """Return the flat square on which a round thing stands.

    A cylinder on a box touches it in one or two points that change from step to step; four fixed corners stand still.
    The round part of the body should start 0.5 mm above the ground, so that it only meets the ground when tipped.

    Args:
        half: Half the side of the square [m]; its corners must stay inside the round footprint.
        height: Thickness [m].
    """
    return CollisionPart("box", (half, half, 0.5 * height), (0.0, 0.0, 0.5 * height))


def upright_cylinder(radius: float, low: float, high: float, *, x: float = 0.0) -> CollisionPart:
    """Return a standing cylinder on a vertical axis at ``x`` from height ``low`` to ``high`` [m]."""
    return CollisionPart("cylinder", (radius, 0.5 * (high - low), 0.0), (x, 0.0, 0.5 * (low + high)))


def standing(foot_half: float, *cylinders: tuple[float, float]) -> tuple[CollisionPart, ...]:
    """Return a round body that stands on a :func:`foot`: cylinders one on another.

    Args:
        foot_half: Half the side of the foot [m].
        *cylinders: Radius and upper end of each cylinder [m], from the lowest, which starts 0.5 mm above the ground.
    """
    ends = [0.0005, *(high for _, high in cylinders)]
    return (foot(foot_half), *(upright_cylinder(r, low, high) for (r, high), low in zip(cylinders, ends, strict=False)))


def spheroid(radius: float, half_height: float, z: float) -> CollisionPart:
    """Return an upright ellipsoid of revolution on the object's axis with its centre at height ``z`` [m]."""
    return CollisionPart("ellipsoid", (radius, radius, half_height), (0.0, 0.0, z))


def solid_box(low: Vector, high: Vector) -> CollisionPart:
    """Return the axis-aligned box between two opposite corners [m]."""
    half = (0.5 * (high[0] - low[0]), 0.5 * (high[1] - low[1]), 0.5 * (high[2] - low[2]))
    centre = (0.5 * (high[0] + low[0]), 0.5 * (high[1] + low[1]), 0.5 * (high[2] + low[2]))
    return CollisionPart("box", half, centre)


def leaning_box(half: Vector, centre: Vector, lean: float) -> CollisionPart:
    """Return a box with half sizes and a centre [m], turned about the object's y axis by ``lean`` [rad]."""
    return CollisionPart("box", half, centre, from_axis_angle((0.0, lean, 0.0)))


def ring_of_boards(half: Vector, away: float, z: float, *, x: float = 0.0, lean: float = 0.0) -> list[CollisionPart]:
    """Return eight equal boxes around a vertical axis: the wall of a hollow round thing.

    Args:
        half: Half sizes of a board along the radius, along the circumference and upwards [m].
        away: Distance of the middle of a board from the axis [m].
        z: Height of the middle of a board [m].
        x: Position of the axis along x [m].
        lean: How far a board is turned about the circumference [rad]; positive leans its upper end outwards.
    """
    tilt = from_axis_angle((0.0, lean, 0.0))
    return [
        CollisionPart(
            "box",
            half,
            (x + away * math.cos(angle), away * math.sin(angle), z),
            multiply(from_yaw(angle), tilt) if lean else from_yaw(angle),
        )
        for angle in (k * math.pi / 4 for k in range(8))
    ]


def open_box(
    inner: tuple[float, float], wall: float, floor: float, height: float, *, x: float = 0.0
) -> tuple[CollisionPart, ...]:
    """Return a floor and four walls around a rectangular inside.

    Args:
        inner: Half extents of the inside along x and y [m].
        wall: Thickness of the walls [m].
        floor: Thickness of the floor [m].
        height: Height of the rim [m].
        x: Position of the middle along x [m].
    """
    ix, iy = inner
    ox, oy = ix + wall, iy + wall
    return (
        solid_box((x - ox, -oy, 0.0), (x + ox, oy, floor)),
        solid_box((x + ix, -oy, floor), (x + ox, oy, height)),
        solid_box((x - ox, -oy, floor), (x - ix, oy, height)),
        solid_box((x - ix, iy, floor), (x + ix, oy, height)),
        solid_box((x - ix, -oy, floor), (x + ix, -iy, height)),
    )
