"""Collision shapes: convex primitives, and walls of hollow objects that are made of such primitives."""

import math
from collections.abc import Iterable
from dataclasses import replace

from betterbench.geometry import Vector, from_axis_angle, from_yaw, multiply
from betterbench.sim.assets.asset import CollisionPart
from betterbench.sim.assets.authoring.materials import material


def surfaced(solids: Iterable[CollisionPart], name: str, *, only_plain: bool = False) -> tuple[CollisionPart, ...]:
    """Give collision parts the friction of a material, such as rubber for the handle of a steel object.

    If ``only_plain`` is True, parts that already have a friction of their own keep it.

    Raises:
        UnknownNameError: If there is no such material.
    """
    friction, plain = material(name).friction, CollisionPart("box", (1.0, 1.0, 1.0)).friction
    return tuple(s if only_plain and s.friction != plain else replace(s, friction=friction) for s in solids)


def foot_square(half: float, *, height: float = 0.004, x: float = 0.0) -> CollisionPart:
    """Return the flat square base of a round object, centered at ``x``, with the given half side length [m].

    A cylinder touches a table in one or two points that change at every step, and therefore never comes to rest. The
    four fixed corners of a square keep the object at rest. They must be inside the round footprint. The round part of
    the body should begin 0.5 mm above the ground, so that it only touches the ground when the object tips over.
    """
    return CollisionPart("box", (half, half, 0.5 * height), (x, 0.0, 0.5 * height))


def upright_cylinder(radius: float, low: float, high: float, *, x: float = 0.0) -> CollisionPart:
    """Return a cylinder that stands upright at ``x`` and extends from height ``low`` to height ``high`` [m]."""
    return CollisionPart("cylinder", (radius, 0.5 * (high - low), 0.0), (x, 0.0, 0.5 * (low + high)))


def standing(foot_half: float, *cylinders: tuple[float, float]) -> tuple[CollisionPart, ...]:
    """Return an upright round body made of stacked cylinders, which stands on a :func:`foot_square`.

    Each cylinder is given by its radius and the height of its upper end [m]. The lowest one begins 0.5 mm above the
    ground.
    """
    ends = [0.0005, *(high for _, high in cylinders)]
    upper = (upright_cylinder(r, low, high) for (r, high), low in zip(cylinders, ends, strict=False))
    return foot_square(foot_half), *upper


def spheroid(radius: float, half_height: float, z: float) -> CollisionPart:
    """Return an upright ellipsoid of revolution on the object's vertical axis, with its center at height ``z`` [m]."""
    return CollisionPart("ellipsoid", (radius, radius, half_height), (0.0, 0.0, z))


def solid_box(low: Vector, high: Vector) -> CollisionPart:
    """Return an axis-aligned box, given by two opposite corners [m]."""
    (ax, ay, az), (bx, by, bz) = low, high
    half = (0.5 * (bx - ax), 0.5 * (by - ay), 0.5 * (bz - az))
    return CollisionPart("box", half, (0.5 * (bx + ax), 0.5 * (by + ay), 0.5 * (bz + az)))


def solid_span(x: tuple[float, float], half_y: float, z: tuple[float, float]) -> CollisionPart:
    """Return a box that is symmetric about y = 0 and extends between two positions in x and two heights in z [m]."""
    return solid_box((x[0], -half_y, z[0]), (x[1], half_y, z[1]))


def leaning_box(half: Vector, center: Vector, lean: float) -> CollisionPart:
    """Return a box with the given half sizes and center [m], rotated about the object's y axis by ``lean`` [rad]."""
    return CollisionPart("box", half, center, from_axis_angle((0.0, lean, 0.0)))


def hinged_box(half: Vector, middle: tuple[float, float], angle: float, x: float, z: float) -> CollisionPart:
    """Return a box, such as a lid, that is opened about a hinge.

    It is moved in the same way as a mesh by :meth:`Mesh.hinged`.

    The half sizes are in meters. Before the box is opened, the hinge is at the origin and the center of the box is at
    ``middle`` (x, z) [m].
    """
    c, s = math.cos(angle), math.sin(angle)
    return leaning_box(half, (x + c * middle[0] - s * middle[1], 0.0, z + s * middle[0] + c * middle[1]), -angle)


def ring_of_boards(half: Vector, away: float, z: float, *, x: float = 0.0, lean: float = 0.0) -> list[CollisionPart]:
    """Return the wall of a hollow round object, as eight equal boxes (boards) around a vertical axis at ``x``.

    The half sizes of a board are along the radius, along the circumference and upward. The centers of the boards are at
    height ``z`` and at distance ``away`` from the axis [m]. A positive ``lean`` [rad] tilts the upper ends of the
    boards outward.
    """
    tilt, boards = from_axis_angle((0.0, lean, 0.0)), []
    for angle in (k * math.pi / 4 for k in range(8)):
        turn = multiply(from_yaw(angle), tilt) if lean else from_yaw(angle)
        boards.append(CollisionPart("box", half, (x + away * math.cos(angle), away * math.sin(angle), z), turn))
    return boards


def round_wall(
    radius: float, thickness: float, low: float, high: float, *, x: float = 0.0, half_length: float | None = None
) -> list[CollisionPart]:
    """Return the upright wall of a hollow round object between two heights [m], as a :func:`ring_of_boards`.

    The outer faces of the boards are at distance ``radius`` from the axis. If ``half_length`` is None, each board is
    one side of an octagon.
    """
    along = radius * math.tan(math.pi / 8) if half_length is None else half_length
    up = 0.5 * (high - low)
    return ring_of_boards((0.5 * thickness, along, up), radius - 0.5 * thickness, low + up, x=x)


def flared_walls(foot: float, top: float, height: float, *, wall: float, floor: float) -> tuple[CollisionPart, ...]:
    """Return the collision parts of a hollow round object that widens upward.

    Its floor consists of two crossed plates, which together fill an octagon and stand on their corners. Its wall
    consists of eight leaning boards. ``foot`` and ``top`` are the outer radii at the ground and at ``height``. ``wall``
    and ``floor`` are the thicknesses of wall and floor [m].
    """
    lean, inner_low, inner_top = math.atan2(top - foot, height), foot - wall, top - wall
    half_wall = 0.5 * (height - 0.001) / math.cos(lean)
    board = (0.5 * wall, (inner_top + wall) * math.tan(math.pi / 8.0), half_wall - 0.0005)
    away, middle = 0.5 * (inner_low + inner_top) + 0.5 * wall, 0.001 + 0.5 * (height - 0.001)
    long, short = inner_low - 0.0005, 0.55 * inner_low
    return (
        solid_box((-long, -short, 0.0), (long, short, floor)),
        solid_box((-short, -long, 0.0), (short, long, floor)),
        *ring_of_boards(board, away, middle, lean=lean),
    )


def open_box(
    inner: tuple[float, float], wall: float, floor: float, height: float, *, x: float = 0.0
) -> tuple[CollisionPart, ...]:
    """Return the collision parts of a box without a lid: a floor and four walls.

    ``inner`` gives half the extent of the inside along x and along y. The inside is centered at (``x``, 0) [m].
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
