"""Operations on arrays of poses (n, 7), each with a position [m] and a unit quaternion (w, x, y, z)."""

from __future__ import annotations

import numpy as np


def rotations(quaternions: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (n, 3, 3) of unit quaternions (n, 4)."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )


def products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the products (n, 4) of quaternions, each with w >= 0.

    One of the two arguments may be a single quaternion (4,).
    """
    (aw, ax, ay, az), (bw, bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    product = np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )
    return np.asarray(np.where(product[..., :1] < 0.0, -product, product))


def in_frame(poses: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Convert poses ``T_world_x`` (n, 7) to ``T_frame_x``, given the pose of the frame ``T_world_frame`` (7,)."""
    turned = rotations(frame[None, 3:])[0]
    conjugate = frame[3:] * np.array([1.0, -1.0, -1.0, -1.0])
    return np.concatenate([(poses[:, :3] - frame[:3]) @ turned, products(conjugate, poses[:, 3:])], axis=1)


def points_of(poses: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Transform points (n, 3) to the world frame. Each point is given in the frame of its own pose."""
    return np.asarray(np.einsum("nij,nj->ni", rotations(poses[:, 3:]), local) + poses[:, :3])


def matrices(poses: np.ndarray) -> np.ndarray:
    """Return the homogeneous matrices (n, 4, 4) of poses (n, 7)."""
    made = np.zeros((len(poses), 4, 4))
    made[:, :3, :3], made[:, :3, 3], made[:, 3, 3] = rotations(poses[:, 3:]), poses[:, :3], 1.0
    return made
