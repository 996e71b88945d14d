"""Targets of a policy that does not close its gripper on an object, inferred from the path of the empty gripper.

A grasp shows which object the policy wants. After the last grasp, the target can only be inferred from the path of the
empty gripper. The gripper may stay over an object, push it, return to it repeatedly, or move back and forth between
several objects.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from betterbench.diagnosis.analysis.paths import to_and_fro_from
from betterbench.diagnosis.analysis.trace import Trace
from betterbench.diagnosis.thresholds import (
    BEGINS_TO_MOVE,
    BESIDE,
    CLOSED_IN_PART,
    COMES_DOWN,
    COMES_NEARER,
    FLICKER_TIME,
    OVER_HEIGHT,
    PASSING,
    PASSING_AT_END,
    PUSH_AGAIN,
    PUSH_ALONG,
    PUSH_GAP,
    PUSH_SHARE,
    PUSH_TRAVEL,
    RETREAT,
    RETURNS,
    RISEN_AGAIN,
    RUNS_INTO,
    STAY_SHARE,
    STAY_TIME,
    STRAIGHT,
)
from betterbench.tasks import THRESHOLDS
from betterbench.tasks.judging.attempts import GraspAttempt
from betterbench.tasks.judging.motion import Bools, Floats, tool_distances


@dataclass(frozen=True, slots=True)
class Stay:
    """Interval of the trace (first and last row) in which the open gripper stays over an object.

    Passing over the object does not count as staying over it.
    """

    start: int
    end: int
    object: int

    @property
    def rows(self) -> int:
        """Number of rows of the trace in the interval."""
        return self.end - self.start + 1


def find_stays(trace: Trace, first: int) -> tuple[Stay, ...]:
    """Return the intervals after row ``first`` during which the open gripper stays over an object, in time order.

    Objects that are already at a target region, or on the floor, are left out.
    """
    near = _near_anything(trace) & _is_empty(trace)
    over = np.array([_over(trace, row) if near[row] else -1 for row in range(first, trace.rows)], dtype=np.int64)
    stays: list[Stay] = []
    edges = np.flatnonzero(np.diff(over)) + 1
    for start, stop in zip([0, *edges.tolist()], [*edges.tolist(), len(over)], strict=True):
        if start == stop or over[start] < 0:
            continue
        stay = Stay(first + start, first + stop - 1, int(over[start]))
        last = stays[-1] if stays else None
        if last is not None and last.object == stay.object and stay.start - last.end <= trace.steps(FLICKER_TIME):
            stays[-1] = Stay(last.start, stay.end, stay.object)
        else:
            stays.append(stay)
    return tuple(s for s in stays if not _passes(trace, s))


def chosen_by_staying(trace: Trace, first: int, asked: Collection[int] = ()) -> Stay | None:
    """Return the first interval during which the gripper stays over the object that the policy chose.

    The choice is inferred from how long the gripper stays over each object. Return None if this does not show a choice.

    Args:
        trace: The episode.
        first: Only intervals that begin at or after this row of the trace are considered.
        asked: Indices of the requested objects. An object that was not requested does not count as chosen if the
            gripper was over a requested object for about as long or about as often.
    """
    stays = find_stays(trace, first)
    times: Counter[int] = Counter()
    for stay in stays:
        times[stay.object] += stay.rows
    if not times:
        return None
    chosen = max(times, key=lambda i: (times[i], -i))
    if times[chosen] < trace.steps(STAY_TIME) or times[chosen] < STAY_SHARE * times.total():
        return None
    if chosen not in asked and _comes_over_too(trace, [s for s in stays if s.object == chosen], first, asked):
        return None
    return next(s for s in stays if s.object == chosen)


def _comes_over_too(trace: Trace, stays: list[Stay], first: int, asked: Collection[int]) -> bool:
    """Return whether the gripper was over a requested object about as long or as often as it was over the chosen one.

    Only the time that the gripper spends below a certain height above the table is compared. The height is the same for
    both objects, because otherwise a descending gripper would count as being over the taller object earlier.
    """
    chosen = stays[0].object
    ceiling = max(float(trace.tool[s.start : s.end + 1, 2].max()) for s in stays)
    at = np.full(trace.rows, -1, dtype=np.int64)
    for row in np.flatnonzero(_is_empty(trace) & (trace.tool[:, 2] <= ceiling)).tolist():
        if row >= first:
            gaps = _gaps(trace, row, (chosen, *asked))
            over = [(gap, i) for i, gap in gaps.items() if gap.is_over]
            at[row] = min(over)[1] if over else -1
    times, visits = Counter[bool](), Counter[bool]()
    for i in (chosen, *asked):
        for a, b in spans(at == i, trace.steps(FLICKER_TIME)):
            if not _passes(trace, visit := Stay(a, b, i)):
                times[i == chosen] += visit.rows
                visits[i == chosen] += 1
    as_often = visits[True] >= RETURNS and visits[False] >= visits[True]
    return as_often or times[True] < STAY_SHARE * times.total()


def comes_down_to(trace: Trace, first: int) -> int | None:
    """Return the index of the object to which the open gripper descends, low enough to grasp it, or None.

    Only rows of the trace from ``first`` on are considered. The gripper must spend a minimum time at the object, and
    must rarely be within reach of other objects.
    """
    free = ~trace.closing & (trace.held < 0)
    low = np.stack([is_down(trace, i) for i in range(len(trace.info.objects))], axis=1) & free[:, None]
    items = [i for i in trace.items if i not in trace.targets]
    gaps, _, reach = tool_distances(trace)
    times: Counter[int] = Counter()
    for row in np.flatnonzero(low[:, items].any(axis=1)).tolist():
        if row < first:
            continue
        near = [i for i in items if low[row, i] and reach[row, i] and not trace.there[row, i]]
        if near:
            times[min(near, key=lambda i: (float(gaps[row, i]), i))] += 1
    if not times:
        return None
    chosen = max(times, key=lambda i: (times[i], -i))
    enough = times[chosen] >= max(trace.steps(THRESHOLDS.stop_time), STAY_SHARE * times.total())
    return chosen if enough else None


def taken_below(trace: Trace, i: int) -> Floats:
    """Return the maximum height [m] at which the gripper can grasp an object, for each row of the trace (T,).

    This is the height of the object's top, or a fixed height above the object's base if the object is flatter than
    that.
    """
    feet: Floats = trace.positions[:, i, 2]
    return feet + max(trace.info.objects[i].size_m[2], COMES_DOWN)


def is_down(trace: Trace, i: int) -> Bools:
    """Return whether the gripper is low enough to grasp an object, for each row of the trace (T,)."""
    low: Bools = trace.tool[:, 2] <= taken_below(trace, i)
    return low


def stays_above(trace: Trace, first: int, i: int) -> bool:
    """Return whether the open gripper stays over object ``i`` from row ``first`` on without descending to it."""
    rows = [row for stay in find_stays(trace, first) if stay.object == i for row in range(stay.start, stay.end + 1)]
    if len(rows) < trace.steps(STAY_TIME):
        return False
    heights = trace.tool[rows, 2] - taken_below(trace, i)[rows]
    return float(heights.min()) > BESIDE and lowered(heights) <= THRESHOLDS.rest_travel


def lowered(heights: Floats) -> float:
    """Return the median of the first half of a series of heights minus the median of its second half [m]."""
    first, second = np.array_split(heights, 2)
    return float(np.median(first) - np.median(second))


def returns_to(trace: Trace, first: int, i: int) -> tuple[int, int] | None:
    """Return the first and last row of the interval during which the open gripper keeps returning to an object.

    Return None if the gripper does not move over the object, away from it and back often enough.
    """
    visits = [stay for stay in find_stays(trace, first) if stay.object == i]
    times = 1
    for last, stay in itertools.pairwise(visits):
        away = np.linalg.norm(trace.tool[last.end : stay.start + 1] - trace.tool[last.end], axis=1)
        times += bool((away >= RETREAT).any())
    return (visits[0].start, trace.rows - 1) if visits and times >= RETURNS else None


def closes_in_part(trace: Trace, first: int, i: int) -> tuple[int, int] | None:
    """Return the first and last row of an attempt that closed the fingers only partly around an object, or None.

    In such an attempt, the fingers come closer together around the object but never touch it, and the gripper rises
    again.
    """
    below, low = taken_below(trace, i), is_down(trace, i)
    down = (low & tool_distances(trace).reach[:, i])[first:]
    for start, end in spans(down, trace.steps(FLICKER_TIME)):
        a, b = first + start, first + end
        narrowed = trace.width[b] <= trace.width[a : b + 1].max() - CLOSED_IN_PART
        touched = (trace.left | trace.right)[a : b + 1, i].any()
        lifted = b < trace.rows - 1 and trace.tool[b + 1 :, 2].max() > below[b] + RISEN_AGAIN
        if narrowed and not touched and lifted:
            return a, b
    return None


def runs_into(trace: Trace, first: int, i: int) -> tuple[int, int] | None:
    """Return the interval in which the open gripper repeatedly comes down on an object and rises again, or None.

    The interval is given by its first and last row. The result is None if this does not happen often enough. Contacts
    of a closed gripper do not count, and neither do contacts with an object that is between the fingers.
    """
    shut = trace.closing | (trace.width <= THRESHOLDS.closed_width)
    met = trace.touched[:, i] & ~(trace.left & trace.right)[:, i] & (trace.held < 0) & ~shut
    met[:first] = False
    times: list[tuple[int, int]] = []
    for start, end in spans(met, trace.steps(FLICKER_TIME)):
        since = times[-1][1] if times else first
        if trace.tool[since : start + 1, 2].max() - trace.tool[start, 2] >= RISEN_AGAIN:
            times.append((start, end))
    return (times[0][0], times[-1][1]) if len(times) >= RUNS_INTO else None


def comes_shut(trace: Trace, first: int, i: int) -> tuple[int, int] | None:
    """Return the first interval in which a closed and empty gripper is within reach of an object.

    Only rows of the trace from ``first`` on are considered.

    Returns:
        The first and last row of the interval, or None if there is no such interval.
    """
    shut = trace.closing & (trace.held < 0) & (trace.width <= THRESHOLDS.closed_width)
    near = shut & tool_distances(trace).reach[:, i]
    near[:first] = False
    return spans(near, trace.steps(FLICKER_TIME))[0] if near.any() else None


def to_and_fro(trace: Trace, first: int) -> tuple[int, int] | None:
    """Return the first and last row of the empty gripper's final back-and-forth motion, or None if there is none.

    This motion lasts until the end of the episode. The interval includes neither the approach to the region of this
    motion nor the rows where the opening fingers still hold the last object.
    """
    holding = np.flatnonzero(trace.held[first:] >= 0)
    first += int(holding[-1]) + 1 if holding.size else 0
    if trace.rows - first < trace.steps(THRESHOLDS.halt_time):
        return None
    begins = to_and_fro_from(trace.tool[first:], trace.rate_hz)
    return None if begins is None else (first + begins, trace.rows - 1)


def comes_nearer(trace: Trace, rows: tuple[int, int], things: Iterable[int]) -> bool:
    """Return whether the path between two rows of the trace approaches at least one of the given objects.

    The path is divided into quarters. The center of each quarter must be closer to the object than the center of the
    previous quarter. A path that is centered on an object from the start therefore does not count as approaching it.
    """
    first, last = rows
    middles = np.array([part.mean(axis=0) for part in np.array_split(trace.tool[first : last + 1, :2], 4)])
    gaps = (np.linalg.norm(middles - trace.positions[first, i, :2], axis=1) for i in things)
    return any(gap[0] >= PASSING and bool((gap[:-1] - gap[1:] >= COMES_NEARER * gap[0]).all()) for gap in gaps)


def shuts(trace: Trace, i: int, shut: Bools) -> tuple[int, int] | None:
    """Return the rows in which an empty gripper pushes a drawer shut, beginning with the first touch, or None.

    The result is None if the drawer is not shut at the end, was never open, or was not touched just before it shut.

    Args:
        trace: The episode.
        i: Index of the drawer.
        shut: (T,) whether the drawer is shut.
    """
    if shut.all() or not shut[-1]:
        return None
    row = int(np.flatnonzero(~shut)[-1]) + 1
    found = spans(trace.touched[: row + 1, i] & (trace.held[: row + 1] < 0), trace.steps(PUSH_GAP))
    return (found[-1][0], row) if found and row - found[-1][1] <= trace.steps(PUSH_GAP) else None


def find_pushes(trace: Trace, grasps: tuple[GraspAttempt, ...]) -> tuple[Stay, ...]:
    """Return the pushes of objects by the empty gripper in time order, each with its rows in the trace and its object.

    An object that moves while the gripper is closed on it is carried or dragged, but not pushed. An object that is hit
    while another object is between the fingers is not pushed either.
    """
    shoves = find_shoves(trace, grasps)
    times = Counter(shove.object for shove in shoves)
    return tuple(s for s in shoves if times[s.object] >= PUSH_AGAIN or _pushed(trace, s.object, s.start, s.end))


def find_shoves(trace: Trace, grasps: tuple[GraspAttempt, ...]) -> tuple[Stay, ...]:
    """Return the intervals in which the empty gripper moves an object, in chronological order.

    This includes movements that are too short to count as a push.
    """
    shoves = [Stay(a, b, i) for i in trace.items for a, b in _touches(trace, grasps, i) if _shoved(trace, i, a, b)]
    return tuple(sorted(shoves, key=lambda s: (s.start, s.object)))


def _touches(trace: Trace, grasps: tuple[GraspAttempt, ...], i: int) -> list[tuple[int, int]]:
    """Return the intervals (first and last row) in which the empty gripper touches an object without grasping it."""
    if trace.is_drawer(i):
        return []
    pinched = trace.left & trace.right
    pinched[:, i] = False  # a closed gripper pushes an object with both fingers
    touched = trace.touched[:, i] & (trace.held < 0) & ~pinched.any(axis=1)
    for g in grasps:
        if g.object == i:
            touched[g.start : _leaves(trace, i, g.release + trace.steps(THRESHOLDS.stop_time))] = False
    return [(_moves_from(trace, i, a), b) for a, b in spans(touched, trace.steps(PUSH_GAP))]


def _leaves(trace: Trace, i: int, row: int) -> int:
    """Return the first row, not before the given row, where an object is out of the gripper's reach."""
    reach = tool_distances(trace).reach
    while row < trace.rows and reach[row, i]:
        row += 1
    return min(row, trace.rows)


