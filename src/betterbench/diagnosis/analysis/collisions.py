"""Collisions of the robot or a held object with fixtures. They are counted but do not affect success."""

from __future__ import annotations

import numpy as np

from betterbench.diagnosis.analysis.trace import Trace
from betterbench.interface.state.world import GRIPPER_BODIES
from betterbench.records import Record
from betterbench.tasks import THRESHOLDS

_ROBOT = GRIPPER_BODIES | {"arm"}


def count_collisions(record: Record, trace: Trace) -> int:
    """Return the number of collisions with fixtures in an episode.

    A collision begins when the robot, or the object in its gripper, presses on a fixture with more force than
    ``collision_force``. It ends when no such force has occurred for ``collision_gap``. The contact of an object with
    the fixture that supports it at its goal, such as a jar standing at the bottom of its hole, is not a collision.
    """
    objects = trace.info.objects
    index = {o.name: i for i, o in enumerate(objects)}
    fixtures = {o.name for o in objects if o.role == "fixture" and o.fixed}
    bodies, contacts = record.bodies, record.contacts
    gap = trace.steps(THRESHOLDS.collision_gap)
    last: dict[tuple[str, str], int] = {}
    count = 0
    stop = int(contacts.offsets[trace.rows])
    strong = np.flatnonzero(contacts.forces[:stop] > THRESHOLDS.collision_force)
    rows = np.searchsorted(contacts.offsets, strong, side="right") - 1
    for row, pair in zip(rows.tolist(), contacts.bodies[strong].tolist(), strict=True):
        one, other = bodies[pair[0]], bodies[pair[1]]
        if one in fixtures:
            one, other = other, one
        if other not in fixtures:
            continue
        i = index.get(one)
        if i is not None:
            carried = trace.held[row] == i or trace.left[row, i] or trace.right[row, i]
            if not carried or trace.serves[row, :, i].any():
                continue
        elif one not in _ROBOT:
            continue
        if row - last.get((one, other), -gap - 1) > gap:
            count += 1
        last[(one, other)] = row
    return count
