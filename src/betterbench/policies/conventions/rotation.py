"""Conversion between the rotation formats of policies and betterbench's quaternions (w, x, y, z).

A quaternion and its negative describe the same rotation, but a quaternion with w < 0 corresponds to a rotation vector
longer than pi. All conversions in this module therefore normalize quaternions to w >= 0 with
:func:`betterbench.geometry.normalize`. This is suitable for the small rotations in actions. The rotation of the tool in
a state is usually close to 180 degrees, where this normalization would cause jumps. States are therefore converted by
``_rotation`` in :mod:`betterbench.policies.conventions.proprioception`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from betterbench.geometry import Quaternion, from_axis_angle, normalize, rotate, to_axis_angle

RotationFormat = Literal[
    "quaternion_wxyz",
    "quaternion_xyzw",
    "axis_angle",
    "rpy",
    "rotation_6d",
    "rotation_6d_rows",
    "rotation_6d_interleaved",
    "matrix",
]
"""Name of a rotation format.

``rpy`` are angles [rad] about the fixed axes x, y and z, in this order. ``axis_angle`` is a rotation vector [rad].
``rotation_6d`` contains the first column of the rotation matrix, then the second (Zhou et al. 2019).
``rotation_6d_rows`` contains the first two rows (pytorch3d, GR00T). ``rotation_6d_interleaved`` contains the first two
columns in row-major order (simulators of vla-evaluation-harness). ``matrix`` is the rotation matrix in row-major order.
"""

ROTATION_SIZES: dict[RotationFormat, int] = {
    "quaternion_wxyz": 4,
    "quaternion_xyzw": 4,
    "axis_angle": 3,
    "rpy": 3,
    "rotation_6d": 6,
    "rotation_6d_rows": 6,
    "rotation_6d_interleaved": 6,
    "matrix": 9,
}
"""Number of values in each rotation format."""


def to_format(q: Sequence[float], form: RotationFormat) -> list[float]:
    """Convert a quaternion (w, x, y, z) to another rotation format. Raises ValueError if the quaternion is zero."""
    w, x, y, z = unit = normalize(q)
    if form == "quaternion_wxyz":
        return [w, x, y, z]
    if form == "quaternion_xyzw":
        return [x, y, z, w]
    if form == "axis_angle":
        return list(to_axis_angle(unit))
    matrix = to_matrix(unit)
    if form == "matrix":
        return [float(v) for v in matrix.reshape(9)]
    if form == "rotation_6d":
        return [float(v) for v in matrix[:, :2].T.reshape(6)]
    if form == "rotation_6d_rows":
        return [float(v) for v in matrix[:2].reshape(6)]
    if form == "rotation_6d_interleaved":
        return [float(v) for v in matrix[:, :2].reshape(6)]
    level = math.hypot(matrix[0, 0], matrix[1, 0])
    if level < 1e-9:  # gimbal lock: only roll + yaw or roll - yaw is defined, so yaw is set to zero
        return [math.atan2(-matrix[1, 2], matrix[1, 1]), math.atan2(-matrix[2, 0], level), 0.0]
    return [
        math.atan2(matrix[2, 1], matrix[2, 2]),
        math.atan2(-matrix[2, 0], level),
        math.atan2(matrix[1, 0], matrix[0, 0]),
    ]


def from_format(values: Sequence[float], form: RotationFormat) -> Quaternion:
    """Convert a rotation in a policy's format to a quaternion (w, x, y, z) with w >= 0.

    Raises ValueError if the numbers do not describe a rotation, for example if a quaternion is zero or two matrix
    columns are parallel.
    """
    if form == "quaternion_wxyz":
        return normalize(values)
    if form == "quaternion_xyzw":
        return normalize((values[3], values[0], values[1], values[2]))
    if form == "axis_angle":
        return from_axis_angle(values)
    if form == "rpy":
        half = [0.5 * float(v) for v in values]
        (cr, cp, cy), (sr, sp, sy) = map(math.cos, half), map(math.sin, half)
        return normalize(
            (
                cr * cp * cy + sr * sp * sy,
                sr * cp * cy - cr * sp * sy,
                cr * sp * cy + sr * cp * sy,
                cr * cp * sy - sr * sp * cy,
            )
        )
    v = np.asarray(values, dtype=np.float64)
    if form == "matrix":
        first, second = v.reshape(3, 3)[:, :2].T
    elif form == "rotation_6d":
        first, second = v.reshape(2, 3)
    elif form == "rotation_6d_interleaved":
        first, second = v.reshape(3, 2).T
    else:
        return from_matrix(_orthonormal(*v.reshape(2, 3)).T)
    return from_matrix(_orthonormal(first, second))


def to_matrix(q: Quaternion) -> np.ndarray:
    """Return the rotation matrix (3, 3) of a unit quaternion."""
    return np.array([rotate(q, axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]).T


def from_matrix(matrix: np.ndarray) -> Quaternion:
    """Return the quaternion of a rotation matrix (3, 3).

    The largest of the four components is computed first, and the others are derived from it. This avoids a loss of
    precision when other components are near zero.
    """
    m = matrix
    t = (
        1.0 + m[0, 0] + m[1, 1] + m[2, 2],
        1.0 + m[0, 0] - m[1, 1] - m[2, 2],
        1.0 - m[0, 0] + m[1, 1] - m[2, 2],
        1.0 - m[0, 0] - m[1, 1] + m[2, 2],
    )
    x, y, z = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    rows = ((t[0], x, y, z), (x, t[1], xy, xz), (y, xy, t[2], yz), (z, xz, yz, t[3]))
    return normalize(rows[int(np.argmax(t))])


def _orthonormal(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return a rotation matrix from its approximate first two columns by Gram-Schmidt orthonormalization."""
    length = float(np.linalg.norm(first))
    if length < 1e-9:
        raise ValueError("a matrix with a zero column is not a rotation")
    x = first / length
    y = second - float(x @ second) * x
    length = float(np.linalg.norm(y))
    if length < 1e-9:
        raise ValueError("a matrix with parallel columns is not a rotation")
    y = y / length
    return np.stack([x, y, np.cross(x, y)], axis=1)
