"""The SO-101: its model, its units, its reach and its expert; and laws that hold for every robot."""

from __future__ import annotations

import functools
import math

import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from tests.daily import others_slow
from tests.sim.robots.bench import Bench
from tests.sim.robots.so101_table import TABLE, places, table

from betterbench.certification.examine import planned_grasps, watch_expert
from betterbench.certification.handling import Pick, Put
from betterbench.certification.placing import place_task
from betterbench.episodes.gymnasium_env import TaskEnv
from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose, from_axis_angle, from_yaw, multiply, normalize, rotate
from betterbench.interface.actions import EE_DELTA, SO101_DEGREES, SO101_NORMALIZED, action_space
from betterbench.policies.experts import make_expert
from betterbench.records.modalities.labels import STAGE
from betterbench.sim.robots import ArmController, ArmIK, IKResult, build_robot_spec, robot, robot_names
from betterbench.sim.robots.building import COLLISION_GROUP
from betterbench.sim.robots.so101 import SO101
from betterbench.sim.scenes import Clearance, Scene
from betterbench.sim.scenes.instances import instances_of_bodies
from betterbench.tasks import get_task
from betterbench.tasks.authoring.registry import registered_for_now

pytestmark = pytest.mark.physics

PLACES = places(40)
DOWN = (0.0, 1.0, 0.0, 0.0)
ROBOT_SPACES = [(name, space) for name in robot_names() for space in robot(name).action_spaces]


@functools.cache
def model_of(name: str) -> mujoco.MjModel:
    return build_robot_spec(name, visuals=False).compile()


@functools.cache
def arm() -> ArmIK:
    return ArmIK(SO101)


# Laws of every robot


@pytest.mark.parametrize(("name", "space"), ROBOT_SPACES)
def test_random_actions_of_every_space_stay_within_the_limits_and_repeat_bit_for_bit(name: str, space: str) -> None:
    known, declared = robot(name), action_space(space)
    actions = np.random.default_rng(3).uniform(declared.low, declared.high, (25, declared.dim))
    ends = []
    for _ in range(2):
        b = Bench(model_of(name), declared, known)
        for action in actions:
            b.step(action)
            joints = [b.data.joint(joint).qpos[0] for joint in known.arm_joints]
            assert (np.array(joints) > known.joint_low).all()
            assert (np.array(joints) < known.joint_high).all()
            assert -0.002 < b.controller.measured_width_m(b.data) < known.jaw.width_at_share(1.0) + 0.002
        ends.append(b.data.qpos.tobytes())
    assert ends[0] == ends[1]


@pytest.mark.parametrize("name", robot_names())
def test_the_opening_width_and_the_finger_joints_are_inverse(name: str) -> None:
    known = robot(name)
    for width in np.linspace(0.01, known.gripper_opening_m, 7):
        joints = known.jaw.joints_at(float(width))
        assert len(joints) == len(known.finger_joints)
        assert known.jaw.width_at(joints) == pytest.approx(width, abs=1e-9)
        assert known.jaw.width_at_share(known.jaw.share_at(float(width))) == pytest.approx(width, abs=1e-9)


@pytest.mark.parametrize("name", robot_names())
def test_the_width_is_the_measured_distance_of_the_pads(name: str) -> None:
    known, model = robot(name), model_of(name)
    data, gaps = mujoco.MjData(model), []
    for width in (0.03, 0.05):
        for joint, position in zip(known.finger_joints, known.jaw.joints_at(width), strict=True):
            data.joint(joint).qpos[0] = position
        mujoco.mj_forward(model, data)
        across = data.site(known.tcp_site).xmat.reshape(3, 3)[:, 1]
        left, right = (data.geom(pad).xpos @ across for pad in known.pad_geoms)
        gaps.append(left - right)
    assert gaps[0] > 0.0  # the left finger is on the +y side of the tool
    assert gaps[1] - gaps[0] == pytest.approx(0.02, rel=0.35)  # a hinged jaw opens less near its hinge


@pytest.mark.parametrize(
    ("name", "space"), [("panda", "joint_position"), *(("so101", s.name) for s in (SO101_DEGREES, SO101_NORMALIZED))]
)
def test_a_planned_motion_is_the_same_in_a_space_of_joint_angles(name: str, space: str) -> None:
    known, ends = robot(name), []
    for declared in (EE_DELTA, action_space(space)):
        b = Bench(model_of(name), declared, known)
        b.controller.reset(b.data)
        for action in [(0.1, 0.05, -0.1, 0.0, 0.0, 0.05, 1.0)] * 5 + [(0.0,) * 6 + (0.0,)] * 8:
            b.step(b.controller.own_action(np.array(action)))
        ends.append((*b.controller.measured_pose(b.data).position, b.controller.measured_width_m(b.data)))
    assert ends[0] == pytest.approx(ends[1], abs=1e-3)
    assert ends[0][3] < known.gripper_opening_m - 0.02


