"""A leader arm: its kinematics, what following means, and what lerobot raises when it is not there."""

from __future__ import annotations

import importlib
import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from betterbench.demonstrations.teleop.controls import Controls
from betterbench.demonstrations.teleop.leader import (
    JOINTS,
    SCALE,
    Follower,
    LeaderThread,
    Mirror,
    connect_leader,
    leader_tool,
    motion_for,
)
from betterbench.errors import InvalidInputError, MissingDependencyError
from betterbench.geometry import Pose, angle_between, distance, from_axis_angle
from betterbench.sim.robots import PANDA, ArmIK
from betterbench.sim.robots.so101 import SO101

angles = st.fixed_dictionaries({name: st.floats(-90.0, 90.0) for name in JOINTS})
HOME = dict.fromkeys(JOINTS, 0.0)
DOWN = Pose((0.4, 0.0, 0.3), (0.0, 1.0, 0.0, 0.0))


@given(angles, st.floats(-90.0, 90.0))
@settings(max_examples=30)
def test_turning_the_pan_joint_moves_the_tool_around_its_axis(degrees, pan):
    before, after = leader_tool(degrees), leader_tool({**degrees, "shoulder_pan": degrees["shoulder_pan"] + pan})
    assert after.position[2] == pytest.approx(before.position[2], abs=1e-9)
    axis = (0.03884, 0.0, 0.0)
    flat = [math.dist(p.position[:2], axis[:2]) for p in (before, after)]
    assert flat[0] == pytest.approx(flat[1], abs=1e-9)
    assert angle_between(before.quaternion, after.quaternion) == pytest.approx(abs(math.radians(pan)), abs=1e-6)


def test_the_tool_of_the_stretched_leader_is_where_its_model_has_it():
    assert leader_tool(HOME).position == pytest.approx((0.39136, 0.0, 0.22647), abs=1e-4)
    # Joints bend only what comes after them, all about horizontal axes to the left.
    for name in ("shoulder_lift", "elbow_flex", "wrist_flex"):
        bent = leader_tool({**HOME, name: 10.0})
        assert bent.position[2] < 0.2265
        assert bent.position[1] == pytest.approx(0.0, abs=1e-4)
    rolled = leader_tool({**HOME, "wrist_roll": 90.0})
    assert distance(rolled.position, leader_tool(HOME).position) < 0.02


@given(angles, angles)
@settings(max_examples=30)
def test_following_begins_where_both_are_and_is_undone_by_going_back(first, second):
    follower = Follower()
    follower.take_hold(DOWN, leader_tool(first))
    there, _ = follower.follow(leader_tool(second), 100.0)
    moved = distance(leader_tool(first).position, leader_tool(second).position)
    assert distance(there.position, DOWN.position) == pytest.approx(SCALE * moved, abs=1e-9)
    back, _ = follower.follow(leader_tool(first), 100.0)
    assert distance(back.position, DOWN.position) < 1e-9
    assert angle_between(back.quaternion, DOWN.quaternion) < 1e-6


def test_turns_of_the_leader_are_turns_of_the_tool_in_the_frame_of_the_base():
    follower = Follower()
    follower.take_hold(DOWN, Pose())
    turned, _ = follower.follow(Pose((0.0, 0.0, 0.0), from_axis_angle((0.0, 0.0, 0.5))), 100.0)
    assert angle_between(turned.quaternion, DOWN.quaternion) == pytest.approx(0.5)
    assert turned.apply((0.0, 0.0, 1.0))[2] < DOWN.position[2]  # it still points down


def test_the_gripper_does_not_chatter():
    follower = Follower()
    follower.take_hold(DOWN, Pose())
    seen = [follower.follow(Pose(), g)[1] for g in (100.0, 40.0, 31.0, 29.0, 31.0, 44.0, 46.0, 31.0)]
    assert seen == [False, False, False, True, True, True, False, False]


