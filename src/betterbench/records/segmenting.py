"""Segmentation of records into subgoals and skills, using only the recorded states.

A skill lasts from the action that closes the gripper to the action that opens it. If an object was held in between, the
skill is a pick and a placement. If a drawer moved, the skill is a slide. Otherwise, the skill is a miss. The window of
a skill begins when the tool comes within :data:`NEAR_M` of the position where the gripper closes or opens, and ends
when the tool has moved away from this position. A segment ends with the skill that achieves the segment's subgoal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from betterbench.records.demonstration import SkillKind, SkillWindow, SubgoalSegment
from betterbench.records.record import Record
from betterbench.tasks import Condition, Subgoal
from betterbench.tasks.relations import relation

NEAR_M = 0.20
"""Distance [m] from the position where the gripper closes or opens, at which a window begins.

This distance is longer than any straight approach.
"""
LIFTED_M = 0.06
"""Distance [m] from the position where the gripper closes, at which the window of a pick ends.

At this distance, the object is lifted and clear of its support. The window of a miss ends at the same distance from the
position where the gripper opens.
"""
LEFT_M = 0.10
"""Distance [m] from the position where the gripper opens, at which the window of a placement or a slide ends."""
HELD_ROWS = 3
"""Minimum number of rows for which an object must be held to count as picked."""
SLID_M = 0.005
"""Minimum motion of a drawer that counts as a slide [m]. It equals the largest gap of a closed drawer."""


@dataclass(frozen=True, slots=True)
class _Closure:
    """Rows [closed, opened) in which the gripper is commanded to close, with the resulting skill and its object."""

    closed: int
    opened: int
    kind: SkillKind
    object: str


def subgoal_segments(record: Record, condition: Condition) -> tuple[SubgoalSegment, ...]:
    """Return the segments of an episode, which cover all rows. The result is empty if the gripper never closed.

    Args:
        record: Record of the episode.
        condition: Condition of the episode.
    """
    found = list(_closures(record))
    if not found:
        return ()
    credited: set[int] = set()
    segments: list[SubgoalSegment] = []
    skills: list[SkillWindow] = []
    start, free_from = 0, 0
    for i, closure in enumerate(found):
        until = found[i + 1].closed if i + 1 < len(found) else len(record)
        served = _served(record, condition, closure, until - 1, credited)
        taken = next((c.object for c in found[i + 1 :] if c.object), "")
        for skill in _windows(record, closure, served, free_from, until, next_object=taken):
            skills.append(skill)
            free_from = skill.stop
        if served is not None:
            credited.add(condition.instruction.subgoals.index(served))
            stop = skills[-1].stop
            segments.append(_segment(served, closure.object, start, stop, skills))
            start, skills = stop, []
    if start < len(record):
        segments.append(SubgoalSegment("", "", "", "", "", start, len(record), tuple(skills)))
    return tuple(segments)


def _segment(goal: Subgoal, name: str, start: int, stop: int, skills: list[SkillWindow]) -> SubgoalSegment:
    return SubgoalSegment(goal.name, name, goal.target, goal.relation, goal.region, start, stop, tuple(skills))


def _closures(record: Record) -> Iterator[_Closure]:
    """Yield each interval in which the gripper is closed, with the resulting skill and its object."""
    closed = record.gripper_command > 0.0
    edges = np.flatnonzero(closed[1:] != closed[:-1]) + 1
    starts = [int(e) for e in edges if closed[e]]
    names = [o.name for o in record.metadata.scene.objects]
    drawers = [i for i, o in enumerate(record.metadata.scene.objects) if o.role == "drawer"]
    for start in starts:
        stop = next((int(e) for e in edges if e > start), len(record))
        moved = {i: _travel(record, i, start, min(stop, len(record) - 1)) for i in drawers}
        slid = max(moved, key=lambda i: moved[i], default=-1)
        held = record.held[start:stop]
        counts = np.bincount(held[held >= 0], minlength=len(names))
        counts[drawers] = 0
        taken = int(counts.argmax()) if names else -1
        if taken >= 0 and counts[taken] >= HELD_ROWS:
            yield _Closure(start, stop, "pick", names[taken])
        elif slid >= 0 and moved[slid] > SLID_M:
            yield _Closure(start, stop, "slide", names[slid])
        else:
            yield _Closure(start, stop, "miss", "")


def _travel(record: Record, index: int, start: int, stop: int) -> float:
    """Return the distance between an object's positions in two rows [m]."""
    positions = record.object_positions
    return float(np.linalg.norm(positions[stop, index] - positions[start, index]))


def _served(record: Record, condition: Condition, closure: _Closure, row: int, credited: set[int]) -> Subgoal | None:
    """Return the subgoal that a closure of the gripper has achieved at the given row, or None if there is none."""
    if closure.kind == "miss" or closure.opened >= len(record):
        return None
    state = record.state(row)
    for i, goal in enumerate(condition.instruction.subgoals):
        if i in credited or closure.object not in condition.resolve(goal.reference):
            continue
        if relation(goal.relation).carried is not (closure.kind == "pick"):
            continue
        if relation(goal.relation).holds(state, closure.object, goal.target, goal.region):
            return goal
    return None


def _windows(
    record: Record, closure: _Closure, served: Subgoal | None, free_from: int, until: int, *, next_object: str
) -> Iterator[SkillWindow]:
    """Yield the skill windows of one interval with a closed gripper: a pick and its placement, a slide, or a miss."""
    start = _begin(record, closure.closed, free_from)
    place = ("", "", "") if served is None else (served.target, served.relation, served.region)
    if closure.kind == "miss":
        stop = _end(record, closure.opened, LIFTED_M, until)
        yield SkillWindow("miss", next_object, "", "", "", start, closure.closed, max(stop, closure.closed + 1))
        return
    if closure.kind == "slide":
        stop = _end(record, closure.opened, LEFT_M, until)
        yield SkillWindow("slide", closure.object, *place, start, closure.closed, max(stop, closure.closed + 1))
        return
    last = min(closure.opened, len(record) - 1)
    stop = max(_end(record, closure.closed, LIFTED_M, last), closure.closed + 1)
    yield SkillWindow("pick", closure.object, "", "", "", start, closure.closed, stop)
    if closure.opened < len(record):
        begin = _begin(record, closure.opened, stop)
        end = max(_end(record, closure.opened, LEFT_M, until), closure.opened + 1)
        yield SkillWindow("place", closure.object, *place, begin, closure.opened, end)


def _begin(record: Record, change: int, earliest: int) -> int:
    """Return the first row from which the tool stays near its position in the row ``change``.

    The result is at least ``earliest``.
    """
    away = np.flatnonzero(_distances(record, earliest, change, change) >= NEAR_M)
    return min(earliest, change) if not len(away) else earliest + int(away[-1]) + 1


def _end(record: Record, change: int, away_m: float, latest: int) -> int:
    """Return the row after the first row in which the tool is ``away_m`` away from its position in the row ``change``.

    The result is at most ``latest``.
    """
    row = min(change, len(record) - 1)
    away = np.flatnonzero(_distances(record, row, latest, row) >= away_m)
    return min(row + int(away[0]) + 1, latest) if len(away) else latest


def _distances(record: Record, start: int, stop: int, row: int) -> np.ndarray:
    """Return the distances [m] of the tool from its position in ``row``, for the rows ``start`` to ``stop``."""
    found: np.ndarray = np.linalg.norm(record.ee_position[start:stop] - record.ee_position[row], axis=1)
    return found
