"""Search for top-down grasps with a parallel-jaw gripper, based on the grid cells that an object occupies."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from betterbench.geometry import Pose, from_yaw, multiply, normalize
from betterbench.sim.assets.asset import Grasp
from betterbench.sim.assets.authoring.draft import JAW_OPENS_ALONG_Y
from betterbench.sim.assets.importing.solid import Solid

PAD_HALF_WIDTH_M = 0.010
PAD_HALF_HEIGHT_M = 0.009
FINGER_M = 0.013
"""Free space that a finger needs next to the object [m]."""
LEAST_WIDTH_M, MOST_WIDTH_M = 0.004, 0.076
DEEPEST_M = 0.045
"""Maximum height of the object above the center of the pads [m], limited by the underside of the gripper."""
LOWEST_M = 0.010
"""Minimum height of the pad centers above the table [m]."""

_STEP_M = 0.002
_YAWS = 12
_FAR = 1000
"""Number of free grid squares that are assumed next to the outermost part of an object."""
_ROUND_M = 0.003
_LEAST_CONTACT_M, _FLAT_M = 0.010, 0.025
"""Minimum height of a pad's contact area [m], and the height of an object above which this minimum applies [m]."""
_STEEPEST = math.tan(math.radians(35.0))
"""Maximum inward slope of an object's sides [tangent]. It is less than the 50 degrees of the pads' friction cone,
because the grid cells are coarse."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A possible grasp and its cost. Grasps with a lower cost are better."""

    grasp: Grasp
    cost: float


def proposals(solid: Solid, center_of_mass: np.ndarray, *, count: int = 8) -> list[Proposal]:
    """Return the grasps that the shape of the object allows, best first.

    Args:
        solid: The object in its upright pose.
        center_of_mass: Center of mass of the object, (3,) [m].
        count: Maximum number of grasps to return. The returned grasps differ in position, direction or height.
    """
    centers = solid.centers(solid.cells)
    top = float(centers[:, 2].max()) + 0.5 * solid.pitch_m
    squares = [_squares(centers, solid.pitch_m, math.pi * turn / _YAWS) for turn in range(_YAWS)]
    found: list[Proposal] = []
    for height in _heights(top):
        for at in squares:
            found += _at(at, centers[:, 2], solid.pitch_m, center_of_mass, height)
    found.sort(key=lambda proposal: proposal.cost)
    if _is_round(found):
        found = [Proposal(_free_to_turn(p.grasp), p.cost) for p in found]
    return _different(found, count)


def _heights(top: float) -> tuple[float, ...]:
    """Return the heights of the pads' center at which grasps are tried [m], starting with the lowest."""
    lowest = max(LOWEST_M, top - DEEPEST_M)
    if top - 0.004 <= lowest:
        return (max(0.5 * top, 0.004),)
    highest = max(lowest, top - 0.012)
    return tuple(float(h) for h in np.unique(np.round(np.linspace(lowest, highest, 3), 4)))


@dataclass(frozen=True, slots=True, eq=False)
class _Squares:
    """Horizontal grid of squares that is aligned with the closing direction of the fingers.

    It maps each cell to a square.

    Attributes:
        yaw: Angle of the gripper about the vertical [rad].
        along: (2,) unit vector in the direction in which the fingers close.
        across: (2,) unit vector perpendicular to ``along``.
        low: Smallest coordinates of the grid along and across [m].
        shape: Number of rows (along) and of columns (across).
        i: (n,) row of each cell.
        j: (n,) column of each cell.
    """

    yaw: float
    along: np.ndarray
    across: np.ndarray
    low: tuple[float, float]
    shape: tuple[int, int]
    i: np.ndarray
    j: np.ndarray


def _squares(centers: np.ndarray, pitch: float, yaw: float) -> _Squares:
    along, across = np.array([-math.sin(yaw), math.cos(yaw)]), np.array([math.cos(yaw), math.sin(yaw)])
    u, v = centers[:, :2] @ along, centers[:, :2] @ across
    low_u, low_v = u.min() - pitch, v.min() - pitch
    shape = (int((u.max() - low_u) / _STEP_M) + 3, int((v.max() - low_v) / _STEP_M) + 3)
    i, j = ((u - low_u) / _STEP_M).astype(int), ((v - low_v) / _STEP_M).astype(int)
    return _Squares(yaw, along, across, (low_u, low_v), shape, i, j)


