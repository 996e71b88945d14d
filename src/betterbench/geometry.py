"""Rigid-body geometry: poses, quaternions and rotations.

Conventions of the whole project: lengths are in meters and angles in radians. Quaternions are ``(w, x, y, z)`` with
unit norm, and their sign is chosen so that ``w >= 0``. A pose ``T_a_b`` maps coordinates in frame ``b`` to coordinates
in frame ``a``.

The functions use plain Python floats, because predicates are evaluated at every control step. For such small inputs,
scalar arithmetic is several times faster than NumPy, and it gives bit-identical results during an episode and
afterward.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

IDENTITY_QUATERNION: Quaternion = (1.0, 0.0, 0.0, 0.0)

TOOL_DOWN: Quaternion = (0.0, 1.0, 0.0, 0.0)
"""Rotation of a tool that points straight down, as in the home pose (180 degrees about x)."""


def vector_of(numbers: Iterable[float]) -> Vector:
    """Convert three numbers, such as those of an array, to a vector of Python floats."""
    x, y, z = map(float, numbers)
    return (x, y, z)


def normalize(q: Sequence[float]) -> Quaternion:
    """Return the unit quaternion (w, x, y, z) with ``w >= 0`` that describes the same rotation.

    Raises:
        ValueError: If all components are zero.
    """
    w, x, y, z = map(float, q)
    return unit_quaternion((w, x, y, z))


def unit_quaternion(q: Quaternion) -> Quaternion:
    """Return the same result as :func:`normalize`. This function is faster, but accepts only plain floats."""
    w, x, y, z = q
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if norm == 0.0:
        msg = "a quaternion of zero length is not a rotation"
        raise ValueError(msg)
    if w < 0.0:
        norm = -norm
    return (w / norm, x / norm, y / norm, z / norm)


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the Hamilton product ``a b``, which rotates by ``b`` first and then by ``a``."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """Return the inverse of a unit quaternion."""
    return (q[0], -q[1], -q[2], -q[3])


def turn_between(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return ``b a*``, the rotation that takes ``a`` to ``b``, expressed in the same frame as both arguments.

    The result is bit-identical to ``multiply(b, conjugate(a))``, including the signs of zeros, but takes half the time.
    """
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        bw * aw + bx * ax + by * ay + bz * az,
        bx * aw - bw * ax - by * az + bz * ay,
        bx * az - bw * ay + by * aw - bz * ax,
        -(bw * az) - bx * ay + by * ax + bz * aw,
    )


def rotate(q: Quaternion, v: Sequence[float]) -> Vector:
    """Rotate a vector by the unit quaternion of ``R_a_b``, i.e. from frame ``b`` into frame ``a``."""
    w, x, y, z = q
    vx, vy, vz = v
    tx = 2.0 * (y * vz - z * vy)
    ty = 2.0 * (z * vx - x * vz)
    tz = 2.0 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def from_axis_angle(rotation_vector: Sequence[float]) -> Quaternion:
    """Convert a rotation vector (unit axis times angle [rad]) to a quaternion."""
    x, y, z = map(float, rotation_vector)
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return unit_quaternion((1.0, 0.5 * x, 0.5 * y, 0.5 * z))
    s = math.sin(0.5 * angle) / angle
    return unit_quaternion((math.cos(0.5 * angle), s * x, s * y, s * z))


def to_axis_angle(q: Quaternion) -> Vector:
    """Convert a unit quaternion to a rotation vector (unit axis times angle [rad]) with an angle in [0, pi]."""
    w, x, y, z = unit_quaternion(q)
    s = math.sqrt(x * x + y * y + z * z)
    if s < 1e-12:
        return (2.0 * x, 2.0 * y, 2.0 * z)
    scale = 2.0 * math.atan2(s, w) / s
    return (scale * x, scale * y, scale * z)


