"""Find the hollow and the level surfaces of an object.

The hollow is the space in which water remains after the object is flooded.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from betterbench.sim.assets.importing.solid import Solid

_LEAST_DEPTH_M = 0.004
_LEAST_DEPTH_SHARE = 0.12
"""Minimum depth of a hollow, as a fraction of the object's height. Shallower hollows count as dents."""
_LEAST_AREA_SHARE = 0.12
_PITS = 0.05
_GAP_M, _LEAST_GAPS = 0.012, 12
"""Maximum width of a gap through which objects do not fall [m], and the minimum number of such gaps that make a grid.
Fewer gaps count as leaks."""
_SEAM_CELLS = 2.0
"""Maximum width of a gap that counts as a seam, for example between two collision parts [cells]. Convex hulls end at
sampled points, which are up to one cell apart."""
_STEP_M = 0.0005
_ALMOST = 0.9
_LEVEL_M = 0.002
"""Height range within which a surface counts as level [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Cavity:
    """Hollow of an object. If there are several hollows, this is the one that holds the most water.

    Attributes:
        mask: (nx, ny) columns of the grid that are under water.
        tops: (nx, ny) height of the highest surface in each column [m]; -inf in columns without a surface.
        rim_m: Height at which the hollow would overflow [m].
        floor_m: Height of the floor [m]. It is the 5th percentile of the surface heights, because scans have pits.
        volume_m3: Volume of water that the hollow holds [m^3].
    """

    mask: np.ndarray
    tops: np.ndarray
    rim_m: float
    floor_m: float
    volume_m3: float

    @property
    def depth_m(self) -> float:
        """Depth of the hollow from its rim to its floor [m]."""
        return self.rim_m - self.floor_m


def tops_of(solid: Solid) -> np.ndarray:
    """Return the (nx, ny) heights of the highest surface in each column of cells [m]. Empty columns get -inf."""
    nz = solid.cells.shape[2]
    tops = solid.highest.copy()
    # a column without surface points gets the height of its highest cell
    filled = solid.cells.any(axis=2) & ~np.isfinite(tops)
    highest = nz - 1 - np.argmax(solid.cells[:, :, ::-1], axis=2)
    tops[filled] = (solid.origin[2] + (highest + 0.5) * solid.pitch_m)[filled]
    return tops


def cavity_of(solid: Solid, *, with_seams: bool = False) -> Cavity | None:
    """Return the hollow of an object in its current pose, or None if the object holds hardly any water.

    Args:
        solid: The object.
        with_seams: Whether to treat gaps of up to two cells, such as the seams between convex collision parts, as
            watertight. If False, water flows out through them.
    """
    tops = tops_of(solid)
    if with_seams:
        tops = _without_gaps(tops, solid.pitch_m, most_m=_SEAM_CELLS * solid.pitch_m, least=1)
    tops = _without_gaps(tops, solid.pitch_m, most_m=_GAP_M + solid.pitch_m, least=_LEAST_GAPS)
    level = _water(tops)
    # empty columns are never under water, because both their level and their height are -inf
    depth = np.where(np.isfinite(tops), level - np.where(np.isfinite(tops), tops, 0.0), 0.0)
    height = float(np.ptp(solid.points[:, 2]))
    labels, count = ndimage.label(depth > max(_LEAST_DEPTH_M, _LEAST_DEPTH_SHARE * height))
    if count == 0:
        return None
    area = solid.pitch_m**2
    volumes = ndimage.sum(depth, labels, range(1, count + 1)) * area
    best = int(np.argmax(volumes)) + 1
    mask = labels == best
    if mask.sum() < _LEAST_AREA_SHARE * np.isfinite(tops).sum():
        return None
    rim, floor = float(np.max(level[mask])), float(np.quantile(tops[mask], _PITS))
    return Cavity(mask, tops, rim, floor, float(volumes[best - 1]))


def _without_gaps(tops: np.ndarray, pitch_m: float, *, most_m: float, least: int) -> np.ndarray:
    """Fill the gaps between wires up to the height of the nearest wire.

    A wire basket holds objects but no water. Its hollow can only be found after its gaps are filled.

    Args:
        tops: (nx, ny) height of the highest surface in each column of cells [m].
        pitch_m: Side of a cell [m].
        most_m: Width of the widest gap that is filled [m].
        least: Minimum number of narrow gaps. If there are fewer, no gap is filled.
    """
    footprint = np.isfinite(tops)
    gaps = ndimage.binary_fill_holes(footprint) & ~footprint
    labels, count = ndimage.label(gaps)
    if count < least:
        return tops
    reach, nearest = ndimage.distance_transform_edt(gaps, return_indices=True)
    widths = 2.0 * pitch_m * ndimage.maximum(reach, labels, range(1, count + 1))
    narrow = np.flatnonzero(widths < most_m + 1e-9) + 1
    if len(narrow) < least:
        return tops
    filled = np.isin(labels, narrow)
    return np.where(filled, tops[tuple(nearest)], tops)


def _water(tops: np.ndarray) -> np.ndarray:
    """Return the height of the water in each column of cells after flooding.

    It is the lowest height at which water could flow from the column to the edge of the grid. The algorithm is priority
    flood (Barnes, Lehman and Mulla, 2014), which proceeds from the edge of the grid inward.
    """
    # A frame of columns without a height surrounds the grid. It and the empty columns are the first in the queue, so
    # their neighbors get their own height. Plain floats in a list are several times as fast as elements of an array.
    framed = np.pad(tops, 1, constant_values=-np.inf)
    empty = ~np.isfinite(framed)
    beside = ndimage.binary_dilation(empty) & ~empty
    level, top, width = framed.ravel().tolist(), framed.ravel().tolist(), framed.shape[1]
    open_ = (~(empty | beside)).ravel().tolist()
    queue = [(level[at], at) for at in np.flatnonzero(beside).tolist()]
    heapq.heapify(queue)
    while queue:
        height, at = heapq.heappop(queue)
        for near in (at - width, at + width, at - 1, at + 1):
            if open_[near]:
                open_[near] = False
                level[near] = max(height, top[near])
                heapq.heappush(queue, (level[near], near))
    return np.reshape(level, framed.shape)[1:-1, 1:-1]


def columns_box(solid: Solid, mask: np.ndarray) -> tuple[float, float, float, float]:
    """Return the bounding rectangle of the columns in a mask, as its middle (x, y) and its half extents (x, y) [m]."""
    found = np.argwhere(mask)
    low = solid.origin[:2] + found.min(axis=0) * solid.pitch_m
    high = solid.origin[:2] + (found.max(axis=0) + 1) * solid.pitch_m
    (x, y), (half_x, half_y) = 0.5 * (low + high), 0.5 * (high - low)
    return float(x), float(y), float(half_x), float(half_y)


def level_square(solid: Solid, tops: np.ndarray, height: float) -> tuple[float, float, float] | None:
    """Return the middle (x, y) and half the side [m] of the largest square that is level at the given height [m].

    If several squares have almost the same size, the most central one is returned.
    """
    flat = np.abs(np.where(np.isfinite(tops), tops, np.inf) - height) < _LEVEL_M
    if not flat.any():
        return None
    inside = ndimage.distance_transform_cdt(np.pad(flat, 1), metric="chessboard")[1:-1, 1:-1]
    large = np.argwhere(inside >= _ALMOST * inside.max())
    central = np.linalg.norm(large - np.argwhere(np.isfinite(tops)).mean(axis=0), axis=1)
    i, j = large[int(np.argmin(central))]
    half = (float(inside[i, j]) - 0.5) * solid.pitch_m
    x, y = solid.origin[:2] + (np.array([i, j]) + 0.5) * solid.pitch_m
    return float(x), float(y), half


def floor_square(solid: Solid, cavity: Cavity) -> tuple[float, float, float, float] | None:
    """Return the largest level square on the floor of a hollow, as height, middle (x, y) and half the side [m].

    The floor of a real plate is slightly higher in the middle. The returned height is therefore the height at which
    objects rest. Returns None if no part of the floor is level.
    """
    tops = np.where(cavity.mask, cavity.tops, -np.inf)
    heights = np.arange(cavity.floor_m, cavity.floor_m + 0.35 * cavity.depth_m + _STEP_M, _STEP_M)
    squares = [(square, height) for height in heights if (square := level_square(solid, tops, float(height)))]
    if not squares:
        return None
    (x, y, half), _ = max(squares, key=lambda found: (round(found[0][2], 6), -found[1]))
    inside = np.abs(_middles(solid) - np.array([x, y])).max(axis=2) <= half
    return float(np.quantile(tops[inside & cavity.mask], 0.9)), x, y, half


def _middles(solid: Solid) -> np.ndarray:
    """Return the (nx, ny, 2) horizontal positions of the middles of all columns of cells [m]."""
    i, j = np.meshgrid(*map(np.arange, solid.cells.shape[:2]), indexing="ij")
    return np.asarray(solid.origin[:2] + (np.stack([i, j], axis=2) + 0.5) * solid.pitch_m)


def highest_level(solid: Solid, tops: np.ndarray) -> tuple[float, float, float, float] | None:
    """Return the highest level square of an object as height, middle (x, y) and half the side [m].

    Returns None if there is no such square. The square must cover at least a fifth of the object's footprint, so that
    other objects can stand on it.
    """
    finite = np.isfinite(tops)
    least = 0.5 * float(np.sqrt(0.2 * finite.sum())) * solid.pitch_m
    for height in np.unique(np.round(tops[finite] / _LEVEL_M))[::-1] * _LEVEL_M:
        found = level_square(solid, tops, float(height))
        if found is not None and found[2] >= least:
            return (float(height), *found)
    return None