def test_planned_motions_are_not_expressed_in_every_space() -> None:
    controller = ArmController(model_of("panda"), robot("panda"), action_space("ee_pose"))
    with pytest.raises(InvalidInputError, match="planned motions cannot be expressed in 'ee_pose'"):
        controller.own_action(np.zeros(7))


@pytest.mark.parametrize(("name", "space"), [("panda", "so101_degrees"), ("so101", "joint_position")])
def test_a_robot_refuses_the_joint_space_of_another(name: str, space: str) -> None:
    with pytest.raises(InvalidInputError, match=f"'{space}' is not supported by the arm controller of the") as refused:
        ArmController(model_of(name), robot(name), action_space(space))
    assert robot(name).action_spaces[0] in str(refused.value)


# Units of LeRobot


def test_degrees_and_normalized_numbers_mean_the_same_angles() -> None:
    ends = []
    for declared, numbers in (
        (SO101_DEGREES, [20.0, -10.0, 15.0, 70.0, -90.0, 50.0]),
        (SO101_NORMALIZED, [100 * 20 / 110.0, -10.0, 100 * 15 / 96.83, 100 * 70 / 95.0, -50.0, 50.0]),
    ):
        b = Bench(model_of("so101"), declared, SO101)
        b.step(np.array(numbers), 60)
        ends.append([math.degrees(b.data.joint(joint).qpos[0]) for joint in (*SO101.arm_joints, "gripper")])
    assert ends[0] == pytest.approx(ends[1], abs=0.05)
    assert ends[0][:5] == pytest.approx([20.0, -10.0, 15.0, 70.0, -90.0], abs=0.3)  # the servos sag under gravity
    assert ends[0][5] == pytest.approx(-10.0 + 0.5 * 110.0, abs=0.3)


def test_the_declarations_name_lerobots_motors_and_their_zero() -> None:
    for declared in (SO101_DEGREES, SO101_NORMALIZED):
        assert declared.components[0] == "shoulder_pan.pos"
        assert declared.components[-1] == "gripper.pos"
        assert (declared.low[-1], declared.high[-1]) == (0.0, 100.0)
        assert "new calibration: zero in the middle" in declared.convention
    assert SO101_NORMALIZED.low[:5] == (-100.0,) * 5
    # LeRobot calibrates the wrist's roll as a full turn; the other ranges are those of the model.
    ranges = [math.degrees(most) for most in SO101.joint_high]
    assert SO101_DEGREES.high[:4] == pytest.approx(ranges[:4], abs=0.01)
    assert SO101_DEGREES.high[4] == pytest.approx(180.0)


def test_a_gripper_that_presses_counts_as_closing() -> None:
    b = Bench(model_of("so101"), SO101_DEGREES, SO101)
    still = [math.degrees(q) for q in SO101.home_joints]
    commands = []
    for opening in (60.0, 10.0, 10.0, 80.0, 80.0, 80.0, 80.0, 80.0, 80.0, 80.0, 80.0, 80.0):
        applied = b.controller.apply(b.data, np.array([*still, opening]))
        commands.append(b.controller.gripper_command(applied, commands[-1] if commands else -1.0))
        mujoco.mj_step(b.model, b.data, nstep=b.controller.substeps)
    assert commands[1:3] == [1.0, 1.0]
    assert commands[4:] == [-1.0] * 8  # arrived: the last command is kept


# Model


def test_the_arm_stands_on_the_table_and_touches_nothing() -> None:
    model = model_of("so101")
    data = mujoco.MjData(model)
    Bench(model, EE_DELTA, SO101).controller.home(data)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    assert model.body_mass.sum() == pytest.approx(0.644, abs=0.001)
    colliding = [g for g in range(model.ngeom) if model.geom_group[g] == COLLISION_GROUP]
    assert all(model.geom_type[g] == mujoco.mjtGeom.mjGEOM_BOX for g in colliding)
    lowest = min(data.geom_xpos[g][2] - model.geom_rbound[g] for g in colliding if model.geom_bodyid[g] > 1)
    assert lowest > -0.02
    x, y, z = data.site(SO101.tcp_site).xpos
    assert (x, y, z) == pytest.approx((0.20, 0.0, 0.08), abs=1e-3)


