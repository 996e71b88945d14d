"""Detection of grasp attempts. In an attempt, the gripper closes within reach of an object or of an empty slot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from betterbench.tasks.judging.motion import Bools, Floats, Motion, in_reach
from betterbench.tasks.thresholds import LEAN_FORCE, PRESS_FORCE, PRESS_TIME, THRESHOLDS, TREMBLE


@dataclass(frozen=True, slots=True)
class GraspAttempt:
    """Grasp attempt, described independently of the instruction.

    Attributes:
        start: Last row before the gripper begins to close.
        end: Row where the object is touched, or where the fingers come to rest.
        release: Row where the gripper is commanded to open again, or the number of rows if it does not open again.
        object: Index of the object that the gripper closes on, or None if it closes without an object.
        aim: Index of the object closest to the gripper, or None. If the gripper closes without an object, this is the
            object that it missed.
        slot: Slot where the attempt is made, or None.
        secured: Whether the object was lifted. A drawer counts as lifted if it moved.
    """

    start: int
    end: int
    release: int
    object: int | None
    aim: int | None
    slot: str | None
    secured: bool


def find_grasps(motion: Motion) -> tuple[GraspAttempt, ...]:
    """Return all grasp attempts of an episode, in order.

    Closing the gripper is not an attempt if it happens at the home position or far from all objects, if the fingers
    hardly move, or if the gripper already holds the object. If the gripper opens only briefly while it closes
    (chatter), this is still a single attempt. An object that is lifted between the fingers was attempted, regardless of
    the gripper command. The same holds for an object on which a finger presses, even if other objects are nearby.
    Without contact, distances decide which object was attempted.
    """
    grasps: list[GraspAttempt] = []
    for closing in _closings(motion):
        start, stop = closing.start, closing.stop
        before = start - 1
        last = grasps[-1] if grasps else None
        if motion.held[before] >= 0 or (last is not None and _still_gripped(motion, last, before)):
            if last is not None:
                secured = last.secured or _lifted(motion, last.object, last.start, stop)
                grasps[-1] = replace(last, release=stop, secured=secured)
            continue
        grasp = _resolve(motion, closing)
        if grasp is not None and not (last is not None and _in_place(motion, last, grasp)):
            grasps.append(grasp)
    return tuple(sorted((*grasps, *_lifts_besides(motion, grasps)), key=lambda grasp: grasp.start))


def _lifts_besides(motion: Motion, grasps: list[GraspAttempt]) -> list[GraspAttempt]:
    """Return the attempts that lifted an object between the fingers although no closing was detected.

    A closing is an interval in which the gripper is commanded to close.
    """
    found, gap = [], motion.steps(THRESHOLDS.chatter_time)
    for i in motion.items:
        if motion.is_drawer(i):  # a drawer can also be moved by open fingers
            continue
        rows = np.flatnonzero((motion.held == i) | (motion.left[:, i] & motion.right[:, i]))
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > gap) + 1):
            if part.size == 0 or part[0] == 0:
                continue
            start, stop = int(part[0]), int(part[-1]) + 1
            seen = any(g.object == i and g.start <= stop and start <= g.release for g in grasps)
            if not seen and _lifted(motion, i, start, stop):
                slot = motion.slot_of(start - 1, i, THRESHOLDS.slot_reach)
                found.append(GraspAttempt(start - 1, start, stop, i, i, slot, secured=True))
    return found


def find_closings_on_nothing(motion: Motion) -> tuple[GraspAttempt, ...]:
    """Return the full closings of the gripper low over the table, but far from every object and slot.

    These are not grasp attempts, because they do not show which object was intended.
    """
    found = []
    for closing in _closings(motion):
        start, stop = closing.start, closing.stop
        before, travel = start - 1, _finger_travel(motion, start, stop)
        if motion.held[before] >= 0 or travel is None or _unresolved(motion, start, travel.limit):
            continue
        touched = bool((motion.left | motion.right)[start : travel.limit].any())
        shut = float(motion.width[before : travel.limit].min()) <= THRESHOLDS.closed_width
        if touched or not shut or not _low_and_away(motion, before, travel.settled):
            continue
        near = motion.box_distances(before, motion.tool[travel.settled]) <= THRESHOLDS.grasp_reach
        if (near & motion.there[before]).any():
            continue  # the closing is next to an object at its target, as after a release
        if _resolve(motion, closing) is None:
            found.append(GraspAttempt(before, travel.settled, stop, None, None, None, secured=False))
    return tuple(found)


def find_weak_closings(motion: Motion) -> tuple[GraspAttempt, ...]:
    """Return the weak closings: an open, empty gripper closes low over the table, but the fingers hardly move.

    A weak closing only counts as a grasp attempt if it is at a requested object.
    """
    found = []
    for closing in _closings(motion):
        start, stop = closing.start, closing.stop
        before = start - 1
        settled = min(stop, start + motion.steps(THRESHOLDS.attempt_window), motion.rows) - 1
        long_enough = settled - before >= motion.steps(THRESHOLDS.stop_time)
        shut = motion.width[before] <= THRESHOLDS.closed_width
        if motion.held[before] >= 0 or shut or not long_enough or not _low_and_away(motion, before, settled):
            continue
        if all(_finger_travel(motion, *part) is None for part in closing.parts):
            found.append(GraspAttempt(before, settled, stop, None, None, None, secured=False))
    return tuple(found)


def find_squeezes(motion: Motion) -> tuple[GraspAttempt, ...]:
    """Return the intervals in which an empty gripper closed partly, low over the table, and opened again.

    The gripper opening must change by at least ``finger_travel``. Changes of up to 1 mm count as trembling. Such a
    squeeze is not a grasp attempt by itself.
    """
    found, width = [], motion.width
    widest = narrowest = 0
    open_width, narrowing = 0.0, False
    for row in range(motion.rows):
        if not narrowing:
            open_width = max(open_width, float(width[row]))
            if width[row] >= open_width - TREMBLE:
                widest = row
            elif open_width - width[row] >= THRESHOLDS.finger_travel:
                narrowing, narrowest = True, row
        elif width[row] < width[narrowest] - TREMBLE:
            narrowest = row
        elif width[row] - width[narrowest] >= THRESHOLDS.finger_travel:
            empty = not (motion.held[widest : row + 1] >= 0).any()
            if empty and widest < narrowest and _low_and_away(motion, widest, narrowest):
                found.append(GraspAttempt(widest, narrowest, row, None, None, None, secured=False))
            narrowing, widest, open_width = False, row, float(width[row])
    return tuple(found)


def find_closings_in_motion(motion: Motion) -> tuple[tuple[int, int], ...]:
    """Return the first and last row of each interval in which an empty gripper closes while the arm moves.

    These are not grasp attempts, because the gripper may only have passed the object.
    """
    found = []
    for start, stop in (part for closing in _closings(motion) for part in closing.parts):
        before, travel = start - 1, _finger_travel(motion, start, stop)
        if travel is not None and motion.held[before] < 0 and not _stays(motion, before, travel.settled):
            found.append((before, travel.settled))
    return tuple(found)


class _Closing(NamedTuple):
    """Period during which the gripper closes. It may have several parts that are separated only by chatter.

    The parts are row ranges with exclusive ends.
    """

    parts: tuple[tuple[int, int], ...]

    @property
    def start(self) -> int:
        return self.parts[0][0]

    @property
    def stop(self) -> int:
        return self.parts[-1][1]


class _Travel(NamedTuple):
    """Movement of the fingers while the gripper closes.

    Attributes:
        settled: Row where the fingers come to rest.
        limit: Row after the last row that is judged.
    """

    settled: int
    limit: int


def _finger_travel(motion: Motion, start: int, stop: int) -> _Travel | None:
    """Return the movement of the fingers while the gripper closed, or None if the fingers hardly moved."""
    before = start - 1
    limit = min(stop, start + motion.steps(THRESHOLDS.attempt_window), motion.rows)
    widths = motion.width[before:limit]
    if float(widths[0] - widths.min()) < THRESHOLDS.finger_travel:
        return None
    return _Travel(before + int(np.flatnonzero(widths <= widths.min() + 1e-3)[0]), limit)


def _closings(motion: Motion) -> list[_Closing]:
    """Return the periods in which the gripper is commanded to close.

    Periods that are separated only by chatter (brief opening) are merged.
    """
    closing = motion.closing
    edges = np.flatnonzero(closing[1:] != closing[:-1]) + 1
    found: list[_Closing] = []
    for k, row in enumerate(edges.tolist()):
        if not closing[row]:
            continue
        stop = int(edges[k + 1]) if k + 1 < len(edges) else motion.rows
        if found and (row - found[-1].stop) / motion.rate_hz < THRESHOLDS.chatter_time:
            found[-1] = _Closing((*found[-1].parts, (row, stop)))
        else:
            found.append(_Closing(((row, stop),)))
    return found


def _still_gripped(motion: Motion, last: GraspAttempt, row: int) -> bool:
    i = last.object
    return i is not None and last.secured and bool(motion.left[row, i] and motion.right[row, i])


def _in_place(motion: Motion, last: GraspAttempt, grasp: GraspAttempt) -> bool:
    """Return whether the gripper closes again on an object that it has just placed, before moving away."""
    i = grasp.object
    if i is None or i != last.object or not last.secured or grasp.secured or not motion.there[grasp.start, i]:
        return False
    away = np.linalg.norm(motion.tool[last.release : grasp.start + 1] - motion.tool[grasp.start], axis=1)
    return bool((away <= THRESHOLDS.slot_reach).all())


def _resolve(motion: Motion, closing: _Closing) -> GraspAttempt | None:
    """Return the attempt that is made when the gripper closes, or None if this is not an attempt.

    If the gripper opens briefly while it closes (chatter), the first part in which an object is touched determines the
    object.
    """
    found = [grasp for part in closing.parts if (grasp := _resolve_part(motion, part, closing.stop)) is not None]
    return next((grasp for grasp in found if grasp.object is not None), found[0] if found else None)


def _resolve_part(motion: Motion, part: tuple[int, int], stop: int) -> GraspAttempt | None:
    start = _begin(motion, part)
    before, travel = start - 1, _finger_travel(motion, start, stop)
    if travel is None:
        return None
    settled, limit = travel
    touched = _touched(motion, start, limit, settled)
    if touched is not None:
        i, end = touched
        slot = None
        if i in motion.items:  # a container next to a slot is not in the slot
            slot = motion.slot_of(before, i, THRESHOLDS.slot_reach)
            slot = slot or motion.slot_near(motion.tool[end], THRESHOLDS.slot_reach)
        return GraspAttempt(before, end, stop, i, i, slot, _lifted(motion, i, before, stop))
    if _unresolved(motion, start, limit) or _taken_back(motion, part):
        return None
    return _air_grasp(motion, before, settled, stop)


def _begin(motion: Motion, part: tuple[int, int]) -> int:
    """Return the row where the gripper begins to close.

    If the fingers are kept half open and press on an object, this counts as closing, but they may close much later.
    """
    start, stop = part
    width = motion.width[start - 1 : stop]
    closed = np.flatnonzero(width <= width[0] - THRESHOLDS.finger_travel)
    if closed.size == 0 or closed[0] <= motion.steps(THRESHOLDS.attempt_window):
        return start
    later = start + int(np.flatnonzero(width[: closed[0]] >= width[0] - TREMBLE)[-1])
    slips = motion.held[later - 1] >= 0
    return start if slips or _finger_travel(motion, later, stop) is None else later


def _taken_back(motion: Motion, part: tuple[int, int]) -> bool:
    """Return whether an empty gripper reopened long before its fingers were fully closed."""
    start, stop = part
    brief = (stop - start) / motion.rate_hz < THRESHOLDS.chatter_time
    return brief and float(motion.width[start : stop + 1].min()) > THRESHOLDS.closed_width


def _unresolved(motion: Motion, start: int, limit: int) -> bool:
    """Return whether the episode ended before the fingers could reach an object."""
    short = limit - start < motion.steps(THRESHOLDS.stop_time)
    return limit == motion.rows and (short or _still_closing(motion, limit))


def _still_closing(motion: Motion, limit: int) -> bool:
    """Return whether the fingers were still moving when the episode ended. If so, the attempt cannot be judged."""
    return limit == motion.rows and float(motion.width[limit - 2] - motion.width[limit - 1]) > THRESHOLDS.finger_travel


def _touched(motion: Motion, start: int, limit: int, settled: int) -> tuple[int, int] | None:
    """Return the object that the closing gripper touched and the row of the contact, or None if it touched none."""
    left, right = motion.left[start:limit], motion.right[start:limit]
    both = left & right
    if both.any():
        return _most(both, motion.box_distances(settled, motion.tool[settled]), start)
    near = motion.box_distances(settled, motion.tool[settled])
    free = np.zeros(near.shape, dtype=np.bool_)
    free[list(motion.items)] = True
    free &= ~motion.there[start - 1] & (near <= THRESHOLDS.grasp_reach)
    stopped = (
        limit - settled >= motion.steps(THRESHOLDS.stop_time)
        and motion.width[limit - 1] > THRESHOLDS.closed_width
        and not _still_closing(motion, limit)
    )
    loose = np.array([i in motion.items and not motion.is_drawer(i) for i in range(near.shape[0])])
    # Distance alone is not enough: a finger that presses on an object is 4 cm from the tool center point.
    pressed: Bools = loose & ~motion.there[start - 1] & _presses(motion, start, limit)
    one = (left | right) & ((free & (stopped | (near <= 0.0))) | pressed)
    if one.any():
        return _most(one, near, start)
    if stopped and free.any():
        nearest = int(np.argmin(np.where(free, near, np.inf)))
        return nearest, settled
    return None


def _presses(motion: Motion, start: int, limit: int) -> Bools:
    """Return whether a finger presses on each object hard enough or long enough for a grasp attempt, shape (n,)."""
    force = motion.force[start:limit]
    hard = (force >= PRESS_FORCE).sum(axis=0) >= motion.steps(PRESS_TIME)
    leans = (force >= LEAN_FORCE).sum(axis=0) >= motion.steps(THRESHOLDS.stop_time)
    found: Bools = hard | leans
    return found


def _most(touches: Bools, near: Floats, start: int) -> tuple[int, int]:
    """Return the object that is touched in the largest number of rows, and the first of these rows.

    If there is a tie, the nearest object is chosen.
    """
    counts = touches.sum(axis=0)
    order = sorted(range(len(counts)), key=lambda i: (-int(counts[i]), float(near[i])))
    return order[0], start + int(np.argmax(touches[:, order[0]]))


def _lifted(motion: Motion, i: int | None, start: int, stop: int) -> bool:
    """Return whether an object rose while it was in the gripper, or whether a drawer moved along its rails."""
    if i is None:
        return False
    rows = slice(start, stop)
    gripped = (motion.held[rows] == i) | (motion.left[rows, i] & motion.right[rows, i])
    if motion.is_drawer(i):
        moved = np.linalg.norm(motion.positions[rows, i] - motion.positions[start, i], axis=1)
        return bool((gripped & (moved >= THRESHOLDS.begun_lift)).any())
    risen = motion.positions[rows, i, 2] - motion.positions[start, i, 2] >= THRESHOLDS.begun_lift
    return bool((gripped & risen).any())


def _air_grasp(motion: Motion, before: int, settled: int, stop: int) -> GraspAttempt | None:
    """Return the attempt of a gripper that closes without an object.

    The result is None if no object and no slot is within reach.
    """
    if not _low_and_away(motion, before, settled):
        return None
    tool = motion.tool[settled]
    centers = motion.center_distances(before, tool)
    reach = in_reach(motion.box_distances(before, tool), centers)
    standing = [i for i in motion.items if not motion.there[before, i] and motion.on_table(before, i)]
    within = [(float(centers[i]), i) for i in standing if reach[i]]
    aim = min(within)[1] if within else None
    slot = None if aim is None else motion.slot_of(before, aim, THRESHOLDS.slot_reach)
    tallest = max((motion.info.objects[i].size_m[2] for i in motion.items), default=0.0)
    # A gripper that closes higher up, during a motion, cannot reach any object of the suite.
    if slot is None and tool[2] <= tallest + THRESHOLDS.slot_reach:
        slot = motion.emptied_slot(before, tool) if aim is None else None
        if slot is None:
            slot = motion.slot_near(tool, THRESHOLDS.slot_reach)
            below = [(float(centers[i]), i) for i in standing if centers[i] <= THRESHOLDS.slot_reach]
            if aim is None and slot is not None and below:  # too high, over an object: the slot is not empty
                aim = min(below)[1]
    if aim is None and slot is None:
        return None
    return GraspAttempt(before, settled, stop, None, aim, slot, secured=False)


def _low_and_away(motion: Motion, before: int, settled: int) -> bool:
    """Return whether the gripper closes in one place, near the table and away from its home position."""
    tool, home = motion.tool[settled], np.array(motion.info.home_position)
    if tool[2] >= THRESHOLDS.attempt_height or float(np.linalg.norm(tool - home)) <= THRESHOLDS.home_radius:
        return False
    return _stays(motion, before, settled)


def _stays(motion: Motion, before: int, settled: int) -> bool:
    """Return whether the gripper hardly moved sideways while the fingers closed."""
    return float(np.linalg.norm((motion.tool[settled] - motion.tool[before])[:2])) <= THRESHOLDS.slot_reach