@pytest.mark.parametrize("bad", [{}, {**HOME, "elbow_flex": math.nan}, {**HOME, "wrist_roll": math.inf}])
def test_readings_that_are_missing_or_not_finite_are_named(bad):
    with pytest.raises(InvalidInputError, match=r"leader arm: the angle of \w+ is (nan|inf)"):
        leader_tool(bad)


class FakeLeader:
    """What lerobot's teleoperators promise."""

    id, calibration_fpath = "mine", "/calibrations/mine.json"

    def __init__(self, config=None):
        motor = SimpleNamespace(homing_offset=5, range_min=100, range_max=3000)
        self.calibration = dict.fromkeys((*JOINTS, "gripper"), motor)
        self.bus = SimpleNamespace(
            connect=lambda: None, read_calibration=lambda: self.calibration, disconnect=self.bus_closes
        )
        self.config, self.degrees, self.gripper, self.problem = config, dict(HOME), 100.0, None
        self.is_connected = False

    def connect(self, *, calibrate):
        assert not calibrate
        if self.problem is not None:
            raise self.problem
        self.is_connected = True

    def get_action(self):
        if self.problem is not None:
            raise self.problem
        return {f"{name}.pos": v for name, v in {**self.degrees, "gripper": self.gripper}.items()}

    def disconnect(self):
        self.is_connected = False

    def bus_closes(self, *, disable_torque):
        assert not disable_torque
        self.is_connected = False


def until(controls, wanted):
    for _ in range(400):
        asked = controls.take(time.monotonic())
        if wanted(asked):
            return asked
        time.sleep(0.005)
    raise AssertionError("it did not answer")


def test_the_tool_follows_from_where_it_is_and_takes_hold_anew():
    controls, leader = Controls(), FakeLeader()
    thread = LeaderThread(leader, controls, Follower())
    try:
        time.sleep(0.1)
        assert controls.take(0.0).drag is None  # there is no tool yet
        controls.hold_from(DOWN)
        assert distance(until(controls, lambda a: a.drag).drag.position, DOWN.position) < 1e-9
        leader.degrees["shoulder_pan"], leader.gripper = -10.0, 0.0
        asked = until(controls, lambda a: a.closed and a.drag.position[1] > 0.05)
        assert asked.drag.position[2] == pytest.approx(DOWN.position[2])
        controls.hold_from(DOWN)  # undone: the leader stays where it is, and so does the tool
        assert distance(until(controls, lambda a: a.drag).drag.position, DOWN.position) < 1e-9
        leader.problem = ConnectionError("no status packet")
        time.sleep(1.0)
        until(controls, lambda a: a.drag is None)
        assert any("no status packet" in line for line in controls.take_problems())
    finally:
        thread.close()
    assert not leader.is_connected


def degrees_of(joints):
    return {name: math.degrees(q) for name, q in zip(JOINTS, joints, strict=True)}


def test_a_robot_with_the_leaders_joints_goes_where_its_joints_are():
    assert isinstance(motion_for(PANDA), Follower)
    mirror, ik = motion_for(SO101), ArmIK(SO101)
    assert isinstance(mirror, Mirror)
    home = np.array(SO101.home_joints)
    away = np.add(home, [0.6, 0.2, -0.1, 0.1, 0.3])
    assert mirror.tool(degrees_of(away)) == ik.forward(away)
    mirror.take_hold(ik.forward(home), mirror.tool(degrees_of(away)))
    assert mirror.follow(mirror.tool(degrees_of(away)), 0.0) == (None, False)  # not a jump, and no closing
    near = mirror.tool(degrees_of(home + 0.05))
    assert mirror.follow(near, 0.0) == (near, True)
    assert mirror.follow(mirror.tool(degrees_of(away)), 100.0) == (mirror.tool(degrees_of(away)), False)
    mirror.take_hold(ik.forward(home), mirror.tool(degrees_of(away)))  # undone
    assert mirror.follow(mirror.tool(degrees_of(away)), 100.0)[0] is None
    with pytest.raises(InvalidInputError, match="leader arm: the angle of elbow_flex is nan"):
        mirror.tool({**HOME, "elbow_flex": math.nan})


