from __future__ import annotations

import itertools
import math
import subprocess
import sys

import numpy as np
import pytest

from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose, angle_between, distance, from_axis_angle, from_yaw, multiply, normalize
from betterbench.sim.robots import PANDA, ArmIK
from betterbench.sim.robots.ik import LIMIT_MARGIN_RAD

DOWN = (0.0, 1.0, 0.0, 0.0)


def test_forward_kinematics_at_home(ik: ArmIK) -> None:
    pose = ik.forward(ik.home)
    assert pose.position == pytest.approx((0.3600, 0.0, 0.2800), abs=5e-5)
    assert angle_between(pose.quaternion, DOWN) == pytest.approx(0.0, abs=1e-6)


def test_every_pose_of_the_workspace_is_reached(ik: ArmIK) -> None:
    worst_position = worst_rotation = 0.0
    for x, y, z, yaw in itertools.product(
        (0.3, 0.5, 0.7), (-0.35, 0.0, 0.35), (0.02, 0.2, 0.4), np.radians((-90.0, -45.0, 0.0, 45.0, 90.0))
    ):
        target = Pose((x, y, z), normalize(multiply(from_yaw(float(yaw)), DOWN)))
        found = ik.reach(ik.home, target)
        # Upper arm and forearm together span 0.719 m, which ends short of the two farthest, highest corners.
        if math.hypot(math.hypot(x, y) - 0.088, z + 0.1034 + 0.107 - 0.333) > 0.719:
            assert (x, abs(y), z) == (0.7, 0.35, 0.4)
            assert not found.converged
            continue
        assert found.converged, (x, y, z, yaw)
        assert (found.q >= ik.low).all()
        assert (found.q <= ik.high).all()
        reached = ik.forward(found.q)
        worst_position = max(worst_position, distance(reached.position, target.position))
        worst_rotation = max(worst_rotation, angle_between(reached.quaternion, target.quaternion))
    assert worst_position < 5e-4
    assert worst_rotation < 5e-3


def test_a_way_is_followed_within_its_tolerances_and_limits(ik: ArmIK) -> None:
    """Along a way it stays where it said it is, in the posture that a search from the configuration before finds."""
    joints, searched = ik.home, ik.home
    for i in range(1, 31):
        target = Pose((0.36 + 0.01 * i, 0.012 * i, 0.28), normalize(multiply(from_yaw(0.04 * i), DOWN)))
        followed = ik.follow(joints, target, position_tolerance_m=1e-3, rotation_tolerance_rad=1e-2)
        assert followed is not None, i
        found = np.array(followed)
        reached = ik.forward(found)
        assert distance(reached.position, target.position) <= 1e-3
        assert angle_between(reached.quaternion, target.quaternion) <= 1e-2
        assert (found >= ik.low).all()
        assert (found <= ik.high).all()
        searched = ik.reach(searched, target, restarts=False).q
        assert np.abs(found - searched).max() < 0.05
        joints = found


def test_a_way_that_leaves_the_reach_cannot_be_followed(ik: ArmIK) -> None:
    target = Pose((1.2, 0.0, 0.3), DOWN)
    assert ik.follow(ik.home, target, position_tolerance_m=1e-3, rotation_tolerance_rad=1e-2) is None


@pytest.mark.parametrize("turn", [0.2, -0.2])
def test_beside_a_joint_limit_a_way_is_followed_inside_it(ik: ArmIK, turn: float) -> None:
    twisted = ik.home.copy()
    twisted[-1] = ik.high[-1] - 0.01
    here = ik.forward(twisted)
    target = Pose(here.position, normalize(multiply(here.quaternion, from_yaw(turn))))
    found = ik.follow(twisted, target, position_tolerance_m=1e-3, rotation_tolerance_rad=1e-2)
    assert found is not None
    assert ((found >= ik.low) & (found <= ik.high)).all()
    assert angle_between(ik.forward(found).quaternion, target.quaternion) <= 1e-2


@pytest.mark.parametrize("beyond", [0.01, 0.3, 2.0 * math.pi])
def test_a_way_that_begins_outside_the_limits_is_followed_inside_or_not_at_all(ik: ArmIK, beyond: float) -> None:
    """Also where the pose outside is what is asked for: it is out of reach."""
    for joint in range(7):
        outside = ik.home.copy()
        outside[joint] = ik.high[joint] + beyond
        found = ik.follow(outside, ik.forward(outside), position_tolerance_m=1e-3, rotation_tolerance_rad=1e-2)
        if found is not None:
            assert ((found >= ik.low) & (found <= ik.high)).all(), joint
            assert distance(ik.forward(found).position, ik.forward(outside).position) <= 1e-3


def test_what_cannot_be_reached_is_said_so(ik: ArmIK) -> None:
    found = ik.reach(ik.home, Pose((1.5, 0.0, 0.3), DOWN))
    assert not found.converged
    assert found.position_error_m > 0.3


def test_reach_says_the_error_that_remains(ik: ArmIK) -> None:
    target = Pose((0.5, 0.1, 0.2), DOWN)
    found = ik.reach(ik.home, target, restarts=False, iterations=2)
    reached = ik.forward(found.q)
    assert found.position_error_m == pytest.approx(distance(reached.position, target.position))
    assert found.iterations == 2


def test_a_start_that_is_no_joint_vector_is_refused(ik: ArmIK) -> None:
    for bad in (np.zeros(6), np.full(7, np.nan)):
        with pytest.raises(InvalidInputError, match="7 finite angles"):
            ik.reach(bad, Pose((0.5, 0.0, 0.3), DOWN))