def _at(squares: _Squares, z: np.ndarray, pitch: float, middle: np.ndarray, height: float) -> Iterator[Proposal]:
    """Yield the grasps at the given height for which the fingers close along the grid."""
    (low_u, low_v), along, across = squares.low, squares.along, squares.across
    near = np.abs(z - height) < PAD_HALF_HEIGHT_M
    slab = _grid(squares, near, pitch)
    half = max(1, round(PAD_HALF_WIDTH_M / _STEP_M))
    columns = np.arange(half, squares.shape[1] - half, 2)
    blocked = _any_near(_grid(squares, z > height - PAD_HALF_HEIGHT_M, pitch), half)[:, columns]
    touched = _any_near(slab, half)[:, columns]
    top = float(z.max())
    between: _ByColumn | None = None
    for k, start, end, room in _fitting(blocked, touched):
        column, width = int(columns[k]), (end - start) * _STEP_M
        held, touch = slab[:, column - half : column + half + 1], touched[start:end, k]
        first, last = start + int(np.argmax(touch)), end - int(np.argmax(touch[::-1]))
        if (first - start) + (end - last) > 2:
            continue  # the pads would hit an overhang before they touch the part between them
        patch = min(held[first : first + 2].any(axis=0).mean(), held[last - 2 : last].any(axis=0).mean())
        if patch < 0.3:
            continue
        if between is None:
            between = _by_column(squares.i[near], squares.j[near], z[near])
        if _leans(between, (first, last), (column - half, column + half), pitch=pitch, top=top):
            continue
        at_u, at_v = low_u + 0.5 * (first + last) * _STEP_M, low_v + (column + 0.5) * _STEP_M
        x, y = at_u * along + at_v * across
        off = math.hypot(float(at_u - middle[:2] @ along), float(at_v - middle[:2] @ across))
        cost = off / 0.02 + (1.0 - float(patch)) + 8.0 * max(0.0, width - 0.06) / 0.02 + abs(height - middle[2]) / 0.06
        clearance = round(min(room, 0.5 * (0.080 - width), 0.012), 4)
        if clearance < 0.002:
            continue
        pose = Pose((float(x), float(y), height), normalize(multiply(from_yaw(squares.yaw), JAW_OPENS_ALONG_Y)))
        yield Proposal(Grasp("body", pose, round(float(width), 4), clearance), float(cost))


def _fitting(blocked: np.ndarray, touched: np.ndarray) -> Iterator[tuple[int, int, int, float]]:
    """Yield all runs of blocked squares that fit between the fingers and would be touched by the pads.

    The runs are yielded column by column.

    Each run is given by its column, its first row, the row after its last row, and the free space [m] on its narrower
    side. All squares beyond the grid count as free.
    """
    rows, columns = blocked.shape
    framed = np.zeros((columns, rows + 2), dtype=bool)
    framed[:, 1:-1] = blocked.T
    (column, start), (_, end) = np.nonzero(framed[:, 1:] > framed[:, :-1]), np.nonzero(framed[:, 1:] < framed[:, :-1])
    follows = column[1:] == column[:-1]
    gap = np.where(follows, start[1:] - end[:-1], _FAR)
    room = np.minimum(np.append(_FAR, gap), np.append(gap, _FAR)) * _STEP_M
    width = (end - start) * _STEP_M
    for k in np.flatnonzero((width >= LEAST_WIDTH_M) & (width <= MOST_WIDTH_M) & (room >= FINGER_M)):
        if touched[start[k] : end[k], column[k]].any():
            yield int(column[k]), int(start[k]), int(end[k]), float(room[k])


@dataclass(frozen=True, slots=True, eq=False)
class _ByColumn:
    """Cells at the height of the pads, sorted by column: their columns (k,), rows (k,) and heights (k,) [m]."""

    columns: np.ndarray
    rows: np.ndarray
    heights: np.ndarray


def _by_column(rows: np.ndarray, columns: np.ndarray, heights: np.ndarray) -> _ByColumn:
    order = np.argsort(columns)
    return _ByColumn(columns[order], rows[order], heights[order])