def test_servos_hold_the_arm_against_gravity() -> None:
    b = Bench(model_of("so101"), EE_DELTA, SO101)
    start = np.array(b.controller.commanded_pose.position)
    assert np.abs(b.step(np.zeros(7), 40)[-1] - start).max() < 1e-3


# Inverse kinematics: a position and the pitch of the approach


def pitched(position: tuple[float, float, float], pitch_deg: float, turn: float) -> tuple[IKResult, float]:
    """Return joint angles for a position and pitch below the horizontal, and the pitch error [degree].

    The azimuth of the approach is not free: it is that of the arm's plane, which the search finds.
    """
    azimuth = math.atan2(position[1], position[0] - 0.0388)
    for _ in range(8):
        tilt = from_axis_angle((0.0, -math.radians(90.0 - pitch_deg), 0.0))
        rotation = multiply(multiply(from_yaw(azimuth), tilt), multiply(DOWN, from_yaw(turn)))
        found = arm().reach(arm().home, Pose(position, normalize(rotation)))
        dx, dy, dz = rotate(arm().forward(found.q).quaternion, (0.0, 0.0, 1.0))
        error = math.degrees(math.asin(min(1.0, max(-1.0, -dz)))) - pitch_deg
        if pitch_deg > 89.0 or abs(math.atan2(dy, dx) - azimuth) < 1e-4:
            break
        azimuth = math.atan2(dy, dx)
    return found, error


@pytest.mark.parametrize(
    ("height", "pitch", "radii"),
    [(0.03, 90.0, (0.10, 0.26)), (0.09, 75.0, (0.14, 0.26)), (0.13, 60.0, (0.16, 0.26)), (0.18, 45.0, (0.18, 0.28))],
)
def test_positions_of_the_table_are_reached_with_a_pitch(
    height: float, pitch: float, radii: tuple[float, float]
) -> None:
    for radius in np.linspace(*radii, 4):
        for azimuth in (-1.2, 0.0, 0.9):
            position = (0.0388 + radius * math.cos(azimuth), radius * math.sin(azimuth), height)
            for turn in (-0.5, 0.5):
                found, error = pitched(position, pitch, turn)
                assert found.position_error_m < 1e-3, (position, turn)
                assert abs(error) < 1.0, (position, turn)


@pytest.mark.parametrize("position", [(0.45, 0.0, 0.03), (0.02, 0.0, 0.03), (-0.25, 0.0, 0.03)])
def test_positions_out_of_reach_are_said_so(position: tuple[float, float, float]) -> None:
    assert not arm().reach(arm().home, Pose(position, DOWN)).converged


def test_an_unreachable_rotation_keeps_the_position_exact() -> None:
    found = arm().reach(arm().home, Pose((0.24, 0.05, 0.15), DOWN))
    assert found.converged
    assert found.position_error_m < 1e-4
    assert 0.1 < found.rotation_error_rad < SO101.ik.rotation_slack_rad


# Scenes, environment and expert


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space")  # degrees are not normalized
def test_gymnasiums_checker_and_seeds_hold_for_the_second_robot() -> None:
    with registered_for_now(TABLE):
        env = TaskEnv(
            "so101_table", robot="so101", action_space="so101_degrees", observation="state_only", quality="fast"
        )
        check_env(env, skip_render_check=True)
        assert env.observation_space["joint_positions"].shape == (5,)
        assert env.action_space.shape == (6,)
        env.close()


def test_scenes_of_one_seed_are_the_same_bits_and_a_snapshot_continues() -> None:
    first, second = (table(5, SO101_DEGREES) for _ in range(2))
    assert first.simulator_state()["qpos"].tobytes() == second.simulator_state()["qpos"].tobytes()
    action = np.array([10.0, -20.0, 20.0, 60.0, -90.0, 30.0])
    for _ in range(3):
        first.step(action)
    kept = first.snapshot()
    ends = []
    for _ in range(2):
        first.restore(kept)
        first.step(action)
        ends.append(first.simulator_state()["qpos"].tobytes())
    assert ends[0] == ends[1]


def test_masks_know_the_parts_of_the_gripper() -> None:
    model = table(0, SO101_DEGREES).model
    found = instances_of_bodies(model)
    for body, part in (("moving_jaw", "left_finger"), ("fixed_jaw", "right_finger"), ("gripper", "hand")):
        assert found[model.body(f"robot/{body}").id] == 1 + STAGE.index(part)
    assert found[model.body("robot/upper_arm").id] == 1 + STAGE.index("arm")


