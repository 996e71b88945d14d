"""Grasp attempts: a gripper that closes within reach of an object or of an empty slot, resolved from contacts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from betterbench.diagnosis.trace import Bools, Floats, Trace
from betterbench.tasks import THRESHOLDS


@dataclass(frozen=True, slots=True)
class GraspAttempt:
    """One grasp attempt, before it is known what was asked for.

    Attributes:
        release: Row at which the gripper was commanded to open again, or the number of rows.
        aim: Index of the object that the gripper was closest to; for an air grasp the one that it missed, if any.
    """

    start: int
    end: int
    release: int
    object: int | None
    aim: int | None
    slot: str | None
    secured: bool


def find_grasps(trace: Trace) -> tuple[GraspAttempt, ...]:
    """Return all grasp attempts of an episode, in time.

    Closing at home or far from everything, closing without travel of the fingers, and closing again on an object that
    is in the gripper already are no attempts; closings that only a flicker separates are one.
    """
    grasps: list[GraspAttempt] = []
    for start, stop in _closings(trace):
        before = start - 1
        last = grasps[-1] if grasps else None
        if trace.held[before] >= 0 or (last is not None and _still_gripped(trace, last, before)):
            if last is not None:
                secured = last.secured or _lifted(trace, last.object, last.start, stop)
                grasps[-1] = replace(last, release=stop, secured=secured)
            continue
        grasp = _resolve(trace, start, stop)
        if grasp is not None and not (last is not None and _in_place(trace, last, grasp)):
            grasps.append(grasp)
    return tuple(grasps)


def _closings(trace: Trace) -> list[tuple[int, int]]:
    """Return the spans of rows in which the gripper is commanded to close, without chatter."""
    closing = trace.closing
    edges = np.flatnonzero(closing[1:] != closing[:-1]) + 1
    spans: list[tuple[int, int]] = []
    for k, row in enumerate(edges.tolist()):
        if not closing[row]:
            continue
        stop = int(edges[k + 1]) if k + 1 < len(edges) else trace.rows
        if spans and (row - spans[-1][1]) / trace.rate_hz < THRESHOLDS.chatter_time:
            spans[-1] = (spans[-1][0], stop)
        else:
            spans.append((row, stop))
    return spans


def _still_gripped(trace: Trace, last: GraspAttempt, row: int) -> bool:
    i = last.object
    return i is not None and last.secured and bool(trace.left[row, i] and trace.right[row, i])


def _in_place(trace: Trace, last: GraspAttempt, grasp: GraspAttempt) -> bool:
    """Tell whether the gripper closes again on what it has just put somewhere, before it has moved away."""
    i = grasp.object
    if i is None or i != last.object or not last.secured or grasp.secured or not trace.there[grasp.start, i]:
        return False
    away = np.linalg.norm(trace.tool[last.release : grasp.start + 1] - trace.tool[grasp.start], axis=1)
    return bool((away <= THRESHOLDS.slot_reach).all())


def _resolve(trace: Trace, start: int, stop: int) -> GraspAttempt | None:
    """Return the attempt that a closing is, or None if it is none."""
    before = start - 1
    limit = min(stop, start + trace.steps(THRESHOLDS.attempt_window), trace.rows)
    widths = trace.width[before:limit]
    if float(widths[0] - widths.min()) < THRESHOLDS.finger_travel:
        return None
    settled = before + int(np.flatnonzero(widths <= widths.min() + 1e-3)[0])
    touched = _touched(trace, start, limit, settled)
    if touched is not None:
        i, end = touched
        slot = None
        if i in trace.items:  # a container beside a slot is not what stands in it
            slot = trace.slot_near(trace.positions[before, i], THRESHOLDS.slot_reach)
            slot = slot or trace.slot_near(trace.tool[end], THRESHOLDS.slot_reach)
        return GraspAttempt(before, end, stop, i, i, slot, _lifted(trace, i, before, stop))
    if limit == trace.rows and (limit - start < trace.steps(THRESHOLDS.stop_time) or _still_closing(trace, limit)):
        return None  # the episode ended before the fingers could reach anything
    return _air_grasp(trace, before, settled, stop)


def _still_closing(trace: Trace, limit: int) -> bool:
    """Tell whether the fingers were still moving when the episode ended, so that the attempt is unresolved."""
    return limit == trace.rows and float(trace.width[limit - 2] - trace.width[limit - 1]) > THRESHOLDS.finger_travel


def _touched(trace: Trace, start: int, limit: int, settled: int) -> tuple[int, int] | None:
    """Return the object that the closing gripper got hold of, and the row at which it did, or None."""
    left, right = trace.left[start:limit], trace.right[start:limit]
    both = left & right
    if both.any():
        return _most(both, trace.box_distances(settled, trace.tool[settled]), start)
    near = trace.box_distances(settled, trace.tool[settled])
    free = np.zeros(near.shape, dtype=np.bool_)
    free[list(trace.items)] = True
    free &= ~trace.there[start - 1] & (near <= THRESHOLDS.grasp_reach)
    stopped = (
        limit - start >= trace.steps(THRESHOLDS.stop_time)
        and trace.width[limit - 1] > THRESHOLDS.closed_width
        and not _still_closing(trace, limit)
    )
    one = (left | right) & free & (stopped | (near <= 0.0))
    if one.any():
        return _most(one, near, start)
    if stopped and free.any():
        nearest = int(np.argmin(np.where(free, near, np.inf)))
        return nearest, settled
    return None


def _most(touches: Bools, near: Floats, start: int) -> tuple[int, int]:
    """Return the object that was touched in most rows, the nearer of equals, and the first of these rows."""
    counts = touches.sum(axis=0)
    order = sorted(range(len(counts)), key=lambda i: (-int(counts[i]), float(near[i])))
    return order[0], start + int(np.argmax(touches[:, order[0]]))


def _lifted(trace: Trace, i: int | None, start: int, stop: int) -> bool:
    """Tell whether an object rose in the gripper, or a drawer moved along its rails."""
    if i is None:
        return False
    rows = slice(start, stop)
    gripped = (trace.held[rows] == i) | (trace.left[rows, i] & trace.right[rows, i])
    if trace.is_drawer(i):
        moved = np.linalg.norm(trace.positions[rows, i] - trace.positions[start, i], axis=1)
        return bool((gripped & (moved >= THRESHOLDS.begun_lift)).any())
    risen = trace.positions[rows, i, 2] - trace.positions[start, i, 2] >= THRESHOLDS.begun_lift
    return bool((gripped & risen).any())


def _air_grasp(trace: Trace, before: int, settled: int, stop: int) -> GraspAttempt | None:
    """Return a null attempt, or None where nothing is within reach of the gripper."""
    tool = trace.tool[settled]
    home = np.array(trace.info.home_position)
    if tool[2] >= THRESHOLDS.attempt_height or float(np.linalg.norm(tool - home)) <= THRESHOLDS.home_radius:
        return None
    if float(np.linalg.norm((tool - trace.tool[before])[:2])) > THRESHOLDS.slot_reach:
        return None  # a gripper that closes while it travels past aims at nothing
    boxes, centers = trace.box_distances(before, tool), trace.center_distances(before, tool)
    within = [
        (float(centers[i]), i)
        for i in trace.items
        if not trace.there[before, i]
        and trace.on_table(before, i)
        and (boxes[i] <= THRESHOLDS.grasp_reach or max(centers[i], boxes[i]) <= THRESHOLDS.slot_reach)
    ]
    aim = min(within)[1] if within else None
    slot = None
    if aim is not None:
        slot = trace.slot_near(trace.positions[before, aim], THRESHOLDS.slot_reach)
    tallest = max((trace.info.objects[i].size_m[2] for i in trace.items), default=0.0)
    if tool[2] <= tallest + THRESHOLDS.slot_reach:  # closing higher up, on the way, would reach nothing that fits here
        slot = slot or trace.slot_near(tool, THRESHOLDS.slot_reach)
    if aim is None and slot is None:
        return None
    return GraspAttempt(before, settled, stop, None, aim, slot, secured=False)