def to_axis_angle_near(q: Quaternion, near: Quaternion) -> Vector:
    """Convert a unit quaternion to a rotation vector [rad] that stays continuous when the angle passes pi.

    The rotation angle of a tool that points straight down is pi. With ``w >= 0``, its rotation vector would flip as
    soon as a measured angle exceeds pi. This function therefore chooses the sign of the quaternion that is closer to
    the unit quaternion ``near``, so the angle lies in [0, 2 pi).
    """
    w, x, y, z = q if sum(a * b for a, b in zip(q, near, strict=True)) >= 0.0 else (-q[0], -q[1], -q[2], -q[3])
    s = math.sqrt(x * x + y * y + z * z)
    if s < 1e-12:
        return (2.0 * x, 2.0 * y, 2.0 * z)
    scale = 2.0 * math.atan2(s, w) / s
    return (scale * x, scale * y, scale * z)


def from_yaw(yaw: float) -> Quaternion:
    """Return the rotation by ``yaw`` [rad] about the vertical axis."""
    return normalize((math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)))


def yaw_of(q: Quaternion) -> float:
    """Return the heading of the rotated x axis in the horizontal plane [rad]."""
    w, x, y, z = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def tilt_of(q: Quaternion) -> float:
    """Return the angle between the rotated z axis and the vertical [rad]."""
    _, x, y, _ = q
    return math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y))))


def angle_between(a: Quaternion, b: Quaternion) -> float:
    """Return the angle [rad] of the rotation that takes ``a`` to ``b``. It is in [0, pi]."""
    w, x, y, z = multiply(conjugate(a), b)
    return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w))


def slerp(a: Quaternion, b: Quaternion, fraction: float) -> Quaternion:
    """Interpolate between two rotations along the shorter path: ``fraction`` 0 gives ``a``, 1 gives ``b``."""
    return _even_turn(a, b)(fraction)


def straight_way(start: Pose, goal: Pose) -> Callable[[float], Pose]:
    """Return a function that interpolates poses from ``start`` (at 0) to ``goal`` (at 1), as :func:`slerp` does."""
    (x, y, z), (gx, gy, gz) = start.position, goal.position
    dx, dy, dz = gx - x, gy - y, gz - z
    turned = _even_turn(start.quaternion, goal.quaternion)
    return lambda fraction: Pose((x + fraction * dx, y + fraction * dy, z + fraction * dz), turned(fraction))


def _even_turn(a: Quaternion, b: Quaternion) -> Callable[[float], Quaternion]:
    """Return a function that interpolates rotations along the shorter path from ``a`` (at 0) to ``b`` (at 1)."""
    x, y, z = to_axis_angle(multiply(conjugate(a), b))

    def turned(fraction: float) -> Quaternion:
        return unit_quaternion(multiply(a, from_axis_angle((fraction * x, fraction * y, fraction * z))))

    if x == y == z == 0.0:
        still = turned(1.0)
        return lambda _: still
    return turned


def distance(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the Euclidean distance between two points [m]."""
    dx, dy, dz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


def horizontal_distance(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the distance between two points in the horizontal plane [m]."""
    dx, dy = a[0] - b[0], a[1] - b[1]
    return math.sqrt(dx * dx + dy * dy)


@dataclass(frozen=True, slots=True)
class Pose:
    """Rigid transform ``T_a_b``.

    Attributes:
        position: Origin of frame ``b`` in frame ``a`` [m].
        quaternion: Rotation ``R_a_b`` as (w, x, y, z).
    """

    position: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = IDENTITY_QUATERNION

    def __matmul__(self, other: Pose) -> Pose:
        """Return ``T_a_c`` for ``self = T_a_b`` and ``other = T_b_c``."""
        return Pose(self.apply(other.position), unit_quaternion(multiply(self.quaternion, other.quaternion)))

    def apply(self, point: Sequence[float]) -> Vector:
        """Return the coordinates in frame ``a`` of a point that is given in frame ``b``."""
        x, y, z = rotate(self.quaternion, point)
        return (self.position[0] + x, self.position[1] + y, self.position[2] + z)

    def inverse(self) -> Pose:
        """Return the inverse transform ``T_b_a``."""
        q = conjugate(self.quaternion)
        x, y, z = rotate(q, self.position)
        return Pose((-x, -y, -z), q)

    def translated(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
        """Return the pose after moving it by (x, y, z) [m] in frame ``a``."""
        px, py, pz = self.position
        return Pose((px + x, py + y, pz + z), self.quaternion)