def solve(seed: int, space: str) -> tuple[bool, bool, str]:
    """Run the expert; return whether it succeeded, whether it held the lemon in the air, and its mishap."""
    scene = table(seed, action_space(space), fruit=PLACES[seed])
    state, expert, tracker = scene.state(), make_expert("expert", scene), scene.tracker()
    tracker.update(state)
    carried, success = False, False
    for _ in range(400):
        scene.step(expert.act_on_state(state))
        state = scene.state()
        carried |= state.held == "lemon"
        success = tracker.update(state).success
        if success:
            break
    return success, carried, expert.ground_truth["mishap"]


@pytest.mark.parametrize(
    ("seed", "space"), others_slow([(0, "so101_degrees"), (2, "so101_normalized"), (9, "ee_delta")], 3)
)
def test_the_expert_puts_a_lemon_into_a_box_with_its_own_motors(seed: int, space: str) -> None:
    assert solve(seed, space) == (True, True, "")


@pytest.mark.slow
def test_the_expert_solves_forty_positions() -> None:
    solved = [solve(seed, "so101_degrees") for seed in range(len(PLACES))]
    assert sum(success and carried for success, carried, _ in solved) >= 38


def test_an_object_out_of_reach_is_refused_with_a_sentence() -> None:
    scene = table(0, SO101_DEGREES, fruit=(0.52, 0.1))
    state, expert = scene.state(), make_expert("expert", scene)
    for _ in range(3):
        scene.step(expert.act_on_state(state))
        state = scene.state()
    reason = "no free grasp of lemon: lemon at (0.51, 0.11, 0.00) m is out of reach of the SO-101 follower arm"
    assert reason in expert.ground_truth["mishap"]
    assert planned_grasps(scene, scene.reset())[0] == {"lemon": reason}  # clause d of a certificate


def test_the_certificate_finds_an_object_within_reach() -> None:
    scene = table(0, SO101_DEGREES)
    assert planned_grasps(scene, scene.reset())[0] == {"lemon": None}


def test_a_planner_finds_every_contact_of_the_folded_arm_with_itself() -> None:
    """No contact between parts of the arm is missed in postures for a grasp from above near the base."""
    ik, model = arm(), model_of("so101")
    data, draw = mujoco.MjData(model), np.random.default_rng(5)
    scene = table(0, EE_DELTA)
    clearance = Clearance(scene)
    clearance.load(scene.reset())
    clearance.keeps_apart = True
    assert clearance.touches(ik.home, finger_width_m=SO101.gripper_opening_m) == ()
    (x, y, _), near = SO101.steering.center, SO101.steering.nearest_m
    apart = {f"{a}-{b}" for a, b in SO101.kept_apart}
    folded = 0
    for _ in range(200):
        radius, side, height = near + draw.uniform(0.0, 0.1), draw.uniform(-1.5, 1.5), draw.uniform(0.05, 0.12)
        turned = normalize(multiply(from_yaw(draw.uniform(-math.pi, math.pi)), DOWN))
        found = ik.reach(ik.home, Pose((x + radius * math.cos(side), y + radius * math.sin(side), height), turned))
        if not found.converged:
            continue
        data.qpos[[model.joint(joint).qposadr[0] for joint in SO101.arm_joints]] = found.q
        data.qpos[[model.joint(joint).qposadr[0] for joint in SO101.finger_joints]] = SO101.jaw.joints_at(0.05)
        mujoco.mj_forward(model, data)
        touching = bool((data.contact.dist < 0.0).any())
        folded += touching
        assert not touching or apart & set(clearance.touches(found.q, finger_width_m=0.05)), found.q
    assert folded > 2


@pytest.mark.parametrize(("condition", "seed"), others_slow([("train2", 0), ("train2", 1), ("train2", 5)], 3))
def test_layers_near_the_base_are_picked_once_and_put_on_a_stack_at_the_edge_of_the_reach(
    condition: str, seed: int
) -> None:
    """A folded arm does not lift with its camera at its first link, and a tilted tool releases a layer higher."""
    task = place_task(get_task("cheeseburger"), SO101).task
    scene = Scene(task, task.train(condition), seed=seed, action_space=EE_DELTA)
    watched = watch_expert(scene)
    assert watched.problem == ""
    assert [type(p) for p in watched.primitives] == [Pick, Put] * 3