def test_one_step_keeps_to_velocity_and_joint_limits(ik: ArmIK) -> None:
    random = np.random.default_rng(0)
    speed = np.array(PANDA.joint_velocity) * PANDA.control_period_s
    for _ in range(200):
        q = random.uniform(ik.low, ik.high)
        target = Pose(
            tuple(random.uniform((-0.6, -0.6, 0.0), (0.8, 0.6, 1.0)).tolist()),
            from_axis_angle(random.uniform(-2.0, 2.0, 3).tolist()),
        )
        moved = ik.solve(q, target)
        assert np.isfinite(moved).all()
        assert (np.abs(moved - q) <= speed + 1e-12).all()
        assert (moved >= ik.low).all()
        assert (moved <= ik.high).all()


def test_from_outside_the_limits_it_returns_at_limited_speed(ik: ArmIK) -> None:
    q = ik.home.copy()
    q[3] = PANDA.joint_high[3] + 0.5
    moved = ik.solve(q, ik.forward(ik.home))
    assert moved[3] == pytest.approx(q[3] - PANDA.joint_velocity[3] * PANDA.control_period_s)


def test_a_joint_slows_down_before_its_limit(ik: ArmIK) -> None:
    q = ik.home.copy()
    steps = []
    for _ in range(40):
        moved = np.array(ik.window(q.tolist(), q.tolist())[1])
        steps.append(float(moved[1] - q[1]))
        q = moved
    assert steps[0] == pytest.approx(PANDA.joint_velocity[1] * PANDA.control_period_s)
    assert (np.diff(steps) <= 1e-12).all()
    assert q == pytest.approx(np.array(PANDA.joint_high) - LIMIT_MARGIN_RAD, abs=1e-3)


def test_a_step_within_the_velocity_limits_arrives(ik: ArmIK) -> None:
    for direction in np.vstack([np.eye(3), -np.eye(3)]):
        offset = 0.025 * direction
        target = ik.forward(ik.home).translated(*offset.tolist())
        reached = ik.forward(ik.solve(ik.home, target))
        assert distance(reached.position, target.position) < 2e-4
        assert angle_between(reached.quaternion, target.quaternion) < 5e-3


def test_a_reached_pose_is_kept_and_the_elbow_returns(ik: ArmIK) -> None:
    target = ik.forward(ik.home)
    q = ik.home + np.array([0.3, 0.0, -0.3, 0.0, 0.2, 0.0, 0.1])
    q = ik.reach(q, target, restarts=False).q
    for _ in range(300):
        q = ik.solve(q, target)
    assert distance(ik.forward(q).position, target.position) < 1e-4
    assert np.abs(q - ik.home).max() < 1e-2


def test_posture_does_not_depend_on_the_way(ik: ArmIK) -> None:
    """A closed path of the tool closes in joint space: the redundancy does not drift."""
    start = ik.forward(ik.home)
    q = ik.home.copy()
    for turn in range(3 * 80):
        angle = 2.0 * math.pi * turn / 80.0
        q = ik.solve(q, start.translated(0.1 * math.sin(angle), 0.1 * (1.0 - math.cos(angle)), -0.1 * math.sin(angle)))
    for _ in range(150):
        q = ik.solve(q, start)
    assert np.abs(q - ik.home).max() < 5e-3


def test_the_result_depends_on_the_arguments_only(ik: ArmIK) -> None:
    target = ik.forward(ik.home).translated(0.02, -0.03, 0.01)
    first = ik.solve(ik.home, target).tobytes()
    ik.reach(ik.home, Pose((0.6, 0.2, 0.1), DOWN))
    ik.forward(ik.low)
    assert ik.solve(ik.home, target).tobytes() == first
    assert ArmIK(PANDA).solve(ik.home, target).tobytes() == first


def test_the_control_step_takes_the_same_error_and_jacobian_as_mink():
    ik = ArmIK(PANDA)
    draw = np.random.default_rng(5)
    for _ in range(20):
        q = ik.home + draw.uniform(-0.4, 0.4, 7)
        here = ik.forward(q)
        target = Pose(
            tuple(p + d for p, d in zip(here.position, draw.uniform(-0.02, 0.02, 3), strict=True)),
            normalize(multiply(from_axis_angle(draw.uniform(-0.05, 0.05, 3)), here.quaternion)),
        )
        ik._frame.aim(target)
        _, theirs_jacobian, theirs_error = ik._linearise(q, 0.0)
        ik._place(q)
        error, jacobian = np.array(ik._world_error(target)), ik._world_jacobian().copy()
        # mink speaks in the frame of the tool and with the opposite sign of the Jacobian; least squares do not mind.
        ours = np.linalg.lstsq(jacobian, error, rcond=None)[0]
        theirs = np.linalg.lstsq(theirs_jacobian, theirs_error, rcond=None)[0]
        assert min(np.abs(ours - theirs).max(), np.abs(ours + theirs).max()) < 5e-3


def test_a_search_loads_no_scipy_and_minks_own_solver_still_finds_it() -> None:
    code = """
import sys
from betterbench.geometry import Pose
from betterbench.sim.robots import PANDA, ArmIK
ik = ArmIK(PANDA)
assert ik.reach(ik.home, ik.forward(ik.home)).converged
print(*{"qpsolvers", "scipy"} & set(sys.modules), "none")
import mink
configuration = mink.Configuration(ik._model)
task = mink.FrameTask(PANDA.tcp_site, "site", position_cost=1.0, orientation_cost=1.0)
task.set_target_from_configuration(configuration)
print(mink.solve_ik(configuration, [task], 0.1, "daqp").shape, mink.build_ik(configuration, [task], 0.1).P.shape)
import qpsolvers
print(qpsolvers.Problem.__module__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.splitlines() == ["none", "(7,) (7, 7)", "qpsolvers.problem"], done.stderr
