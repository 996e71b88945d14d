"""Harm, i.e. changes to objects that the instruction does not ask for, and the times of these changes.

A trial with harm is not a success.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from betterbench.diagnosis.analysis.trace import Trace
from betterbench.geometry import Pose
from betterbench.records import Record
from betterbench.tasks import THRESHOLDS, Condition, get_task
from betterbench.tasks.judging.harm import Harm, HarmWatch, bystanders, is_turned_away, mere_targets
from betterbench.tasks.judging.targets import Asked, Targets
from betterbench.tasks.thresholds import ANCHOR_MOVED, DISPLACED, LEFT_OPEN, TARGET_MOVED

FINAL = frozenset({"turned", "target_moved", "anchor_moved", "left_open"})
"""Kinds of harm that only count if they are still present in the last state of the episode."""


class DatedHarm(NamedTuple):
    """Harm to an object, with the row of the trace where it first appears.

    For an object that was left at a wrong target, this is the last row of the trace.
    """

    row: int
    harm: Harm


def find_harm(record: Record, trace: Trace, condition: Condition) -> tuple[DatedHarm, ...]:
    """Return all harm in a record, in chronological order.

    Only the rows that can change the verdict are passed to the goal tracker. As in the trace, objects are identified by
    kind and slot, so their names do not matter.
    """
    info, template = trace.info, get_task(condition.task).template
    asked = tuple(
        Asked(g.relation, info.objects[t].name, g.region, tuple(info.objects[i].name for i in names), g.count)
        for g, t, names in zip(condition.instruction.subgoals, trace.targets, trace.meant, strict=True)
    )
    targets = Targets(asked, info, placing=template.relation)
    watch = HarmWatch(asked, targets, info, exclusive=template.exclusive)
    dates = {
        ("displaced", name): _first(_moved(trace, info.index(name)) > DISPLACED) for name in bystanders(asked, info)
    }
    dates |= {
        ("on_the_floor", o.name): _first(trace.positions[:, i, 2] < -THRESHOLDS.fallen_below)
        for i, o in enumerate(info.objects)
    }
    dates |= {("knocked_over", o.name): _since(_tilted(trace, i)) for i, o in enumerate(info.objects)}
    last = trace.rows - 1
    for row in sorted({0, *(row for row in dates.values() if row is not None)}):
        state = record.state(row)
        watch.see(state, targets.places(state))
    state = record.state(last)
    places = targets.places(state)
    watch.see(state, places)
    found = watch.found(state, places)
    targeted = mere_targets(asked, info)
    dates |= {
        (h.sort, h.object): _out_of_place_since(trace, info.index(h.object), h, target=h.object in targeted)
        for h in found
        if h.sort in FINAL
    }
    dated = (DatedHarm(dates.get((h.sort, h.object)) or last, h) for h in found)
    return tuple(sorted(dated, key=lambda one: one.row))


def _out_of_place_since(trace: Trace, i: int, harm: Harm, *, target: bool) -> int | None:
    """Return the row from which an object is turned, moved or open until the end, or None."""
    if harm.sort != "turned":
        limits = {"target_moved": TARGET_MOVED, "anchor_moved": ANCHOR_MOVED, "left_open": LEFT_OPEN}
        return _since(_moved(trace, i) > limits[harm.sort])
    rows = zip(trace.positions[:, i].tolist(), trace.quaternions[:, i].tolist(), strict=True)
    poses = [Pose(tuple(position), tuple(quaternion)) for position, quaternion in rows]
    thing = trace.info.objects[i]
    return _since(np.array([is_turned_away(thing, poses[0], pose, target=target) for pose in poses]))


def _moved(trace: Trace, i: int) -> np.ndarray:
    """Return how far the center of an object is from its initial position, for each row of the trace (T,) [m]."""
    w, x, y, z = trace.quaternions[:, i].T
    up = np.column_stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)))
    middles = trace.positions[:, i] + 0.5 * trace.info.objects[i].size_m[2] * up
    moved: np.ndarray = np.linalg.norm(middles - middles[0], axis=1)
    return moved


def _tilted(trace: Trace, i: int) -> np.ndarray:
    """Return whether an object is tilted so far that it counts as knocked over, for each row of the trace (T,)."""
    tilted: np.ndarray = 1.0 - 2.0 * (trace.quaternions[:, i, 1:3] ** 2).sum(axis=1) < np.cos(THRESHOLDS.knocked_tilt)
    return tilted


def _since(flags: np.ndarray) -> int | None:
    """Return the row where the final series of True flags begins.

    The result is None if there is no such row, or if all flags are true.
    """
    return int(np.flatnonzero(~flags)[-1]) + 1 if flags[-1] and not flags.all() else None


def _first(flags: np.ndarray) -> int | None:
    return int(np.argmax(flags)) if flags.any() else None
