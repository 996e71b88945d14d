from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from tests.sim.robots.bench import Bench

from betterbench.errors import InvalidActionError, InvalidInputError
from betterbench.geometry import Pose, angle_between, conjugate, distance, from_axis_angle, multiply, to_axis_angle
from betterbench.interface.actions import (
    ACTION_SPACES,
    EE_DELTA,
    EE_DELTA_MEASURED,
    EE_POSE,
    JOINT_DELTA,
    JOINT_POSITION,
    ActionSpace,
)
from betterbench.sim.robots import PANDA, ArmController, ArmIK, build_robot_spec
from betterbench.sim.robots.control import JOINT_LEAD_RAD, POSITION_LEAD_M, ROTATION_LEAD_RAD
from betterbench.sim.robots.physics import PHYSICS

pytestmark = pytest.mark.physics

Make = Callable[[ActionSpace], Bench]


def unit(index: int, value: float = 1.0, dim: int = 7) -> np.ndarray:
    action = np.zeros(dim)
    action[index] = value
    return action


def test_zero_action_holds_still(bench: Make) -> None:
    b = bench(EE_DELTA)
    b.step(np.array([0.3, -0.2, -0.5, 0.1, 0.0, 0.2, 1.0]), 8)
    b.step(np.zeros(7), 10)
    start = np.array(b.controller.measured_pose(b.data).position)
    width = b.controller.measured_width_m(b.data)
    positions = b.step(np.zeros(7), 200)
    assert np.linalg.norm(positions - start, axis=1).max() < 1e-4
    assert b.controller.measured_width_m(b.data) == pytest.approx(width, abs=1e-4)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("space", [EE_DELTA, EE_DELTA_MEASURED], ids=lambda s: s.name)
def test_one_unit_is_five_centimeters_along_the_base_axes(
    bench: Make, space: ActionSpace, axis: int, sign: float
) -> None:
    b = bench(EE_DELTA)
    start = np.array(b.controller.commanded_pose.position)
    b.controller = ArmController(b.model, PANDA, space)
    b.controller.reset(b.data)
    b.step(unit(axis, 0.4 * sign))
    asked = np.array(b.controller.commanded_pose.position) - start
    assert asked == pytest.approx(0.4 * sign * 0.05 * np.eye(3)[axis], abs=1e-9)
    if space is EE_DELTA:
        reached = b.step(np.zeros(7), 12)[-1] - start
        assert reached == pytest.approx(asked, abs=2e-4)


@pytest.mark.parametrize("axis", [3, 4, 5])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_one_unit_is_half_a_radian_about_the_base_axes(bench: Make, axis: int, sign: float) -> None:
    b = bench(EE_DELTA)
    start = b.controller.commanded_pose
    b.step(unit(axis, 0.5 * sign))
    b.step(np.zeros(7), 15)
    reached = b.controller.measured_pose(b.data)
    turned = to_axis_angle(multiply(reached.quaternion, conjugate(start.quaternion)))
    assert turned == pytest.approx(tuple(0.25 * sign * np.eye(3)[axis - 3]), abs=2e-3)
    assert distance(start.position, reached.position) < 5e-4


def test_the_gripper_closes_on_plus_and_opens_on_minus_at_finite_speed(bench: Make) -> None:
    b = bench(EE_DELTA)
    assert b.controller.measured_width_m(b.data) == pytest.approx(0.08, abs=1e-6)
    b.step(unit(6, 1.0), 8)
    assert b.controller.measured_width_m(b.data) == pytest.approx(0.04, abs=0.004)
    b.step(unit(6, 0.0), 10)
    halfway = b.controller.measured_width_m(b.data)
    assert halfway == pytest.approx(b.controller.commanded_width_m, abs=5e-4)
    b.step(unit(6, 0.3), 12)
    assert b.controller.measured_width_m(b.data) < 0.001, "only the sign of the command counts"
    b.step(unit(6, -1.0), 20)
    assert b.controller.measured_width_m(b.data) == pytest.approx(0.08, abs=5e-4)


def test_ee_pose_reaches_an_absolute_pose(bench: Make) -> None:
    b = bench(EE_POSE)
    target = Pose((0.5, 0.2, 0.25), multiply(from_axis_angle((0.0, 0.0, 0.6)), (0.0, 1.0, 0.0, 0.0)))
    action = np.array([*target.position, *(-3e-1 * np.array(target.quaternion)), 0.0])
    positions = b.step(action, 30)
    reached = b.controller.measured_pose(b.data)
    assert distance(reached.position, target.position) < 5e-4
    assert angle_between(reached.quaternion, target.quaternion) < 2e-3
    begun = bench(EE_POSE)
    start = np.array(begun.controller.measured_pose(begun.data).position)
    way = (np.array(target.position) - start) / np.linalg.norm(np.array(target.position) - start)
    off = (positions - start) - np.outer((positions - start) @ way, way)
    assert np.linalg.norm(off, axis=1).max() < 0.02, "the way is nearly straight"


