"""Names for places in external data sets. The workspace of an arm is divided into cells, and each cell is one place."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

GAP_SHARE = 0.08
"""Minimum gap between values at which an axis is split into cells, as a fraction of the longest axis's range.
"""
NARROW_SHARE = 0.2
"""Minimum range of an axis that is split into cells, as a fraction of the longest axis's range."""
LEAST_SHARE = 0.05
"""Minimum fraction of all points that a cell must contain."""
CELLS = 3
"""Number of cells along an axis without gaps. The cells contain equal numbers of points."""
SET_OUT_SHARE = 0.1
"""Distance from the start for determining the tool's initial direction, as a fraction of the range of positions.
"""
DIRECTIONS = 8
_MOST_POINTS = 200_000

_Floats = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int64]


def principal_plane(points: _Floats) -> tuple[_Floats, _Floats]:
    """Return the plane in which points (n, d) vary most, as its center (d,) and two directions (2, d)."""
    used = points[:: max(1, len(points) // _MOST_POINTS)]
    middle = used.mean(axis=0)
    _, _, ways = np.linalg.svd(used - middle, full_matrices=False)
    strongest = np.abs(ways).argmax(axis=1)[:, None]
    # The signs of the directions are arbitrary, so they are fixed here.
    ways *= np.sign(np.take_along_axis(ways, strongest, axis=1))
    if len(ways) < 2:
        ways = np.vstack([ways, np.zeros((2 - len(ways), points.shape[1]))])
    return middle, ways[:2]


def in_plane(points: _Floats, plane: tuple[_Floats, _Floats]) -> _Floats:
    """Return the coordinates of points in a plane given by its center and two directions, as an (n, 2) array."""
    middle, ways = plane
    return np.asarray((points - middle) @ ways.T, dtype=np.float64)


def place_names(points: Sequence[_Floats], *, exact: bool) -> list[str]:
    """Return the name of each point's place. The name is the center of all points in the same cell.

    Args:
        points: Points (d,), where d is 2 or 3. The third coordinate (height) is only split where there is a gap.
        exact: Whether the points are positions. If not, their two principal components are used.
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
    """Format a point with enough digits to distinguish the cells of a workspace of the given size."""
    digits = max(0, min(6, 1 - math.floor(math.log10(span / 2.0)))) if span > 0.0 else 2
    return f"({', '.join(f'{value + 0.0:.{digits}f}' for value in point)})"


def _cells(values: _Floats, span: float, *, at_gaps_alone: bool) -> _Ints:
    """Return the index of the cell that each value belongs to.

    The axis is split at gaps between the values. If there are no gaps, it is split into cells with equal numbers of
    values, unless ``at_gaps_alone`` is True.
    """
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
    """Return the direction in which a path in the plane starts, rounded to one of eight directions.

    Return "" if the path does not leave its first point.

    Args:
        points: (T, 2) positions along the path.
        span: Range of all positions of the data set.
    """
    away = points - points[0]
    far = np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) >= SET_OUT_SHARE * span)
    if not far.size:
        return ""
    x, y = away[far[0]]
    turn = round(math.atan2(y, x) / (math.tau / DIRECTIONS)) % DIRECTIONS
    return f"at {360 // DIRECTIONS * turn}°"
