"""Signals computed from joint states only: rest, back-and-forth motion, closings of the jaw, and repeated approaches.

Records of a real arm contain no contacts and no object poses. The path of the tool is therefore computed by the forward
kinematics of the simulated arm, and rest and motion are judged from this path by the rules of the simulated diagnosis
(``diagnosis.analysis.paths``). A jaw is assumed to hold an object if it stops before its commanded position or has a
load. All thresholds are in ``diagnosis.thresholds``.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from betterbench.diagnosis.analysis.paths import (
    path_length,
    runs_of,
    stays_in_place,
    steps_in,
    still_rows,
    to_and_fro_from,
)
from betterbench.diagnosis.thresholds import (
    COME_TO_REST,
    FLICKER_TIME,
    HALT_RADIUS,
    JAW_FULLY_SHUT,
    JAW_GAP,
    JAW_LOAD,
    JAW_MOVES,
    JAW_RESTS,
    JAW_SHUT,
    RETURNS,
    RISEN_AGAIN,
    SEARCH_STEP,
    TREMBLE_TIME,
)
from betterbench.errors import InvalidInputError
from betterbench.interface.actions import SO101_MOTORS
from betterbench.real.plan import ACTION_SPACES, Unit
from betterbench.real.record import Samples
from betterbench.sim.robots.ik import ArmIK
from betterbench.sim.robots.spec import robot
from betterbench.tasks import THRESHOLDS
from betterbench.tasks.judging.motion import Bools, Floats

ROBOT = "so101"
JAW = SO101_MOTORS.index("gripper")


class Grip(StrEnum):
    """Result of a closing motion of the jaw.

    ``OBJECT``: the jaw stopped before its commanded position, or has a load. ``NOTHING``: the opening is too small for
    an object. ``PRESET``: the jaw reached its commanded position without a load, at an opening that fits an object.
    ``UNKNOWN``: the trial ended, or the jaw opened again, before the jaw stopped.
    """

    OBJECT = "object"
    NOTHING = "nothing"
    PRESET = "preset"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Closing:
    """One closing motion of the jaw.

    Attributes:
        start_s: Time at which the jaw starts to close [s].
        end_s: Time at which the jaw has stopped [s].
        opening: Opening at which the jaw stopped, from 0 (closed) to 100 (open).
        grip: Result of the closing motion.
        x: x coordinate of the tool when the jaw stopped, in the base frame [m].
        y: y coordinate of the tool when the jaw stopped [m].
        z: z coordinate of the tool when the jaw stopped [m].
        let_go_s: Time at which the jaw opens again [s]; None if it stays closed.
        lost_s: Time at which a held object slipped out of the closed jaw [s]; None if no object slipped out.
        lifted_m: Largest rise of the tool while the jaw is closed [m].
        carried_m: Horizontal distance of the tool between the closing and the next opening [m]. If the jaw does not
            open again, the end of the trial is used instead of the opening.
        release_x: x coordinate of the tool at ``let_go_s``, or at the end of the trial [m].
        release_y: y coordinate of the tool at ``let_go_s``, or at the end of the trial [m].
    """

    start_s: float
    end_s: float
    opening: float
    grip: Grip
    x: float
    y: float
    z: float
    let_go_s: float | None
    lost_s: float | None
    lifted_m: float
    carried_m: float
    release_x: float
    release_y: float

    @property
    def holds(self) -> bool:
        """Whether the jaw closed on an object."""
        return self.grip is Grip.OBJECT

    @property
    def low(self) -> bool:
        """Whether the tool was low enough to grasp an object when the jaw closed."""
        return self.z <= THRESHOLDS.attempt_height

    @property
    def is_attempt(self) -> bool:
        """Whether the closing is a grasp attempt.

        In a grasp attempt, the tool is low enough to grasp an object. The jaw may remain empty.
        """
        return self.grip in (Grip.OBJECT, Grip.NOTHING) and self.low

    @property
    def over_s(self) -> float:
        """Time at which the closing is over [s], because the jaw has opened again, lost the object, or stopped."""
        return self.end_s if self.let_go_s is None and self.lost_s is None else (self.lost_s or self.let_go_s or 0.0)


@dataclass(frozen=True, slots=True)
class Span:
    """Interval in which a behavior was observed, from its start to its end [s]."""

    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class Approach:
    """Repeated descents of an empty gripper to the same place.

    Attributes:
        count: Number of descents, none of which picked up an object.
        start_s: Start of the first descent [s].
        end_s: End of the last descent [s].
        x: Mean x coordinate of the place in the base frame [m].
        y: Mean y coordinate of the place in the base frame [m].
    """

    count: int
    start_s: float
    end_s: float
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class JointSignals:
    """Joint signals of one trial.

    Attributes:
        duration_s: Duration of the trial [s].
        reach_m: Largest distance of the tool from its initial position [m].
        path_m: Length of the path of the tool, without encoder noise [m].
        freeze: Interval in which the arm rests until the end of the trial; None if it is too short to count as a halt.
        to_and_fro: Interval in which the empty gripper moves back and forth until the end; None if there is no such
            motion.
        closings: Closings of the jaw in order of time.
        repeated: Repeated approaches to one place without an object in the jaw; None if there are none.
        load_known: Whether the robot reported the load of the gripper's motor.
        path: Tool positions of the resampled trial, (T, 3) [m], for tables and plots.
    """

    duration_s: float
    reach_m: float
    path_m: float
    freeze: Span | None
    to_and_fro: Span | None
    closings: tuple[Closing, ...]
    repeated: Approach | None
    load_known: bool
    path: Floats

    @property
    def moved(self) -> bool:
        """Whether the arm left its initial position, or the jaw closed."""
        return self.reach_m > HALT_RADIUS or bool(self.closings)

    @property
    def attempts(self) -> tuple[Closing, ...]:
        """Closings that are grasp attempts."""
        return tuple(closing for closing in self.closings if closing.is_attempt)

    @property
    def grasps(self) -> tuple[Closing, ...]:
        """Grasp attempts in which the jaw closed on an object."""
        return tuple(closing for closing in self.attempts if closing.holds)

    @property
    def at_rest(self) -> bool:
        """Whether the tool rests at the end of the trial for at least the time that a policy must rest after a task."""
        return self.freeze is not None and self.freeze.end_s - self.freeze.start_s >= THRESHOLDS.settle_time


@dataclass(frozen=True, slots=True, eq=False)
class JointTrack:
    """Joint states of a trial, resampled at a constant rate.

    Attributes:
        rate_hz: Rate of the rows [Hz].
        arm: (T, 5) joint angles [rad].
        opening: (T,) measured opening of the jaw, from 0 (closed) to 100 (open).
        asked: (T,) commanded opening of the jaw.
        load: (T,) absolute load of the gripper's motor as a fraction of its maximum; NaN if unknown.
    """

    rate_hz: float
    arm: Floats
    opening: Floats
    asked: Floats
    load: Floats

    @classmethod
    def of(cls, samples: Samples, *, unit: Unit, rate_hz: float) -> JointTrack:
        """Resample the states of a trial at a constant rate, because control steps may be late.

        Raises:
            InvalidInputError: If the samples have fewer than two rows.
        """
        if len(samples) < 2:
            problem = f"the trial has {len(samples)} rows, but signals need at least two"
            raise InvalidInputError("samples", problem, "Repeat the trial")
        rows = round(float(samples.time_s[-1] - samples.time_s[0]) * rate_hz) + 1
        at = samples.time_s[0] + np.arange(max(2, rows)) / rate_hz
        scale = np.array(ACTION_SPACES[unit].scale[:JAW])
        arm = _resampled(at, samples.time_s, samples.state[:, :JAW] * scale)
        jaw = _resampled(at, samples.time_s, np.stack((samples.state[:, JAW], samples.command[:, JAW]), axis=1))
        load = _resampled(at, samples.time_s, np.abs(samples.load[:, JAW : JAW + 1]))
        return cls(rate_hz, arm, jaw[:, 0], jaw[:, 1], load[:, 0])

    @property
    def time(self) -> Floats:
        """(T,) time of the rows [s]."""
        times: Floats = np.arange(len(self.opening)) / self.rate_hz
        return times

    def steps(self, seconds: float) -> int:
        """Convert a duration to a number of rows, which is at least 1."""
        return steps_in(seconds, self.rate_hz)


def _resampled(at: Floats, time: Floats, values: Floats) -> Floats:
    """Interpolate values (T, n) linearly at other times. Values next to an unknown value (NaN) are unknown too."""
    made: Floats = np.stack([np.interp(at, time, column) for column in values.T], axis=1)
    return made


@functools.cache
def _kinematics() -> Callable[[Sequence[float]], tuple[float, float, float]]:
    """Return the forward kinematics of the simulated arm.

    This function maps five joint angles [rad] to the position of the tool in the base frame [m].
    """
    solver = ArmIK(robot(ROBOT))

    def place(angles: Sequence[float]) -> tuple[float, float, float]:
        x, y, z = solver.forward(angles).position
        return x, y, z

    return place


def tool_path(arm: Floats) -> Floats:
    """Return the tool positions (T, 3) in the base frame [m] for joint angles (T, 5) [rad]."""
    place = _kinematics()
    return np.array([place(angles) for angles in arm.tolist()]).reshape(-1, 3)


def signals_of(track: JointTrack) -> JointSignals:
    """Compute the signals of a trial from its resampled joint states."""
    tool = _steady(tool_path(track.arm), track)
    closings = _closings(track, tool)
    freeze = _freeze(track, tool, closings)
    last = max((track.steps(c.over_s) for c in closings if c.is_attempt), default=0)
    repeated = _repeated(track, tool, closings)
    thinned = tool[:: track.steps(THRESHOLDS.stillness_window)]
    return JointSignals(
        duration_s=float(track.time[-1]),
        reach_m=float(np.linalg.norm(tool - tool[0], axis=1).max()),
        path_m=float(path_length(thinned)[-1]),
        freeze=freeze,
        to_and_fro=None if freeze is not None else _to_and_fro(track, tool, last),
        closings=closings,
        repeated=repeated,
        load_known=bool(np.isfinite(track.load).any()),
        path=tool,
    )


def _steady(tool: Floats, track: JointTrack) -> Floats:
    """Return the path of the tool, averaged over ``stillness_window`` to remove encoder noise."""
    half = track.steps(THRESHOLDS.stillness_window) // 2
    if not half or len(tool) <= 2 * half:
        return tool
    padded = np.pad(tool, ((half, half), (0, 0)), mode="edge")
    sums = np.cumsum(np.concatenate((np.zeros((1, 3)), padded)), axis=0)
    window = 2 * half + 1
    steady: Floats = (sums[window:] - sums[:-window]) / window
    return steady


def _span(track: JointTrack, first: int, last: int) -> Span:
    return Span(round(float(track.time[first]), 3), round(float(track.time[last]), 3))


# ------------------------------------------------------------------------------------------------------- rest, motion


def _freeze(track: JointTrack, tool: Floats, closings: Sequence[Closing]) -> Span | None:
    """Return the interval in which the arm rests until the end, or None if it does not come to rest.

    The arm must be still for ``halt_time``, or tremble in place for ``tremble_time``. The arm does not count as resting
    while the jaw closes or opens.
    """
    still = still_rows(tool, track.rate_hz)
    busy = max((track.steps(c.let_go_s or c.end_s) + track.steps(THRESHOLDS.stop_time) for c in closings), default=0)
    busy = min(busy, len(tool) - 1)
    for start, stop in runs_of(still):
        rows = range(max(start, busy), stop - track.steps(THRESHOLDS.halt_time) + 1, track.steps(SEARCH_STEP))
        for row in rows:
            if stays_in_place(tool, track.time, row, within=HALT_RADIUS if row == rows[0] else COME_TO_REST):
                return _span(track, row, len(tool) - 1)
    for row in range(busy, len(tool) - track.steps(TREMBLE_TIME), track.steps(SEARCH_STEP)):
        if stays_in_place(tool, track.time, row):
            return _span(track, row, len(tool) - 1)
    return None


def _to_and_fro(track: JointTrack, tool: Floats, first: int) -> Span | None:
    """Return the interval from which on the empty gripper only moves back and forth, up to the end of the track.

    Return None if there is no such interval.
    """
    if len(tool) - first < track.steps(THRESHOLDS.halt_time):
        return None
    # one position per window, because encoder noise would add up along the path
    every = track.steps(THRESHOLDS.stillness_window)
    begins = to_and_fro_from(tool[first::every], track.rate_hz / every)
    return None if begins is None else _span(track, first + begins * every, len(tool) - 1)


def _repeated(track: JointTrack, tool: Floats, closings: Sequence[Closing]) -> Approach | None:
    """Return the largest group of descents to the same place without an object in the jaw.

    Return None if there is no group of at least ``returns`` descents.
    """
    free = np.ones(len(tool), dtype=np.bool_)
    for closing in closings:
        if closing.holds:
            end = track.steps(closing.over_s) if closing.over_s > closing.end_s else len(tool)
            free[track.steps(closing.start_s) : end + 1] = False
    lows = [row for row in _descents(tool[:, 2]) if free[row] and tool[row, 2] <= THRESHOLDS.attempt_height]
    best: list[int] = []
    for row in lows:
        near = [r for r in lows if np.linalg.norm(tool[r, :2] - tool[row, :2]) <= THRESHOLDS.slot_reach]
        best = max(best, near, key=len)
    if len(best) < RETURNS:
        return None
    x, y = tool[best, :2].mean(axis=0).tolist()
    return Approach(len(best), *_ends(_span(track, best[0], best[-1])), x, y)


def _ends(span: Span) -> tuple[float, float]:
    return span.start_s, span.end_s


def _descents(height: Floats) -> list[int]:
    """Return the lowest row of each descent.

    A descent is a fall of the tool by at least ``risen_again`` that is followed by a rise of the same size.
    """
    found: list[int] = []
    top, low, falling = float(height[0]), 0, False
    for row, z in enumerate(height.tolist()):
        if not falling:
            top = max(top, z)
            if z <= top - RISEN_AGAIN:
                falling, low = True, row
        elif z < height[low]:
            low = row
        elif z >= height[low] + RISEN_AGAIN:
            found.append(low)
            falling, top = False, z
    return found


# ------------------------------------------------------------------------------------------------------------ closings


def _closings(track: JointTrack, tool: Floats) -> tuple[Closing, ...]:
    """Return the closings of the jaw.

    A closing reduces the opening by at least ``jaw_moves`` and ends when the jaw stops.
    """
    found = []
    opening = track.opening
    for start, end in _falls(track):
        grip = _grip(track, end)
        opens = _opens_after(opening, end)
        lost = _lost(track, end, opens) if grip is Grip.OBJECT else None
        last = min(opens if opens is not None else len(opening) - 1, lost if lost is not None else len(opening) - 1)
        x, y, z = tool[end].tolist()
        there = tool[last]
        found.append(
            Closing(
                start_s=round(float(track.time[start]), 3),
                end_s=round(float(track.time[end]), 3),
                opening=round(float(opening[end]), 2),
                grip=grip,
                x=x,
                y=y,
                z=z,
                let_go_s=None if opens is None else round(float(track.time[opens]), 3),
                lost_s=None if lost is None else round(float(track.time[lost]), 3),
                lifted_m=float(tool[end : last + 1, 2].max() - z),
                carried_m=float(np.linalg.norm(there[:2] - tool[end, :2])),
                release_x=float(there[0]),
                release_y=float(there[1]),
            )
        )
    return tuple(found)


def _falls(track: JointTrack) -> list[tuple[int, int]]:
    """Return the row at which each closing begins and the row at which the jaw stops.

    A pause shorter than ``chatter_time`` does not end a closing.
    """
    opening = track.opening
    pause, found = track.steps(THRESHOLDS.chatter_time), list[tuple[int, int]]()
    top = 0
    row = 0
    while row < len(opening):
        if opening[row] >= opening[top]:
            top = row
        elif opening[row] <= opening[top] - JAW_MOVES:
            end = _stops(track, row)
            if found and top - found[-1][1] <= pause and opening[found[-1][0]] >= opening[top]:
                found[-1] = (found[-1][0], end)
            else:
                found.append((_begins(opening, top, row), end))
            row = top = end
        row += 1
    return found


def _begins(opening: Floats, top: int, row: int) -> int:
    """Return the last row before a closing at which the jaw still had its largest opening, within a tolerance."""
    fallen = np.flatnonzero(opening[top : row + 1] >= opening[top] - JAW_RESTS)
    return top + int(fallen[-1])


def _stops(track: JointTrack, row: int) -> int:
    """Return the first row after which the opening does not decrease for ``stop_time``."""
    opening, window = track.opening, track.steps(THRESHOLDS.stop_time)
    for end in range(row, len(opening)):
        after = opening[end : end + window + 1]
        if opening[end] - after.min() <= JAW_RESTS:
            return end
    return len(opening) - 1


def _grip(track: JointTrack, end: int) -> Grip:
    """Return the result of a closing.

    The result is judged from the opening, the command and the load while the jaw stays closed.
    """
    opens = _opens_after(track.opening, end)
    stop = min(len(track.opening), end + track.steps(THRESHOLDS.stop_time) + 1, *(() if opens is None else (opens,)))
    rows = slice(end, max(stop, end + 1))
    opening = float(np.median(track.opening[rows]))
    if opening <= JAW_FULLY_SHUT:
        return Grip.NOTHING
    if rows.stop - rows.start < track.steps(FLICKER_TIME):
        return Grip.UNKNOWN
    load = track.load[rows]
    if np.isfinite(load).any():
        presses = bool(np.nanmedian(load) >= JAW_LOAD)
    else:
        presses = opening - float(np.median(track.asked[rows])) >= JAW_GAP
    if presses:
        return Grip.OBJECT
    return Grip.NOTHING if opening <= JAW_SHUT else Grip.PRESET


def _opens_after(opening: Floats, row: int) -> int | None:
    """Return the first later row at which the jaw has opened again, or None.

    The jaw has opened again if it is at least ``jaw_moves`` wider than its smallest opening.
    """
    low = np.minimum.accumulate(opening[row:])
    wider = np.flatnonzero(opening[row:] >= low + JAW_MOVES)
    return row + int(wider[0]) if wider.size else None


def _lost(track: JointTrack, end: int, opens: int | None) -> int | None:
    """Return the row at which the jaw closes further because the object slipped out, or None if none slipped out."""
    stop = len(track.opening) if opens is None else opens
    shut: Bools = track.opening[end:stop] <= min(JAW_SHUT, float(track.opening[end]) - JAW_MOVES)
    lasting = [a for a, b in runs_of(shut) if b - a >= min(track.steps(FLICKER_TIME), stop - end - a)]
    return end + lasting[0] if lasting else None