def test_ee_pose_refuses_a_zero_quaternion(bench: Make) -> None:
    with pytest.raises(InvalidActionError, match="quaternion is zero"):
        bench(EE_POSE).step(np.array([0.5, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0]))


def test_joint_spaces_move_joints_as_declared(bench: Make) -> None:
    b = bench(JOINT_DELTA)
    b.step(unit(6, -0.5, 8))
    b.step(np.zeros(8), 10)
    expected = np.array(PANDA.home_joints)
    expected[6] -= 0.05
    assert b.data.qpos[:7] == pytest.approx(expected, abs=5e-4)
    b = bench(JOINT_POSITION)
    goal = np.array(PANDA.home_joints) + np.array([0.4, -0.2, 0.3, 0.2, -0.4, 0.1, 0.5])
    b.step(np.append(goal, 1.0), 20)
    assert b.data.qpos[:7] == pytest.approx(goal, abs=5e-4)
    assert b.controller.measured_width_m(b.data) < 0.001


@pytest.mark.parametrize("space", ACTION_SPACES.values(), ids=ACTION_SPACES.keys())
def test_random_actions_never_leave_the_limits_and_repeat_bit_for_bit(bench: Make, space: ActionSpace) -> None:
    random = np.random.default_rng(7)
    low, high = np.array(space.low), np.array(space.high)
    actions = random.uniform(low, high, (200, space.dim))
    first, second = bench(space), bench(space)
    joint_low, joint_high = np.array(PANDA.joint_low), np.array(PANDA.joint_high)
    fastest = np.zeros(7)
    for action in actions:
        first.step(action)
        assert (first.data.qpos[:7] >= joint_low).all()
        assert (first.data.qpos[:7] <= joint_high).all()
        assert (np.abs(first.data.qfrc_actuator[:7]) <= np.array(PANDA.joint_effort) + 1e-9).all()
        fastest = np.maximum(fastest, np.abs(first.data.ctrl[: 2 * 7 : 2]))
    assert (fastest <= np.array(PANDA.joint_velocity) + 1e-9).all()
    for action in actions[:60]:
        second.step(second.controller.action_space.clip(action))
    third = bench(space)
    for action in actions[:60]:
        third.step(action)
    assert second.data.qpos.tobytes() == third.data.qpos.tobytes()
    assert second.data.act.tobytes() == third.data.act.tobytes()


def test_an_episode_continues_from_a_stored_state(arm_model: mujoco.MjModel, bench: Make) -> None:
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    actions = np.random.default_rng(3).uniform(-0.6, 0.6, (30, 7))
    b = bench(EE_DELTA)
    for action in actions[:15]:
        b.step(action)
    stored = np.zeros(mujoco.mj_stateSize(arm_model, kind))
    mujoco.mj_getState(arm_model, b.data, stored, kind)
    memory = b.controller.state()
    for action in actions[15:]:
        b.step(action)
    other = bench(EE_DELTA)
    mujoco.mj_setState(arm_model, other.data, stored, kind)
    mujoco.mj_forward(arm_model, other.data)
    other.controller.restore(memory)
    for action in actions[15:]:
        other.step(action)
    assert other.data.qpos.tobytes() == b.data.qpos.tobytes()


def test_apply_returns_what_was_applied(bench: Make) -> None:
    b = bench(EE_DELTA)
    applied = b.controller.apply(b.data, np.array([2.0, -3.0, 0.5, 0, 0, 0, 9.0], dtype=np.float32))
    assert applied.tolist() == [1.0, -1.0, 0.5, 0.0, 0.0, 0.0, 1.0]


def test_an_invalid_action_changes_nothing(bench: Make) -> None:
    b = bench(EE_DELTA)
    before = b.data.ctrl.tobytes(), b.controller.state()
    for bad in (np.full(7, np.nan), np.zeros(8), "close", None):
        with pytest.raises(InvalidActionError):
            b.controller.apply(b.data, bad)
    assert (b.data.ctrl.tobytes(), b.controller.state()) == before


def test_the_arm_follows_without_lag_and_settles(bench: Make) -> None:
    for axis, sign in ((0, 1.0), (1, 1.0), (2, -1.0)):
        b = bench(EE_DELTA)
        b.step(unit(axis, 0.25 * sign), 14)
        goal = np.array(b.controller.commanded_pose.position)
        lag = np.linalg.norm(goal - np.array(b.controller.measured_pose(b.data).position))
        assert lag < 0.003, "at the end of a move at 0.25 m/s"
        after = np.linalg.norm(b.step(np.zeros(7), 10) - goal, axis=1)
        assert after.max() < 0.007, "one step later; most with the arm folded, low and close to its base"
        assert after[4] < 5e-4
        assert after[-1] < 5e-5
        assert (np.diff(after[3:]) < 1e-4).all(), "no oscillation"


