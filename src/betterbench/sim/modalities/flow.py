"""Optical flow from known poses and depth: displacement of each visible point in the next image [pixel]."""

from __future__ import annotations

import numpy as np

from betterbench.sim.modalities.poses import matrices


def optical_flow(sight: np.ndarray, following: np.ndarray | None, *, focal_px: float) -> np.ndarray:
    """Return (height, width, 2) float16, the motion of the point at each pixel to the right and down [pixel].

    The point is located by the depth and moves with the body shown in its pixel. It is then projected into the camera
    in the next state, whether or not it is occluded there. The sky is infinitely far away. The result is NaN in the
    last state, where ``following`` is None, and if the point moves behind the camera.

    Args:
        sight: Sight of one state, from :func:`betterbench.sim.scenes.sights.sight_type` with depth and bodies.
        following: Sight of the next state in the same view.
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
        body = int(number) - 1  # -1: the sky
        if still and (body < 0 or body >= len(moved) or not moved[body]):
            continue
        pixels = np.flatnonzero(flat == number)
        step = _step(sight, following, body)
        if step is None:
            continue
        out[pixels] = _moves(pixels, depths[pixels], step, size=(columns, rows), focal_px=focal_px)
    return flow


def _step(sight: np.ndarray, following: np.ndarray, body: int) -> np.ndarray | None:
    """Return the (3, 4) motion of a body from one state's camera frame to the next, or None without a body."""
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
    """Return the (n, 2) motion of some pixels, by their index in the image, caused by the motion of their bodies."""
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
