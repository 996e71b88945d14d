"""Optical flow, computed from known poses and depth: how far each visible point moves until the next image [pixel]."""

from __future__ import annotations

import numpy as np

from betterbench.sim.modalities.poses import matrices


def optical_flow(sight: np.ndarray, following: np.ndarray | None, *, focal_px: float) -> np.ndarray:
    """Return how far the point in each pixel moves to the right and down until the next state [pixel].

    The result is a (height, width, 2) float16 array. The depth gives the position of the point. The point moves with
    the body that is visible in its pixel. It is then projected into the camera of the next state, even if it is
    occluded there. The sky is treated as infinitely far away. The flow is NaN for the last state, for which
    ``following`` is None, and for points that move behind the camera.

    Args:
        sight: Rendered view of one state, of the type :func:`betterbench.sim.scenes.sights.sight_type` with depth and
            bodies.
        following: The same view of the next state.
        focal_px: Focal length of the view [pixel].
    """
    bodies, depth = sight["bodies"], sight["depth"]
    rows, columns = depth.shape
    flow = np.zeros((rows, columns, 2), np.float16)
    if following is None:
        flow[:] = np.nan
        return flow
    flat, depths, out = bodies.reshape(-1), depth.reshape(-1), flow.reshape(-1, 2)
    still = np.array_equal(sight["camera"], following["camera"])
    moved = (sight["poses"] != following["poses"]).any(axis=1)
    for number in np.flatnonzero(np.bincount(flat)):
        body = int(number) - 1  # -1 is the sky
        if still and (body < 0 or body >= len(moved) or not moved[body]):
            continue
        pixels = np.flatnonzero(flat == number)
        step = _step(sight, following, body)
        if step is None:
            continue
        out[pixels] = _moves(pixels, depths[pixels], step, size=(columns, rows), focal_px=focal_px)
    return flow


def _step(sight: np.ndarray, following: np.ndarray, body: int) -> np.ndarray | None:
    """Return the matrix (3, 4) that maps points of a body from camera coordinates in one state to those in the next.

    The body -1 is the sky. The result is None if the model does not have the body.
    """
    here, there = matrices(np.stack([sight["camera"], following["camera"]]))
    step = np.linalg.inv(there)
    if body < 0:
        step = step @ here
        step[:3, 3] = 0.0
        return np.asarray(step[:3])
    if body >= len(sight["poses"]):
        return None
    before, after = matrices(np.stack([sight["poses"][body], following["poses"][body]]))
    return np.asarray((step @ after @ np.linalg.inv(before) @ here)[:3])


def _moves(
    pixels: np.ndarray, depths: np.ndarray, step: np.ndarray, *, size: tuple[int, int], focal_px: float
) -> np.ndarray:
    """Return the motion (n, 2) of the points in the given pixels [pixel]. ``step`` is the motion of their body."""
    columns, rows = size
    z = np.where(np.isfinite(depths), depths, np.float32(1.0)).astype(np.float64)
    v, u = np.divmod(pixels, columns)
    x, y = (u - 0.5 * (columns - 1)) / focal_px * z, (v - 0.5 * (rows - 1)) / focal_px * z
    moved = step[:, :1] * x + step[:, 1:2] * y + step[:, 2:3] * z + step[:, 3:]
    ahead = moved[2] > 0.0
    scale = focal_px / np.where(ahead, moved[2], np.nan)
    to = np.stack([moved[0] * scale + 0.5 * (columns - 1) - u, moved[1] * scale + 0.5 * (rows - 1) - v], axis=1)
    most = float(np.finfo(np.float16).max)
    return np.asarray(np.clip(to, -most, most))
