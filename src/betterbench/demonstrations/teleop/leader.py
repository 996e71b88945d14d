"""Teleoperation of the simulated robot with a leader arm, which is read through LeRobot's teleoperator class.

If the robot has the same joints as the leader arm, the robot's tool takes the pose that the leader's joint angles
define. The robot begins to follow when the operator has moved the leader arm near the pose of the robot. For any other
robot, the motion of the leader's tool in the leader's base frame is added to the initial pose of the robot's tool.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from betterbench.demonstrations.teleop.controls import Controls
from betterbench.demonstrations.teleop.lerobot_arms import (
    ArmKind,
    CalibrationError,
    connect_arm,
    failure,
    make_arm,
)
from betterbench.errors import BetterError, InvalidInputError, one_line
from betterbench.geometry import Pose, Vector, distance, from_axis_angle, multiply, normalize, turn_between
from betterbench.interface.actions import SO101_MOTORS
from betterbench.sim.robots import ArmIK, RobotSpec

LEADERS = ("so101_leader", "so100_leader")
"""Leader arms whose kinematics are known."""
JOINTS = SO101_MOTORS[:-1]
SCALE = 1.5
"""Motion of the robot's tool per unit of motion of the leader's tool.

The value is about the ratio of the arms' reaches.
"""
CLOSED_BELOW, OPEN_ABOVE = 30.0, 45.0
"""Thresholds of the leader's gripper position for closing and opening the robot's gripper (0 closed to 100 open)."""
MEETING_M = 0.05
"""Maximum distance between leader tool and robot tool for a robot with the leader's joints to start following [m]."""
RATE_HZ = 50.0
MOST_FAILURES = 25
"""Number of consecutive failed readings after which the leader arm is no longer followed. They take half a second."""

# Joint axes of the SO-101 with all joints at zero, in the new calibration (TheRobotStudio SO-ARM100,
# so101_new_calib.xml, Apache-2.0): a point on each axis [m] and its direction. The position of the gripper's center
# with all joints at zero follows.
_SCREWS: tuple[tuple[Vector, Vector], ...] = (
    ((0.03884, 0.0, 0.0624), (0.0, 0.0, -1.0)),
    ((0.06923, -0.01828, 0.1166), (0.0, 1.0, 0.0)),
    ((0.09723, -0.01828, 0.22917), (0.0, 1.0, 0.0)),
    ((0.23213, -0.01828, 0.23437), (0.0, 1.0, 0.0)),
    ((0.29323, -0.00018, 0.23437), (-1.0, 0.0, 0.0)),
)
_TOOL_AT_ZERO: Vector = (0.39136, -0.00001, 0.22647)


def leader_tool(degrees: Mapping[str, float]) -> Pose:
    """Return the pose of an SO-101's tool in its base frame.

    The tool frame is parallel to the base frame if all joints are at zero. Raises InvalidInputError if an angle is
    missing or not finite.

    Args:
        degrees: Joint angles by joint name [degree].
    """
    pose = Pose()
    for name, (point, axis) in zip(JOINTS, _SCREWS, strict=True):
        turn = from_axis_angle([math.radians(_angle(degrees, name)) * v for v in axis])
        pose = pose @ Pose(point) @ Pose((0.0, 0.0, 0.0), turn) @ Pose((-point[0], -point[1], -point[2]))
    return pose @ Pose(_TOOL_AT_ZERO)


class LeaderMotion(Protocol):
    """Conversion of the leader arm's joint angles to target poses for the robot's tool."""

    def tool(self, degrees: Mapping[str, float]) -> Pose:
        """Return the pose of the leader's tool in its base frame.

        Args:
            degrees: Joint angles of the leader arm by joint name [degree].
        """

    def take_hold(self, robot: Pose, leader: Pose) -> None:
        """Start following the leader arm.

        Args:
            robot: Pose of the robot's tool, ``T_base_tcp``.
            leader: Pose of the leader's tool.
        """

    def follow(self, leader: Pose, gripper: float) -> tuple[Pose | None, bool]:
        """Return the target of the robot's tool, and whether the robot's gripper should be closed.

        The target is None if the tool should not move.

        Args:
            leader: Pose of the leader's tool.
            gripper: Position of the leader's gripper, from 0 (closed) to 100 (open).
        """