def _near_anything(trace: Trace) -> Bools:
    """Return whether the gripper may be over or near any object, for each row of the trace (T,)."""
    items = list(trace.items)
    reach = np.array([math.hypot(*trace.info.objects[i].size_m) + OVER_HEIGHT + 2.0 * BESIDE for i in items])
    near: Bools = (np.linalg.norm(trace.positions[:, items] - trace.tool[:, None], axis=2) <= reach).any(axis=1)
    return near


def _is_empty(trace: Trace) -> Bools:
    """Return whether the gripper holds nothing, for each row of the trace (T,).

    An empty gripper may be open or fully closed.
    """
    empty: Bools = (trace.held < 0) & (~trace.closing | (trace.width <= THRESHOLDS.closed_width))
    return empty


def _over(trace: Trace, row: int) -> int:
    """Return the index of the object under the empty gripper, or -1 if there is none.

    Placement targets are excluded, because the gripper is also over them when it releases an object. If there are
    several objects under the gripper, the horizontally nearest one is returned. An object whose bounding box reaches
    below the gripper takes precedence over an object whose center is nearer.
    """
    gaps = _gaps(trace, row, trace.items)
    near = (i for i in gaps if not (trace.there[row, i] or trace.is_drawer(i) or i in trace.targets))
    found = [(gaps[i], i) for i in near if (gaps[i].is_over and gaps[i].above <= OVER_HEIGHT) or gaps[i].in_reach]
    return min(found)[1] if found else -1