def test_the_thread_says_how_far_the_leader_is_and_then_leads_the_mirror():
    controls, leader, ik = Controls(), FakeLeader(), ArmIK(SO101)
    home = np.array(SO101.home_joints)

    def turned(pan):
        return np.add(home, [pan, 0.0, 0.0, 0.0, 0.0])

    leader.degrees = degrees_of(turned(1.0))
    thread = LeaderThread(leader, controls, motion_for(SO101))
    try:
        controls.hold_from(ik.forward(home))
        for _ in range(200):
            said = controls.take_problems()
            if said:
                break
            time.sleep(0.01)
        assert said == ["leader arm: it is 15 cm from the robot's tool. Bring it within 5 cm to make the robot follow"]
        assert controls.take(time.monotonic()).drag is None
        leader.degrees = degrees_of(home)
        until(controls, lambda a: a.drag)
        leader.degrees = degrees_of(turned(0.5))
        asked = until(controls, lambda a: a.drag and a.drag.position[1] < -0.05)
        assert asked.drag.position == pytest.approx(ik.forward(turned(0.5)).position, abs=1e-9)
    finally:
        thread.close()


@pytest.fixture
def lerobot(monkeypatch):
    """A lerobot whose only arm is ours."""
    leader = FakeLeader()
    config = SimpleNamespace(get_choice_class=lambda kind: lambda **given: {"kind": kind, **given})
    modules = {
        "lerobot.teleoperators.config": SimpleNamespace(TeleoperatorConfig=config),
        "lerobot.teleoperators.utils": SimpleNamespace(
            make_teleoperator_from_config=lambda given: setattr(leader, "config", given) or leader
        ),
        "lerobot.teleoperators.so_leader": SimpleNamespace(),
    }

    def fake(name):
        if name in modules:
            return modules[name]
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(importlib, "import_module", fake)
    return leader


def test_the_arm_is_made_by_lerobot_with_degrees(lerobot):
    assert connect_leader("so101_leader", "/dev/ttyACM0", "mine") is lerobot
    assert lerobot.is_connected
    assert lerobot.config == {"kind": "so101_leader", "port": "/dev/ttyACM0", "id": "mine", "use_degrees": True}


def test_an_arm_that_cannot_be_reached_or_is_not_calibrated_is_named(lerobot):
    lerobot.problem = ConnectionError("Could not connect on port '/dev/ttyACM0'")
    with pytest.raises(InvalidInputError, match=r"--leader-port.*there is no /dev/none.*lerobot-find-port"):
        connect_leader("so101_leader", "/dev/none", "mine")
    with pytest.raises(InvalidInputError, match=r"--leader-port: /dev/null: Could not connect.*lerobot-find-port"):
        connect_leader("so101_leader", "/dev/null", "mine")
    lerobot.problem, lerobot.calibration = None, {}
    with pytest.raises(
        InvalidInputError, match=r"'mine': not calibrated: there is no .*lerobot-calibrate --teleop.type=so101_lead"
    ):
        connect_leader("so101_leader", "/dev/null", "mine")
    assert not lerobot.is_connected
    with pytest.raises(InvalidInputError, match="so101_leader, so100_leader"):
        connect_leader("koch_leader", "/dev/ttyACM0", "mine")
    with pytest.raises(InvalidInputError, match="--leader-port"):
        connect_leader("so101_leader", "", "mine")


def test_without_lerobot_the_cure_is_named(monkeypatch):
    def none(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(importlib, "import_module", none)
    with pytest.raises(MissingDependencyError, match=r"pip install .*'lerobot\[feetech\]'"):
        connect_leader("so101_leader", "/dev/ttyACM0", "mine")