class Follower:
    """Relative conversion: the robot's tool repeats the motion that the leader's tool has made since ``take_hold``."""

    def __init__(self) -> None:
        """Create the conversion. Following starts when :meth:`take_hold` is called."""
        self._leader: Pose | None = None
        self._robot = Pose()
        self._closed = False

    def tool(self, degrees: Mapping[str, float]) -> Pose:
        """Return the pose of the leader's tool in its base frame, see :func:`leader_tool`."""
        return leader_tool(degrees)

    def take_hold(self, robot: Pose, leader: Pose) -> None:
        """Start following the leader arm from the current poses of both tools.

        Args:
            robot: Pose of the robot's tool, ``T_base_tcp``.
            leader: Pose of the leader's tool.
        """
        self._robot, self._leader = robot, leader

    def follow(self, leader: Pose, gripper: float) -> tuple[Pose, bool]:
        """Return the target of the robot's tool, and whether the robot's gripper should be closed.

        Raises InvalidInputError if ``take_hold`` was not called before.

        Args:
            leader: Pose of the leader's tool.
            gripper: Position of the leader's gripper, from 0 (closed) to 100 (open).
        """
        if self._leader is None:
            raise InvalidInputError("leader arm", "it is not followed yet", "Call take_hold before follow")
        there, began = leader.position, self._leader.position
        x, y, z = (r + SCALE * (a - b) for r, a, b in zip(self._robot.position, there, began, strict=True))
        turn = turn_between(self._leader.quaternion, leader.quaternion)
        self._closed = _closed(gripper, self._closed)
        return Pose((x, y, z), normalize(multiply(turn, self._robot.quaternion))), self._closed


class Mirror:
    """Absolute conversion for a robot with the leader's joints: both tools have the same pose.

    The robot does not move until the leader's tool has come within :data:`MEETING_M` of the robot's tool. The robot
    therefore does not jump at the beginning, and does not return to the undone pose after an undo.
    """

    def __init__(self, spec: RobotSpec) -> None:
        """Create the conversion. After :meth:`take_hold`, the robot waits until the leader arm comes near."""
        self._names, self._ik = spec.arm_joints, ArmIK(spec)
        self._robot = Pose()
        self._has_met, self._closed = False, False

    def tool(self, degrees: Mapping[str, float]) -> Pose:
        """Return the pose that the robot's tool would have at the leader's joint angles.

        Raises InvalidInputError if an angle is missing or not finite.
        """
        return self._ik.forward(np.array([math.radians(_angle(degrees, name)) for name in self._names]))

    def take_hold(self, robot: Pose, leader: Pose) -> None:
        """Wait until the leader's tool is near the robot's tool, and follow it from then on."""
        self._robot = robot
        self._has_met = distance(robot.position, leader.position) < MEETING_M

    def follow(self, leader: Pose, gripper: float) -> tuple[Pose | None, bool]:
        """Return the target of the robot's tool, and whether the robot's gripper should be closed.

        The target is the pose of the leader's tool. Until the leader's tool has been near the robot's tool, the target
        is None and the gripper keeps its state.
        """
        if not self._has_met and distance(self._robot.position, leader.position) < MEETING_M:
            self._has_met = True
        if not self._has_met:
            return None, self._closed
        self._closed = _closed(gripper, self._closed)
        return leader, self._closed


def motion_for(spec: RobotSpec) -> LeaderMotion:
    """Return the conversion for a robot: absolute if it has the leader's joints, and relative for any other robot."""
    return Mirror(spec) if spec.arm_joints == JOINTS else Follower()


def _closed(gripper: float, before: bool) -> bool:
    """Return whether the robot's gripper should be closed.

    Args:
        gripper: Position of the leader's gripper, from 0 (closed) to 100 (open).
        before: Whether the robot's gripper was closed before.
    """
    return gripper < CLOSED_BELOW if gripper < CLOSED_BELOW or gripper > OPEN_ABOVE else before


