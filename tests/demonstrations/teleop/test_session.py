"""A teleoperated episode without a browser: what undo promises, and that the record is like any other."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from scripted_operator import fresh_scene, go, grasp_of, hold, pack

from betterbench.demonstrations.teleop.session import Command, TeleopSession
from betterbench.demonstrations.teleop.steering import IN_THE_TABLE, OUT_OF_REACH
from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose

pytestmark = pytest.mark.physics


def whole_state(session):
    """Everything that the next step depends on, as bytes."""
    scene = session.scene
    data = scene.snapshot().data
    columns = (data.qpos, data.qvel, data.act, data.ctrl, data.qacc_warmstart, data.tree_asleep, data.efc_force)
    return b"".join(np.ascontiguousarray(c).tobytes() for c in columns), scene.controller.state(), session.state


@pytest.fixture(scope="module")
def packed():
    """The episode without anything undone."""
    session = TeleopSession(fresh_scene())
    pack(session, "apple", 0)
    pack(session, "orange", 1)
    return session


def test_a_scripted_operator_packs_the_items(packed):
    assert packed.phase == "success"
    found = packed.finished("tester")
    assert found.note.failure in ("", "outside support"), found.note.reason
    meta = found.record.metadata
    assert (meta.demonstrator.kind, meta.demonstrator.name) == ("teleoperated", "tester")
    assert [s.subgoal for s in meta.segments if s.subgoal] == ["pack_apple", "pack_orange"]
    assert [w.kind for s in meta.segments for w in s.skills] == ["pick", "place"] * 2
    assert found.record.outcome.success


def test_what_was_undone_never_was(packed):
    session = TeleopSession(fresh_scene())
    pack(session, "apple", 0)
    at_subgoal = next(m.rows for m in session._moments if m.name == "pack_apple")
    orange, _ = grasp_of(session, "orange")
    go(session, orange.translated(z=0.02), closed=True)  # knocks against it with closed fingers
    go(session, Pose((0.45, 0.12, 0.12), orange.quaternion), closed=False)  # and into the lunchbox
    assert session.undo().startswith("pack_apple")
    while session.steps + 1 > at_subgoal:
        session.undo()
    assert session.steps + 1 == at_subgoal
    # The operator was on the way when the subgoal was done, and goes on from there as it did the first time.
    for row in packed._rows[at_subgoal:]:
        _again(session, row)
    assert session.finished("tester").record.same_bits(packed.finished("tester").record)
    assert whole_state(session) == whole_state(packed)


def _again(session, row):
    """Send the action of a row once more, past the steering."""
    applied = session.scene.step(row.action)
    session._take(session.scene.state(), row.action, applied)


def test_undo_and_restart_lead_to_the_same_states_bit_for_bit():
    session = TeleopSession(fresh_scene())
    start = whole_state(session)
    grasp, _ = grasp_of(session, "apple")
    go(session, grasp, closed=False)
    first = whole_state(session)
    assert session.undo() == "the start"
    assert (session.steps, whole_state(session)) == (0, start)
    assert session.undo() == "the start"  # nothing to undo
    go(session, grasp.translated(x=0.03), closed=True)
    session.restart()
    assert whole_state(session) == start
    go(session, grasp, closed=False)
    assert whole_state(session) == first


def test_the_record_is_that_of_a_scene_in_which_it_was_all_done_at_once(packed):
    scene = fresh_scene()
    scene.reset()
    record = packed.record("tester")
    for row in range(1, len(record)):
        scene.step(record.action[row])
        state = scene.simulator_state()
        assert all(np.array_equal(state[name], getattr(record, name)[row]) for name in ("qpos", "qvel", "act", "ctrl"))


def test_an_unfinished_episode_is_no_demonstration():
    session = TeleopSession(fresh_scene())
    hold(session, 3, closed=False)
    found = session.finished("tester")
    assert not found.note.accepted
    assert found.record.outcome.termination == "interrupted"


def test_an_episode_ends_at_its_step_limit_and_can_be_undone():
    session = TeleopSession(fresh_scene())
    session.limit = 5
    hold(session, 9, closed=False)
    assert (session.phase, session.steps) == ("step_limit", 5)
    session.undo()
    assert (session.phase, session.steps) == ("going", 0)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_command_that_is_not_finite_changes_nothing(bad):
    session = TeleopSession(fresh_scene())
    hold(session, 2, closed=False)
    before = whole_state(session)
    for target in (Pose((0.5, bad, 0.2)), Pose((0.5, 0.0, 0.2), (bad, 0.0, 0.0, 1.0)), Pose((0.5, 0, 0.2), (0,) * 4)):
        with pytest.raises(InvalidInputError, match="not finite"):
            session.step(Command(target, closed=False))
    with pytest.raises(InvalidInputError, match="not finite"):
        session.step(Command(None, closed=False, speed=bad))
    assert whole_state(session) == before


def test_a_target_out_of_reach_or_in_the_table_is_held_back_and_said():
    session = TeleopSession(fresh_scene())
    down = session.state.commanded_pose.quaternion
    go(session, Pose((0.3, -0.38, -0.5), down), closed=False)
    assert session.notice == IN_THE_TABLE
    assert 0.0 < session.state.ee_pose.position[2] < 0.02
    session.restart()
    assert session.notice == ""
    for far in ((3.0, 0.0, 0.4), (0.0, 0.0, 0.3), (0.4, 0.0, 5.0)):
        go(session, Pose(far, down), closed=False, most=60)
        assert session.notice == OUT_OF_REACH
        assert math.dist(session.state.ee_pose.position, session.state.commanded_pose.position) < 0.03