class _Gap(NamedTuple):
    """Distances from the gripper to an object.

    Attributes:
        beside: Horizontal distance to the object's bounding box [m].
        center: Horizontal distance to the object's center [m].
        above: Height of the gripper above the top of the object [m].
        in_reach: Whether the gripper could grasp the object.
    """

    beside: float
    center: float
    above: float
    in_reach: bool

    @property
    def is_over(self) -> bool:
        """Whether the gripper is over the object or close to its bounding box.

        The bounding box is considered in addition to the center, because wide objects are grasped far from their
        center.
        """
        return self.beside <= BESIDE or self.center <= THRESHOLDS.slot_reach


def _gaps(trace: Trace, row: int, items: Iterable[int]) -> dict[int, _Gap]:
    """Return the distances from the gripper to the given objects, by object index.

    Objects that fell off the table are left out.
    """
    tool = trace.tool[row]
    boxes, middles, reach = (distances[row].tolist() for distances in tool_distances(trace))
    found = {}
    for i in items:
        if trace.on_table(row, i):
            above = float(tool[2] - trace.positions[row, i, 2]) - trace.info.objects[i].size_m[2]
            beside = round(math.sqrt(max(0.0, boxes[i] ** 2 - max(0.0, above) ** 2)), 3)
            found[i] = _Gap(beside, middles[i], above, reach[i])
    return found


