"""Collisions with fixtures are counted from contacts; what stands where it should collides with nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from betterbench.diagnosis.analysis.collisions import count_collisions
from betterbench.diagnosis.analysis.trace import trace_of
from betterbench.episodes import TrialContext, run_episode
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.experts import make_expert
from betterbench.records.columns import Contacts
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import FAST
from betterbench.tasks import THRESHOLDS, get_task
from betterbench.tasks.interventions.resolve import resolve_condition

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def record():
    task = get_task("seasoning_rack")
    scene = Scene(task, task.training[0], seed=0, action_space=EE_DELTA, quality=FAST)
    return run_episode(scene, make_expert("expert", scene), context=TrialContext("expert")).record


def counted(record):
    setting = resolve_condition("seasoning_rack", "train1")
    limit = setting.task.step_limit(setting.condition)
    return count_collisions(record, trace_of(record, setting.condition, step_limit=limit))


def with_touches(record, rows, one, other, force):
    """The record with one more contact in each of some rows."""
    bodies = tuple(dict.fromkeys((*record.bodies, one, other)))
    old, pairs, forces, offsets = record.contacts, [], [], [0]
    for row in range(len(record)):
        span = slice(int(old.offsets[row]), int(old.offsets[row + 1]))
        pairs += old.bodies[span].tolist()
        forces += old.forces[span].tolist()
        if row in rows:
            pairs.append([bodies.index(one), bodies.index(other)])
            forces.append(force)
        offsets.append(len(pairs))
    contacts = Contacts(np.array(offsets, np.int32), np.array(pairs, np.int16), np.array(forces, np.float64))
    return replace(record, bodies=bodies, contacts=contacts)


def held_rows(record):
    info = record.metadata.scene
    jar = next(i for i, o in enumerate(info.objects) if o.kind == "salt jar")
    return info.objects[jar].name, np.flatnonzero(record.held == jar)


def test_the_expert_does_not_collide(record):
    assert record.outcome.success
    assert counted(record) == 0


@pytest.mark.parametrize("body", ["hand", "arm", "left_finger"])
def test_a_touch_of_the_robot_counts_once_while_it_lasts(record, body):
    hard = THRESHOLDS.collision_force + 1.0
    assert counted(with_touches(record, range(10, 20), body, "rack", hard)) == 1
    assert counted(with_touches(record, [10, 12, 14], "rack", body, hard)) == 1
    assert counted(with_touches(record, [10, 60], body, "rack", hard)) == 2
    assert counted(with_touches(record, range(10, 20), body, "rack", THRESHOLDS.collision_force - 0.5)) == 0


def test_what_is_carried_collides_and_what_stands_does_not(record):
    jar, rows = held_rows(record)
    hard = THRESHOLDS.collision_force + 1.0
    assert len(rows) > 10
    assert counted(with_touches(record, rows[5:8].tolist(), jar, "rack", hard)) == 1
    before = range(3)
    assert counted(with_touches(record, before, jar, "rack", hard)) == 0, "nobody holds it"
    assert counted(with_touches(record, [len(record) - 1], jar, "rack", hard)) == 0, "it stands in its hole"
    assert counted(with_touches(record, rows[5:8].tolist(), jar, "table", hard)) == 0, "the table is no fixture"
