"""Rest and motion of a gripper, computed from its path. The functions work for simulated and for real arms."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from betterbench.diagnosis.thresholds import (
    DRIFT,
    HALT_RADIUS,
    LEAST_REGION,
    SEARCH_STEP,
    TO_AND_FRO,
    TO_AND_FRO_TRAVEL,
)
from betterbench.tasks import THRESHOLDS
from betterbench.tasks.judging.motion import Bools, Floats


def steps_in(seconds: float, rate_hz: float) -> int:
    """Return the number of control steps in a duration. The result is at least 1."""
    return max(1, round(seconds * rate_hz))


def path_length(tool: Floats) -> Floats:
    """Return the length of the path up to each row (T,) [m], given the gripper's positions (T, 3) [m]."""
    lengths = np.linalg.norm(np.diff(tool, axis=0), axis=1)
    way: Floats = np.concatenate(([0.0], np.cumsum(lengths)))
    return way


def still_rows(tool: Floats, rate_hz: float) -> Bools:
    """Return whether the gripper is still at each row (T,), given its positions (T, 3) [m].

    It is still if the distance between its positions at the ends of a time window is below ``halt_speed`` times the
    window.
    """
    window = _window(len(tool), rate_hz)
    return _covered(np.linalg.norm(tool[window:] - tool[:-window], axis=1), window, rate_hz, len(tool))


def resting_rows(tool: Floats, rate_hz: float) -> Bools:
    """Return whether the gripper rests at each row (T,), given its positions (T, 3) [m].

    It rests if the length of its path in a time window is below ``halt_speed`` times the window.
    """
    window, way = _window(len(tool), rate_hz), path_length(tool)
    return _covered(way[window:] - way[:-window], window, rate_hz, len(tool))


def stays_in_place(tool: Floats, time: Floats, begin: int, *, within: float = HALT_RADIUS) -> bool:
    """Return whether the gripper stays near its position at row ``begin`` until the end, given positions (T, 3) [m].

    The allowed distance grows slowly with time, so that drift does not count as motion.
    """
    away = np.linalg.norm(tool[begin:] - tool[begin], axis=1)
    return bool((away <= within + DRIFT * (time[begin:] - time[begin])).all())


def to_and_fro_from(tool: Floats, rate_hz: float) -> int | None:
    """Return the row from which the gripper moves back and forth until the end, or None.

    The positions have shape (T, 3) [m]. The approach to the region of this motion is not included.
    """
    steps = np.linalg.norm(np.diff(tool, axis=0), axis=1)
    left = np.concatenate((np.cumsum(steps[::-1])[::-1], [0.0]))  # path length from each row to the end
    for k in range(0, len(tool), steps_in(SEARCH_STEP, rate_hz)):
        diameter = float(np.linalg.norm(np.ptp(tool[k:], axis=0)))
        if left[k] < TO_AND_FRO_TRAVEL:
            return None
        if left[k] >= TO_AND_FRO * max(diameter, LEAST_REGION):
            return k
    return None


def runs_of(flags: Bools) -> list[tuple[int, int]]:
    """Return each interval in which the flags are True, given by its first row and the row after its last row."""
    padded = np.concatenate(([False], flags, [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _window(rows: int, rate_hz: float) -> int:
    """Return the number of control steps for averaging the gripper's speed."""
    return min(steps_in(THRESHOLDS.stillness_window, rate_hz), max(1, rows - 1))


def _covered(ways: npt.NDArray[np.float64], window: int, rate_hz: float, rows: int) -> Bools:
    """Return whether each row is in at least one time window with slow motion."""
    slow = ways * rate_hz / window < THRESHOLDS.halt_speed
    still = np.zeros(rows, dtype=np.bool_)
    for shift in range(window + 1):
        still[shift : shift + len(slow)] |= slow
    return still
