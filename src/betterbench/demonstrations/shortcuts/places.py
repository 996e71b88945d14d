"""Names of places in external data: cells of an arm's workspace, split at gaps between the points."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

GAP_SHARE = 0.08
"""Minimum gap between neighboring values at which an axis is split into cells, relative to the range of the longest
axis.
"""
NARROW_SHARE = 0.2
"""Minimum range of an axis that is split into cells, relative to the longest axis."""
LEAST_SHARE = 0.05
"""Minimum share of all values in a cell."""
CELLS = 3
"""Number of cells on an axis without gaps, which contain equal numbers of values."""
SET_OUT_SHARE = 0.1
"""Path length of the tool after which its direction is determined, relative to the range of positions."""
DIRECTIONS = 8
_MOST_POINTS = 200_000

_Floats = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int64]


def principal_plane(points: _Floats) -> tuple[_Floats, _Floats]:
    """Return the mean of points (n, d), and the two directions (2, d) of largest variance."""
    used = points[:: max(1, len(points) // _MOST_POINTS)]
    middle = used.mean(axis=0)
    _, _, ways = np.linalg.svd(used - middle, full_matrices=False)
    strongest = np.abs(ways).argmax(axis=1)[:, None]
    ways *= np.sign(np.take_along_axis(ways, strongest, axis=1))  # the sign of a direction is arbitrary
    if len(ways) < 2:
        ways = np.vstack([ways, np.zeros((2 - len(ways), points.shape[1]))])
    return middle, ways[:2]


def in_plane(points: _Floats, plane: tuple[_Floats, _Floats]) -> _Floats:
    """Return the coordinates (n, 2) of points in a plane."""
    middle, ways = plane
    return np.asarray((points - middle) @ ways.T, dtype=np.float64)


def place_names(points: Sequence[_Floats], *, exact: bool) -> list[str]:
    """Return a place name for each point, which is the center of the points in its cell.

    Args:
        points: Points (d,), d is 2 or 3. The third coordinate (height) is only split at gaps.
        exact: Whether the points are positions. Otherwise, their two principal components are used.
    """
    if not points:
        return []
    found = np.array(points)
    if not exact:
        found = in_plane(found, principal_plane(found))
    low, high = np.quantile(found, [0.01, 0.99], axis=0)
    span = float((high - low).max())
    cells = np.column_stack([_cells(found[:, i], span, at_gaps_alone=i == 2) for i in range(found.shape[1])])
    tall = bool(cells.shape[1] == 3 and len(set(cells[:, 2].tolist())) > 1)
    names: dict[tuple[int, ...], str] = {}
    for cell in {tuple(row) for row in cells.tolist()}:
        middle = found[(cells == cell).all(axis=1)].mean(axis=0)
        names[cell] = _written(middle[: 3 if tall else 2], span)
    return [names[tuple(row)] for row in cells.tolist()]


def _written(point: _Floats, span: float) -> str:
    """Format a point with enough digits to distinguish the cells of a span."""
    digits = max(0, min(6, 1 - math.floor(math.log10(span / 2.0)))) if span > 0.0 else 2
    return f"({', '.join(f'{value + 0.0:.{digits}f}' for value in point)})"


def _cells(values: _Floats, span: float, *, at_gaps_alone: bool) -> _Ints:
    """Return the cell index of each value. The cells are split at gaps or, without gaps, have equal counts."""
    ordered = np.sort(values)
    low, high = np.quantile(ordered, [0.01, 0.99])
    if high - low <= NARROW_SHARE * span:
        return np.zeros(len(values), dtype=np.int64)
    wide = np.flatnonzero(np.diff(ordered) > GAP_SHARE * span) + 1
    least = max(2, math.ceil(LEAST_SHARE * len(ordered)))
    cuts, last = [], 0
    for i in wide.tolist():
        if i - last >= least and len(ordered) - i >= least:
            cuts.append((ordered[i - 1] + ordered[i]) / 2.0)
            last = i
    if not cuts and not at_gaps_alone:
        cuts = np.quantile(ordered, [i / CELLS for i in range(1, CELLS)]).tolist()
    return np.searchsorted(np.array(cuts), values, side="right").astype(np.int64)


def direction(points: _Floats, span: float) -> str:
    """Return the first direction of a path in the plane, one of eight, or "" if the path does not move.

    Args:
        points: (T, 2) positions.
        span: Range of all positions of the data set.
    """
    away = points - points[0]
    far = np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) >= SET_OUT_SHARE * span)
    if not far.size:
        return ""
    x, y = away[far[0]]
    turn = round(math.atan2(y, x) / (math.tau / DIRECTIONS)) % DIRECTIONS
    return f"at {360 // DIRECTIONS * turn}°"