def _passes(trace: Trace, stay: Stay) -> bool:
    """Return whether a gripper that is over an object merely passes over it.

    It only passes if it leaves after a short time, or on a different side than it came from. If the episode ends while
    the gripper is over the object, it only passes if it is still moving in a straight line.
    """
    if stay.end == trace.rows - 1:
        last = trace.tool[max(stay.start, stay.end - trace.steps(STAY_TIME)) : stay.end + 1, :2]
        way = float(np.linalg.norm(np.diff(last, axis=0), axis=1).sum())
        return way >= PASSING_AT_END * PASSING and float(np.linalg.norm(last[-1] - last[0])) >= STRAIGHT * way
    if stay.rows < trace.steps(THRESHOLDS.stop_time):
        return True
    return float(np.linalg.norm((trace.tool[stay.end] - trace.tool[stay.start])[:2])) >= PASSING


def spans(flags: Bools, gap: int) -> list[tuple[int, int]]:
    """Return the first and last row of each interval in which the flags are True.

    Intervals separated by a short gap are merged.
    """
    found: list[tuple[int, int]] = []
    for row in np.flatnonzero(flags).tolist():
        if found and row - found[-1][1] <= gap:
            found[-1] = (found[-1][0], row)
        else:
            found.append((row, row))
    return found