def _angle(degrees: Mapping[str, float], name: str) -> float:
    """Return the angle of a joint [degree]. Raise InvalidInputError if it is missing or not finite."""
    angle = degrees.get(name, math.nan)
    if not math.isfinite(angle):
        raise InvalidInputError(
            "leader arm", f"the angle of {name} is {angle}", "Check the cables and the calibration of the arm"
        )
    return angle


def connect_leader(kind: str, port: str, name: str) -> Any:  # noqa: ANN401 - lerobot's Teleoperator
    """Connect to a leader arm, and return lerobot's teleoperator object.

    Args:
        kind: Kind of leader arm, one of :data:`LEADERS`.
        port: Serial port of the arm.
        name: Id under which lerobot stores the calibration of the arm.

    Raises:
        MissingDependencyError: If lerobot, or a package that it needs for these motors, is not installed.
        InvalidInputError: If the kind of arm is unknown, or the arm cannot be reached or is not calibrated.
    """
    if kind not in LEADERS:
        raise InvalidInputError("--leader", f"{kind!r} is not supported", f"Use one of {', '.join(LEADERS)}")
    if not port:
        raise InvalidInputError("--leader", "the serial port is missing", "Pass --leader-port, such as /dev/ttyACM0")
    leader = ArmKind("teleoperators", kind, "so_leader")
    options = {"port": port, "id": name, "use_degrees": True}
    made = make_arm(leader, options, what="--leader needs lerobot with its Feetech motors")
    try:
        connect_arm(made, leader, port)
    except CalibrationError:
        raise
    except Exception as problem:
        cure = "Check that the arm is plugged in and powered, and that --leader-port is its port (lerobot-find-port)"
        raise InvalidInputError("--leader-port", f"{port}: {failure(problem, port)}", cure) from problem
    return made


class LeaderThread:
    """Thread that passes the poses of a leader arm to the controls, until it is closed or the arm is disconnected."""

    def __init__(self, leader: Any, controls: Controls, motion: LeaderMotion) -> None:  # noqa: ANN401 - lerobot's
        """Start a thread that reads the leader arm.

        Args:
            leader: Connected lerobot teleoperator.
            controls: Controls to which the target poses are sent.
            motion: Conversion of the joint angles to target poses for the robot's tool.
        """
        self._leader, self._controls, self._motion = leader, controls, motion
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="teleop leader", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop reading, and disconnect the leader arm."""
        self._is_over.set()
        self._thread.join(timeout=0.3)
        try:
            self._leader.disconnect()
        except Exception as problem:  # noqa: BLE001 - lerobot may raise any error, and there is nothing left to save
            self._controls.complain(f"leader arm: {problem}")

    def _run(self) -> None:
        motion = self._motion
        held: int | None = None
        is_apart = False
        failures = 0
        while not self._is_over.wait(1.0 / RATE_HZ):
            try:
                tool, gripper = self._read()
            except BetterError as problem:
                self._controls.complain(f"{problem} The arm does not move.")
                continue
            except Exception as problem:  # noqa: BLE001 - lerobot's motor bus may raise any error
                failures += 1
                if failures >= MOST_FAILURES:
                    self._controls.complain(f"leader arm: {one_line(problem)}. It is no longer followed.")
                    return
                continue
            failures = 0
            grip, robot = self._controls.grip()
            if robot is None:
                continue
            if held != grip:
                held = grip
                motion.take_hold(robot, tool)
                is_apart = False
            pose, closed = motion.follow(tool, gripper)
            if pose is not None:
                self._controls.led(pose, closed=closed)
            elif not is_apart:
                is_apart = True
                away = 100.0 * distance(tool.position, robot.position)
                self._controls.complain(
                    f"leader arm: it is {away:.0f} cm from the robot's tool. Bring it within {100.0 * MEETING_M:.0f} "
                    f"cm to make the robot follow"
                )

    def _read(self) -> tuple[Pose, float]:
        """Return the pose of the leader's tool in its base frame, and the gripper position (0 closed to 100 open)."""
        read = {name.removesuffix(".pos"): float(v) for name, v in self._leader.get_action().items()}
        gripper = read.get("gripper", math.nan)
        if not math.isfinite(gripper):
            raise InvalidInputError(
                "leader arm", f"the position of the gripper is {gripper}", "Check the cables of the arm"
            )
        return self._motion.tool(read), gripper