def _leans(between: _ByColumn, rows: tuple[int, int], columns: tuple[int, int], *, pitch: float, top: float) -> bool:
    """Return whether the gripper pads would slip off the object upward.

    They would if the contact area is not high enough, or if the sides of the object lean inward.

    Args:
        between: Cells at the height of the pads.
        rows: First row between the pads, and the row after the last one.
        columns: First and last column of the pads.
        pitch: Side of a cell [m].
        top: Height of the object [m].
    """
    low, high = np.searchsorted(between.columns, (columns[0], columns[1] + 1))
    row = between.rows[low:high]
    inside = (row >= rows[0]) & (row < rows[1])
    u, z = row[inside] * _STEP_M, between.heights[low:high][inside]
    tall = float(np.ptp(z)) + pitch if len(z) else 0.0
    if tall < _LEAST_CONTACT_M and top > _FLAT_M:
        return True
    if tall < 3.0 * pitch:
        return False
    upper = u[z > z.min() + 0.5 * tall]
    return float(np.ptp(u) - np.ptp(upper)) > _STEEPEST * tall + 2.0 * pitch


def _grid(squares: _Squares, which: np.ndarray, pitch: float) -> np.ndarray:
    """Mark the squares of the grid that contain selected cells, and close the gaps between coarse cells."""
    closing = max(1, math.ceil(0.75 * pitch / _STEP_M))
    rows, columns = squares.shape
    grid = np.zeros((rows + 2 * closing, columns + 2 * closing), dtype=bool)
    grid[squares.i[which] + closing, squares.j[which] + closing] = True
    for _ in range(2):
        grid = _any_near(grid, closing).T
    for _ in range(2):
        grid = ~_any_near(~grid, closing).T
    return grid[closing:-closing, closing:-closing]


def _any_near(grid: np.ndarray, half: int) -> np.ndarray:
    """Return, for each square, whether any square at most ``half`` columns away is True.

    Squares beyond the grid count as False. The function uses differences of cumulative sums, which are ten times as
    fast as a reduction over each window.
    """
    rows, columns = grid.shape
    sums = np.zeros((rows, columns + 2 * half + 1), dtype=np.int32)
    np.cumsum(grid, axis=1, out=sums[:, half + 1 : half + 1 + columns])
    sums[:, half + 1 + columns :] = sums[:, half + columns, None]
    return np.asarray(sums[:, 2 * half + 1 :] > sums[:, :columns])


def _is_round(found: list[Proposal]) -> bool:
    """Return whether the object can be grasped across its middle from every direction, with the same width."""
    if not found:
        return False
    best = found[0].grasp
    x, y, z = best.pose.position
    same = [
        p.grasp
        for p in found
        if abs(p.grasp.pose.position[2] - z) < 1e-6
        and math.hypot(p.grasp.pose.position[0] - x, p.grasp.pose.position[1] - y) < 0.004
    ]
    turns = {round(math.atan2(g.pose.quaternion[2], g.pose.quaternion[1]), 3) for g in same}
    widths = [g.width_m for g in same]
    return len(turns) == _YAWS and max(widths) - min(widths) < _ROUND_M


def _free_to_turn(grasp: Grasp) -> Grasp:
    return Grasp(grasp.name, grasp.pose, grasp.width_m, grasp.clearance_m, True, grasp.preference)


def _different(found: list[Proposal], count: int) -> list[Proposal]:
    """Return the best grasp of each group of similar grasps.

    Each returned grasp gets its own name and its own rank of preference.
    """
    kept: list[Proposal] = []
    for proposal in found:
        if all(_apart(proposal.grasp, other.grasp) for other in kept):
            kept.append(proposal)
        if len(kept) == count:
            break
    return [
        Proposal(
            Grasp(
                "body" if k == 0 else f"body{k + 1}",
                p.grasp.pose,
                p.grasp.width_m,
                p.grasp.clearance_m,
                p.grasp.symmetric_yaw,
                k,
            ),
            p.cost,
        )
        for k, p in enumerate(kept)
    ]


def _apart(a: Grasp, b: Grasp) -> bool:
    """Return whether two grasps clearly differ, by more than 12 mm in position or 40 degrees in direction."""
    distance = math.dist(a.pose.position, b.pose.position)
    turn = abs(float(np.dot(a.pose.quaternion, b.pose.quaternion)))
    return distance > 0.012 or (turn < math.cos(math.radians(20.0)) and not a.symmetric_yaw)