def test_a_blocked_arm_winds_nothing_up(block_model: mujoco.MjModel) -> None:
    b = Bench(block_model, EE_DELTA)
    b.step(np.array([0.25, 0.5, -0.5, 0, 0, 0, 1.0]), 18)
    b.step(unit(2, -0.3), 40)
    measured, commanded = b.controller.measured_pose(b.data), b.controller.commanded_pose
    assert measured.position[2] > -0.002, "the table is not pushed through"
    assert distance(commanded.position, measured.position) < POSITION_LEAD_M + 0.01
    assert angle_between(commanded.quaternion, measured.quaternion) < ROTATION_LEAD_RAD + 0.05
    assert np.abs(b.data.act[:7] - b.data.qpos[:7]).max() < JOINT_LEAD_RAD + 0.05
    lifted = b.step(unit(2, 1.0), 3)
    assert lifted[-1][2] > measured.position[2] + 0.02, "it comes off at once"


def test_a_held_block_does_not_slip(block_model: mujoco.MjModel) -> None:
    b = Bench(block_model, EE_DELTA)
    approach = (np.array((0.45, 0.0, 0.025)) - np.array(b.controller.commanded_pose.position)) / 0.05
    b.step(np.append(approach / 32.0, [0, 0, 0, -1.0]), 32)
    b.step(unit(6, 1.0), 15)
    forces = dict.fromkeys(PANDA.pad_geoms, 0.0)
    wrench = np.zeros(6)
    for number, contact in enumerate(b.data.contact):
        mujoco.mj_contactForce(b.model, b.data, number, wrench)
        for name in PANDA.pad_geoms:
            if b.model.geom(name).id in (contact.geom1, contact.geom2):
                forces[name] += float(wrench[0])
    assert all(35.0 < force < 70.0 for force in forces.values()), forces
    b.step(unit(2, 0.25), 12)
    b.step(np.zeros(7), 10)

    def in_hand() -> np.ndarray:
        mujoco.mj_kinematics(b.model, b.data)
        site = b.data.site("tcp")
        offset: np.ndarray = site.xmat.reshape(3, 3).T @ (b.data.body("block").xpos - site.xpos)
        return offset

    before = in_hand()
    assert b.data.body("block").xpos[2] > 0.15
    b.step(np.zeros(7), 100)
    assert np.linalg.norm(in_hand() - before) < 1e-4, "five seconds at rest"
    b.step(unit(1, 0.25), 12)
    b.step(np.zeros(7), 6)
    assert np.linalg.norm(in_hand() - before) < 1e-3, "a move at 0.25 m/s"
    sag = distance(b.controller.commanded_pose.position, b.controller.measured_pose(b.data).position)
    assert sag < 1e-3
    width = b.controller.measured_width_m(b.data)
    assert width == pytest.approx(0.05, abs=0.001)
    b.step(unit(6, -1.0), 5)
    assert b.controller.measured_width_m(b.data) > width + 0.003, "it lets go within a quarter of a second"


def test_a_robot_attached_under_a_prefix_is_driven_the_same(bench: Make) -> None:
    parent = build_robot_spec("panda", visuals=False)
    world = mujoco.MjSpec()
    PHYSICS.set_solver(world)
    world.attach(parent, prefix="robot/", frame=world.worldbody.add_frame())
    model = world.compile()
    data = mujoco.MjData(model)
    controller = ArmController(model, PANDA, prefix="robot/")
    controller.home(data)
    mujoco.mj_forward(model, data)
    alone = bench(EE_DELTA)
    action = np.array([0.2, -0.3, -0.4, 0.1, 0.2, -0.1, 1.0])
    for _ in range(5):
        controller.apply(data, action)
        mujoco.mj_step(model, data, nstep=controller.substeps)
    alone.step(action, 5)
    assert data.qpos == pytest.approx(alone.data.qpos, abs=1e-12)
    with pytest.raises(InvalidInputError, match="prefix"):
        ArmController(model, PANDA)


def test_a_base_that_is_not_at_the_origin_is_refused() -> None:
    moved = build_robot_spec("panda", visuals=False)
    moved.body("link0").pos = (0.1, 0.0, 0.0)
    with pytest.raises(InvalidInputError, match="origin"):
        ArmController(moved.compile(), PANDA)


def test_an_action_space_of_another_robot_is_refused(arm_model: mujoco.MjModel) -> None:
    six = ActionSpace(
        name="joint_delta",
        components=("a", "gripper"),
        units=("rad", "1"),
        low=(-1.0, -1.0),
        high=(1.0, 1.0),
        scale=(1.0, 1.0),
        convention="another arm",
    )
    with pytest.raises(InvalidInputError, match="joint_delta"):
        ArmController(arm_model, PANDA, six)


def test_reset_adopts_any_posture(bench: Make, ik: ArmIK) -> None:
    b = bench(EE_DELTA)
    posture = ik.home + np.array([0.3, 0.2, -0.2, 0.3, 0.1, 0.2, -0.4])
    b.data.qpos[:7] = posture
    b.data.qvel[:] = 0.0
    b.controller.reset(b.data)
    mujoco.mj_forward(b.model, b.data)
    start = b.controller.commanded_pose
    assert distance(start.position, ik.forward(posture).position) == 0.0
    moved = b.step(np.zeros(7), 40)
    assert np.linalg.norm(moved - np.array(start.position), axis=1).max() < 5e-4
    assert math.isfinite(float(b.data.qpos.sum()))
