"""Dynamics that vary by trial: declared by a robot, drawn per seed, shared with the twin, recorded, and real."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from tests.robots import ROBOTS, task_of
from tests.sim.robots.bench import Bench

from betterbench.episodes import Observer, TrialContext, run_episode
from betterbench.errors import InvalidInputError
from betterbench.interface import EpisodeStart, observation_spec
from betterbench.interface.actions import SO101_DEGREES, action_space
from betterbench.policies import Noop
from betterbench.sim.robots import ArmController, build_robot_spec, robot
from betterbench.sim.robots.dynamics import draw_dynamics, with_dynamics
from betterbench.sim.robots.so101 import SO101
from betterbench.sim.robots.varied import VariedQuantity
from betterbench.sim.scenes import Scene, quality_preset
from betterbench.tasks import get_task, stream
from betterbench.tasks.interventions import vary

pytestmark = pytest.mark.physics

VARYING = [name for name in ROBOTS if robot(name).dynamics]


def scene(name: str, seed: int, condition: str = "train1") -> Scene:
    task = get_task(task_of(name))
    chosen = task.train(condition) if condition.startswith("train") else vary(task, task.variation(condition))[0]
    space = action_space(robot(name).action_spaces[0])
    return Scene(task, chosen, seed=seed, action_space=space, quality=quality_preset("fast"))


def test_the_panda_has_one_dynamics_and_the_so101_has_many():
    assert not robot("panda").dynamics
    assert "dynamics" not in robot("panda").to_json()
    assert [v["quantity"] for v in robot("so101").to_json()["dynamics"]] == [v.quantity for v in SO101.dynamics]
    assert VARYING


@pytest.mark.parametrize("name", ROBOTS)
def test_a_trial_draws_its_dynamics_from_its_seed(name):
    first, again, other = scene(name, 3), scene(name, 3), scene(name, 4)
    count = len(robot(name).arm_joints) + len(robot(name).finger_joints)
    assert list(first.dynamics) == [v.quantity for v in robot(name).dynamics]
    assert first.dynamics == again.dynamics
    for varied in robot(name).dynamics:
        values = first.dynamics[varied.quantity]
        assert len(values) == count
        assert all(varied.low <= value <= varied.high for value in values)
        assert values != other.dynamics[varied.quantity]
    if not robot(name).dynamics:
        assert first.model is first.compiled.model


@pytest.mark.parametrize("name", VARYING)
def test_a_twin_has_the_same_dynamics(name):
    task = get_task(task_of(name))
    for variation in task.variations[:3]:
        assert scene(name, 7, variation.name).dynamics == scene(name, 7, variation.base).dynamics


def test_every_quantity_reaches_the_model():
    model = build_robot_spec("so101", visuals=False).compile()
    model.stat.extent = 1.7
    fields = {
        "joint_damping": "dof_damping",
        "joint_friction": "dof_frictionloss",
        "joint_armature": "dof_armature",
    }
    for quantity, field in fields.items():
        made = with_dynamics(model, SO101, {quantity: tuple(1.1 + 0.1 * i for i in range(6))})
        shares = getattr(made, field) / getattr(model, field)
        assert shares == pytest.approx([1.1, 1.2, 1.3, 1.4, 1.5, 1.6])
        assert made.stat.extent == 1.7, "cameras keep their clipping planes"
    made = with_dynamics(model, SO101, {"joint_armature": (1.4,) * 6})
    assert (made.dof_M0 > model.dof_M0).all(), "derived constants follow"
    made = with_dynamics(model, SO101, {"servo_stiffness": (0.5,) * 6, "servo_damping": (2.0,) * 6})
    for servo in (*SO101.position_actuators, SO101.gripper_actuator):
        old, new = model.actuator(servo), made.actuator(servo)
        assert new.gainprm[0] == 0.5 * old.gainprm[0] == -new.biasprm[1]
    for servo in SO101.velocity_actuators:
        old, new = model.actuator(servo), made.actuator(servo)
        assert new.gainprm[0] == 2.0 * old.gainprm[0] == -new.biasprm[2]
    assert made.actuator("gripper").biasprm[2] == 2.0 * model.actuator("gripper").biasprm[2]
    assert with_dynamics(model, SO101, {"backlash": (0.01,) * 6}) is model
    assert with_dynamics(model, SO101, {}) is model


def test_a_weak_servo_sags_more():
    model = build_robot_spec("so101", visuals=False).compile()
    sag = []
    for factor in (1.0, 0.25):
        made = with_dynamics(model, SO101, {"servo_stiffness": (factor,) * 6})
        b = Bench(made, SO101_DEGREES, SO101)
        b.step(np.array([0.0, 60.0, -60.0, 0.0, 0.0, 50.0]), 60)
        sag.append(math.degrees(b.data.joint("shoulder_lift").qpos[0]) - 60.0)
    assert sag[1] > 2.0 * sag[0] > 0.0


def test_a_joint_follows_through_its_backlash_and_ends_on_the_side_of_its_last_motion():
    model, play = build_robot_spec("so101", visuals=False).compile(), math.radians(2.0)
    b = Bench(model, SO101_DEGREES, SO101)
    b.controller = ArmController(model, SO101, SO101_DEGREES, dynamics={"backlash": (play,) * 6})
    b.controller.reset(b.data)
    home = np.array([*(math.degrees(q) for q in SO101.home_joints), 60.0])
    ends = []
    for side in (-20.0, 20.0):
        away = home.copy()
        away[0] += side
        b.step(away, 30)
        b.step(home, 30)
        ends.append(math.degrees(b.data.joint("shoulder_pan").qpos[0]) - home[0])
    assert ends == pytest.approx([-1.0, 1.0], abs=0.05)
    moved = home.copy()
    moved[0] += 1.5  # from 1 degree above to 1 degree below: the gears turn through the play, and the joint rests
    b.step(moved, 20)
    assert math.degrees(b.data.joint("shoulder_pan").qpos[0]) - home[0] == pytest.approx(1.0, abs=0.05)


def test_a_snapshot_keeps_the_side_of_the_backlash():
    s = scene("so101", 5)
    first = s.state()
    known = robot("so101")
    still = np.array(known.positions_in(SO101_DEGREES, first.joint_positions, first.finger_width_m))
    for offset in (8.0, 0.0, 8.0):
        for _ in range(6):
            s.step(still + np.array([offset, 0.0, 0.0, 0.0, 0.0, 0.0]))
    kept, ends = s.snapshot(), []
    for _ in range(2):
        s.restore(kept)
        for _ in range(5):
            s.step(still)
        ends.append(s.simulator_state()["qpos"].tobytes())
    assert ends[0] == ends[1]


@pytest.mark.parametrize("name", ROBOTS)
def test_a_record_tells_its_dynamics(name):
    s, observer = scene(name, 2, "T1"), Observer(observation_spec("state_only"))
    policy = Noop()
    policy.reset(EpisodeStart("", 0, s.action_space.name))
    record = run_episode(s, policy, context=TrialContext("noop"), observer=observer).record
    observer.close()
    assert record.metadata.robot_dynamics == dict(s.dynamics)
    assert ("robot_dynamics" in record.metadata.to_json()) is bool(robot(name).dynamics)


def test_the_draw_of_a_factor_is_even_in_its_logarithm_and_each_quantity_has_its_own_stream():
    varied = VariedQuantity("joint_damping", 0.5, 2.0, "a test")
    values = varied.draw(np.random.default_rng(0), 4000)
    assert np.median(values) == pytest.approx(1.0, abs=0.05)
    assert (min(values), max(values)) == pytest.approx((0.5, 2.0), abs=0.01)
    fewer = dataclasses.replace(SO101, dynamics=SO101.dynamics[1:])

    def generator(quantity):
        return stream("fruit_basket", 0, f"robot dynamics:{quantity}")

    both = draw_dynamics(SO101, generator), draw_dynamics(fewer, generator)
    assert {name: both[0][name] for name in both[1]} == both[1]


@pytest.mark.parametrize(
    ("quantity", "low", "high", "text"),
    [
        ("joint_damping", 0.0, 2.0, r"the range 0 to 2 is not possible. Choose the range so that 0.001 ≤ low ≤ high"),
        ("backlash", 0.02, 0.01, r"the range 0.02 to 0.01 is not possible"),
        ("joint_damping", 1.0, math.inf, "not possible"),
        ("mass", 0.5, 2.0, "mass: the quantity is unknown. Use one of joint_damping, "),
    ],
)
def test_an_impossible_range_is_refused(quantity, low, high, text):
    with pytest.raises(InvalidInputError, match=text):
        VariedQuantity(quantity, low, high, "a test")
