"""The SO-101 demonstrated by hand: by its gizmo, and by a leader arm that does what the expert did."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.daily import others_slow

sys.path.insert(0, str(Path(__file__).parent))

from scripted_operator import fresh_scene, go, hold

from betterbench.demonstrations.teleop.leader import motion_for
from betterbench.demonstrations.teleop.session import Command, TeleopSession
from betterbench.demonstrations.teleop.steering import IN_THE_TABLE, OUT_OF_REACH, Reach
from betterbench.demonstrations.teleop.store import DemonstrationStore, TeleopPlan
from betterbench.episodes import TrialContext, run_episode
from betterbench.evaluation.running.replay import check_record
from betterbench.geometry import Pose
from betterbench.policies.experts import make_expert
from betterbench.records import RunFolder
from betterbench.sim.robots import ArmIK, robot, robot_names
from betterbench.sim.robots.so101 import SO101

pytestmark = pytest.mark.physics

TASK, CONDITION, SEED = "fruit_basket", "train1", 500_000_000


@pytest.mark.parametrize("name", others_slow(robot_names(), 2))
def test_every_target_that_an_operator_can_set_is_within_a_hands_breadth_of_its_reach(name):
    spec = robot(name)
    reach, ik = Reach.of(spec), ArmIK(spec)
    down = ik.forward(ik.home).quaternion
    draw, refused = np.random.default_rng(0), 0
    for position in draw.uniform((-0.2, -1.0, -0.2), (1.2, 1.0, 1.2), (60, 3)) * (spec.reach_m / 0.855):
        x, y, z = position.tolist()
        allowed, why = reach.within(Pose((x, y, z), down))
        refused += why in {OUT_OF_REACH, IN_THE_TABLE}
        assert (allowed.position == (x, y, z)) is (why == "")
        assert reach.within(allowed) == (allowed, "") or why
        if allowed.position[0] > 0.3 * spec.reach_m:
            assert ik.reach(ik.home, allowed).position_error_m < 0.06, allowed.position
    assert 10 < refused < 60


def test_a_gizmo_moves_the_arm_and_stops_at_its_reach():
    session = TeleopSession(fresh_scene(TASK, CONDITION, SEED))
    begun = session.state.commanded_pose
    target = begun.translated(x=0.03, y=0.04)
    go(session, target, closed=False)
    assert session.state.ee_pose.position == pytest.approx(target.position, abs=0.006)  # backlash
    assert session.is_waiting(target)
    go(session, begun.translated(x=0.4), closed=False)
    assert session.notice == OUT_OF_REACH
    assert session.state.ee_pose.position[0] < 0.36
    hold(session, 12, closed=True)
    assert session.state.finger_width_m < 0.01


@pytest.fixture(scope="module")
def expert():
    """Joints [rad] and gripper commands of the expert at each step of the trial."""
    scene = fresh_scene(TASK, CONDITION, SEED)
    result = run_episode(scene, make_expert("expert", scene), context=TrialContext("expert"))
    assert result.record.outcome.success
    return result.record.joint_positions, result.record.applied[:, -1]


def test_a_leader_arm_that_does_what_the_expert_did_demonstrates_the_task(expert, tmp_path):
    plan = TeleopPlan((TASK,), 1, CONDITION, SEED)
    with DemonstrationStore(tmp_path / "run", plan) as store:
        start = store.due()
        session, mirror = TeleopSession(store.scene(start)), motion_for(SO101)
        followed = lead(session, mirror, *expert)
        assert followed.phase == "success"
        found = session.finished("tester")
        assert found.note.failure in ("", "outside support"), found.note.reason
        path = store.save(start, session.scene, found, {})
    run = RunFolder.open(tmp_path / "run")
    assert run.plan["robot"] == "so101"
    assert check_record(path).identical
    assert found.record.metadata.robot_dynamics


def lead(session, mirror, joints, grippers):
    """Send the leader's readings of each step to the session, and its last one until the episode ends."""
    first = True
    for q, gripper in zip(joints, grippers, strict=True):
        degrees = {name: math.degrees(v) for name, v in zip(SO101.arm_joints, q, strict=True)}
        tool = mirror.tool(degrees)
        if first:
            mirror.take_hold(session.state.commanded_pose, tool)
            first = False
        target, closed = mirror.follow(tool, 0.0 if gripper > 0.0 else 100.0)
        session.step(Command(target, closed))
        if session.phase != "going":
            break
    for _ in range(60):
        if session.phase != "going":
            break
        session.step(Command(target, closed))
    return session