def _moves_from(trace: Trace, i: int, touched: int) -> int:
    """Return the row where an object begins to move.

    The returned row is never later than the first recorded touch. A touch that lasts less than a control step is not
    recorded, but it can be seen in the object's motion.
    """
    before = max(0, touched - trace.steps(FLICKER_TIME))
    moved = np.linalg.norm(trace.positions[before : touched + 1, i] - trace.positions[before, i], axis=1)
    return before + int(np.argmax(np.append(moved[:-1] > BEGINS_TO_MOVE, True)))


def _pushed(trace: Trace, i: int, start: int, end: int) -> bool:
    """Return whether a touched object and the gripper moved in the same direction and far enough for a push."""
    way, tool = _ways(trace, i, start, end)
    lengths = float(np.linalg.norm(way)), float(np.linalg.norm(tool))
    if lengths[0] < PUSH_TRAVEL or lengths[1] < PUSH_SHARE * PUSH_TRAVEL:
        return False
    return float(way @ tool) >= PUSH_ALONG * lengths[0] * lengths[1]


def _shoved(trace: Trace, i: int, start: int, end: int) -> bool:
    """Return whether a touched object moved at least ``PUSH_SHARE`` times as far as required for a push."""
    way, _ = _ways(trace, i, start, end)
    return float(np.linalg.norm(way)) >= PUSH_SHARE * PUSH_TRAVEL


def _ways(trace: Trace, i: int, start: int, end: int) -> tuple[Floats, Floats]:
    """Return the horizontal displacements of a touched object and of the gripper during the touch, each (2,) [m]."""
    before, after = max(0, start - 1), min(trace.rows - 1, end + trace.steps(PUSH_GAP))
    way: Floats = (trace.positions[after, i] - trace.positions[before, i])[:2]
    tool: Floats = (trace.tool[end] - trace.tool[before])[:2]
    return way, tool
