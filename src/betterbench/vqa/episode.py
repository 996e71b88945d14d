"""Facts about an episode that questions need: condition, objects, and the activity of the robot at each row."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from betterbench.diagnosis.analysis.trace import Trace, trace_of
from betterbench.diagnosis.trial import resolved_of
from betterbench.records import Record
from betterbench.tasks import get_task, suite_tasks
from betterbench.tasks.interventions.resolve import ResolvedCondition, condition_names, resolve_condition
from betterbench.tasks.judging.attempts import GraspAttempt, find_grasps

REACH_M = 0.10
"""Distance to the bounding box of an object within which the gripper visibly approaches the object [m].

Slots are 12 cm apart.
"""
NEAREST_BY_M = 0.03
"""Minimum difference in distance to the gripper between its visible target and all other objects [m]."""
CARRY_M = 0.03
"""Minimum height of an object above its previous support at which it is visibly carried [m]."""


class Act(StrEnum):
    """Activity of the robot that can be seen in an image."""

    REACHING = "reaching"
    CARRYING = "carrying"


@dataclass(frozen=True, slots=True)
class Doing:
    """Activity of the robot, with the index of the handled object."""

    act: Act
    object: int


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """Recorded trial, with the facts about the whole episode that questions need.

    Attributes:
        record: The record.
        resolved: Condition of the trial.
        trace: The record as arrays, up to the step limit.
        grasps: Grasp attempts in time order.
        vocabulary: Kinds of objects that occur in any condition of the task, sorted.
        foreign: Kinds of objects that occur only in other tasks of the suite, sorted.
    """

    record: Record
    resolved: ResolvedCondition
    trace: Trace
    grasps: tuple[GraspAttempt, ...]
    vocabulary: tuple[str, ...]
    foreign: tuple[str, ...]

    @property
    def rows(self) -> int:
        """Number of rows of the trace."""
        return self.trace.rows

    def doing(self, row: int) -> Doing | None:
        """Return the activity of the robot at a row, or None if an image would not show it clearly."""
        trace, held = self.trace, int(self.trace.held[row])
        if held >= 0:
            if trace.is_drawer(held):
                return None
            start = next((g.start for g in reversed(self.grasps) if g.start <= row and g.object == held), row)
            lifted = float(trace.positions[row, held, 2] - trace.positions[start, held, 2])
            return Doing(Act.CARRYING, held) if lifted >= CARRY_M else None
        following = next((g for g in self.grasps if g.start >= row), None)
        if following is None or following.object is None or trace.is_drawer(following.object):
            return None
        last = max((g.release for g in self.grasps if g.start < row), default=0)
        before = max(last, row - trace.steps(0.3))
        if trace.touched[row].any() or row <= last or before >= row:
            return None
        i = following.object
        now, then = (trace.box_distances(r, trace.tool[r]) for r in (row, before))
        others = [float(now[j]) for j in trace.items if j != i]
        alone = not others or min(others) >= float(now[i]) + NEAREST_BY_M
        nearer = float(now[i]) <= float(then[i])
        return Doing(Act.REACHING, i) if now[i] <= REACH_M and alone and nearer else None

    def out_of_place(self, i: int) -> bool:
        """Return whether an object starts in a slot where only other kinds of objects stood in training.

        This happens if the object was exchanged with another, or if it is a look-alike.
        """
        info = self.trace.info.objects[i]
        if info.slot is None:
            return False
        trained = self.trace.info.slot(info.slot).trained_kinds
        return bool(trained) and info.kind not in trained

    def replaced(self, kind: str) -> bool:
        """Return whether a different object starts in a slot where this kind of object stood in training.

        If so, the absence of this kind is hard to notice.
        """
        return any(
            self.out_of_place(i) and kind in self.trace.info.slot(o.slot).trained_kinds
            for i, o in enumerate(self.trace.info.objects)
            if o.slot is not None
        )


def episode_of(record: Record) -> Episode:
    """Collect the facts in a record that questions need.

    Raises:
        UnknownNameError: If the task or condition of the record is unknown.
        RecordError: If the record lacks a predicate of its task.
    """
    resolved = resolved_of(record.metadata)
    task = resolved.task
    trace = trace_of(record, resolved.condition, step_limit=task.step_limit(resolved.condition))
    own = kinds_of(task.id)
    foreign = sorted({kind for name in suite_tasks("better60") for kind in kinds_of(name)} - set(own))
    return Episode(record, resolved, trace, find_grasps(trace), own, tuple(foreign))


@functools.cache
def kinds_of(task: str) -> tuple[str, ...]:
    """Return the kinds of objects that occur in any condition of a task, sorted."""
    conditions = (resolve_condition(task, name).condition for name in condition_names(get_task(task)))
    return tuple(sorted({o.kind for condition in conditions for o in condition.objects}))


@functools.cache
def kinds_in_numbers() -> tuple[str, ...]:
    """Return the kinds of objects that occur more than once in at least one condition of the suite, sorted."""
    found = set()
    for task in suite_tasks("better60"):
        for name in condition_names(get_task(task)):
            kinds = [o.kind for o in resolve_condition(task, name).condition.objects]
            found |= {kind for kind in kinds if kinds.count(kind) > 1}
    return tuple(sorted(found))


def rows_to_ask(rows: int, count: int, draw: np.random.Generator) -> Sequence[int]:
    """Return ``count`` rows of an episode, one from each of ``count`` equally long parts.

    If ``count`` is 0, or if there are at most ``count`` rows, return all rows.
    """
    if count == 0 or count >= rows:
        return range(rows)
    edges = np.linspace(0, rows, count + 1).astype(int)
    return sorted(int(draw.integers(a, b)) for a, b in itertools.pairwise(edges))
