"""Arm controller: converts an action to the references of all servos.

In every action space, the result is a joint reference that the position servos integrate evenly over the control step
(see :mod:`betterbench.sim.robots.panda`). In Cartesian action spaces, the controller keeps a **commanded pose**, which
an action of zero leaves unchanged. The commanded pose may be ahead of the measured pose by at most
:data:`POSITION_LEAD_M` and :data:`ROTATION_LEAD_RAD`. This limit prevents windup when the arm is blocked.

The few values that the controller remembers between actions can be saved and restored (:meth:`ArmController.state`), so
an episode can be continued from any recorded state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import mujoco
import numpy as np

from betterbench.errors import InvalidActionError, InvalidInputError
from betterbench.geometry import (
    IDENTITY_QUATERNION,
    Pose,
    Quaternion,
    Vector,
    angle_between,
    distance,
    from_axis_angle,
    multiply,
    normalize,
    to_axis_angle,
    turn_between,
    unit_quaternion,
)
from betterbench.interface.actions import (
    EE_DELTA,
    EE_DELTA_MEASURED,
    EE_POSE,
    JOINT_DELTA,
    JOINT_POSITION,
    JOINT_STEP_PER_UNIT_RAD,
    OPENING_SPACES,
    ROTATION_PER_UNIT_RAD,
    TRANSLATION_PER_UNIT_M,
    ActionSpace,
)
from betterbench.interface.actions import action_space as known_space
from betterbench.sim.robots.dynamics import Dynamics, backlash_of
from betterbench.sim.robots.ik import ArmIK
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.robots.readers import number_reader, numbers_of
from betterbench.sim.robots.spec import RobotSpec

POSITION_LEAD_M = 0.05
"""Maximum distance between the commanded and the measured position [m]. It is one action unit (design, section 4)."""

ROTATION_LEAD_RAD = 0.5
"""Maximum angle between the commanded and the measured rotation [rad].

It is one action unit, like the position lead.
"""

POSE_STEP_M = 0.025
"""Largest step toward an absolute pose [m]. It gives 0.5 m/s, which the joints can follow on straight paths."""

POSE_STEP_RAD = 0.1
"""Largest rotation per step toward an absolute pose [rad].

It gives 2 rad/s, below the velocity limit of every joint.
"""

JOINT_LEAD_RAD = 0.3
"""Largest difference between the reference of a joint and its measured angle [rad].

It equals the largest joint motion for 5 cm and 0.5 rad at the tool. The bound is therefore active only if the arm is
blocked or far from its reference.
"""


CLOSING_LEAD_M = 0.0015
"""Smallest difference between commanded and measured opening width that counts as a command to open or close [m]."""

NO_DYNAMICS: Dynamics = MappingProxyType({})

Joints = Sequence[float]
"""Joint angles [rad]."""


@dataclass(frozen=True, slots=True)
class ControllerState:
    """Values that a controller keeps between actions: commanded ``T_base_tcp``, joints [rad] and opening width [m]."""

    pose: Pose
    joints: tuple[float, ...]
    width_m: float


class ArmController:
    """Controller that converts the actions of one action space to servo references, once per control step.

    The robot's base must be at the world origin. ``prefix`` is the prefix of the robot's names in the scene. If
    ``dynamics`` contain a backlash, the servos may hold each joint at up to half of the play from its reference (see
    :mod:`betterbench.sim.robots.dynamics`).

    Raises InvalidInputError if the controller does not support the action space, if the model lacks a part of the
    robot, or if the time step does not divide the control period.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        spec: RobotSpec,
        action_space: ActionSpace = EE_DELTA,
        *,
        prefix: str = "",
        dynamics: Dynamics = NO_DYNAMICS,
    ) -> None:
        """Look up the addresses of all joints and servos in the model."""
        self.spec = spec
        self.action_space = action_space
        self.ik = ArmIK(spec)
        if action_space.name not in spec.action_spaces or action_space.dim != known_space(action_space.name).dim:
            raise InvalidInputError(
                "action space",
                f"{action_space.name!r} is not supported by the arm controller of the {spec.title}",
                f"Choose one of {', '.join(spec.action_spaces)}",
            )
        self._jaw = spec.jaw
        self._play, self._gripper_play = backlash_of(spec, dynamics)
        self._advance = _DRIVEN.get(action_space.name, ArmController._scaled_joint_position)
        self._scale = action_space.scale
        self._sets_width = action_space.name in OPENING_SPACES
        substeps = spec.control_period_s / model.opt.timestep
        if abs(substeps - round(substeps)) > 1e-6:
            raise InvalidInputError(
                "time step",
                f"{model.opt.timestep} s does not divide the control period of {spec.control_period_s} s",
                f"Use a time step of {PHYSICS.timestep_s} s",
            )
        self.substeps = round(substeps)
        self._period = self.substeps * float(model.opt.timestep)
        try:
            joints = [model.joint(prefix + name) for name in spec.arm_joints]
            fingers = [model.joint(prefix + name) for name in spec.finger_joints]
            position = [model.actuator(prefix + name) for name in spec.position_actuators]
            velocity = [model.actuator(prefix + name) for name in spec.velocity_actuators]
            gripper = model.actuator(prefix + spec.gripper_actuator)
        except KeyError as error:
            raise InvalidInputError(
                f"robot {spec.name!r} in the model",
                str(error.args[0]).splitlines()[0],
                f"Attach the robot with the prefix {prefix!r}, or pass the prefix with which it was attached",
            ) from None
        self._qpos = [int(j.qposadr[0]) for j in joints]
        self._qvel = [int(j.dofadr[0]) for j in joints]
        self._fingers = [int(j.qposadr[0]) for j in fingers]
        self._servos = tuple((int(p.id), int(v.id)) for p, v in zip(position, velocity, strict=True))
        self._act = [int(model.actuator_actadr[a.id]) for a in position]
        self._gripper = int(gripper.id)
        self._check_base(model, prefix)
        self._pose = self.ik.forward(self.ik.home)
        self._joints: Joints = self.ik.home.tolist()
        self._width = spec.gripper_opening_m
        self._measured: Pose | None = None
        self._data: mujoco.MjData | None = None

    @property
    def commanded_pose(self) -> Pose:
        """Pose ``T_base_tcp`` that the controller is currently moving the arm to."""
        return self._pose

    @property
    def commanded_width_m(self) -> float:
        """Commanded opening width [m]. The measured width may differ from it."""
        return self._width

    def measured_pose(self, data: mujoco.MjData) -> Pose:
        """Return the pose ``T_base_tcp`` at the measured joint angles."""
        return self.ik.forward(data.qpos[self._qpos])

    def measured_width_m(self, data: mujoco.MjData) -> float:
        """Return the measured distance between the finger pads [m]."""
        self._attend(data)
        return self._jaw.width_at(self._get_fingers())

    def home(self, data: mujoco.MjData) -> None:
        """Set the arm to its home posture at rest, with open fingers, and reset the controller.

        Call ``mj_forward`` before reading any derived quantity.
        """
        data.qpos[self._qpos] = self.ik.home
        data.qvel[self._qvel] = 0.0
        data.qpos[self._fingers] = self._jaw.joints_at(self.spec.gripper_opening_m)
        self.reset(data)

    def reset(self, data: mujoco.MjData) -> None:
        """Use the current joint angles and opening width as the command, so that the arm holds still."""
        joints = data.qpos[self._qpos]
        self._joints = joints.tolist()
        self._pose = self.ik.forward(joints)
        self._width = self.measured_width_m(data)
        data.act[self._act] = joints
        data.ctrl[[number for pair in self._servos for number in pair]] = 0.0
        data.ctrl[self._gripper] = self._jaw.control_at(self._width)

    def apply(self, data: mujoco.MjData, action: object, *, measured: Pose | None = None) -> np.ndarray:
        """Write the controls of the next control step to ``data``, and return the action that was applied.

        ``measured`` is the pose ``T_base_tcp`` at the current joint angles, if the caller knows it. The returned action
        is a float64 array (dim,) within the bounds of the action space. Applying the returned action instead of the
        given one has a bit-identical effect.

        Raises:
            InvalidActionError: If the action has a wrong shape or type, or contains a non-finite number.
        """
        applied = self.action_space.clip(action)
        numbers = applied.tolist()
        self._measured = measured
        self._attend(data)
        held = self._get_reference()
        goal = self._advance(self, numbers, self._get_joints(), self._joints if self._play else held)
        ctrl, period = self._ctrl, self._period
        through = _through_play(goal, held, self._play) if self._play else goal
        for (position, velocity), to, at in zip(self._servos, through, held, strict=True):
            ctrl[position] = ctrl[velocity] = (to - at) / period
        self._joints = goal
        move = self._set_gripper if self._sets_width else self._move_gripper
        self._width = move(numbers[-1], self.measured_width_m(data))
        opened = self._jaw.control_at(self._width)
        if self._gripper_play:
            (opened,) = _through_play((opened,), (ctrl[self._gripper],), (self._gripper_play,))
        ctrl[self._gripper] = opened
        return applied

    def gripper_command(self, applied: np.ndarray, last: float) -> float:
        """Return the gripper command of an applied action: -1 to open, 1 to close.

        Some action spaces set the opening width directly. The command is then inferred from the commanded and measured
        widths. The gripper closes while the commanded width is smaller than the measured width by at least
        :data:`CLOSING_LEAD_M`. This includes the time during which it presses on an object. It opens while the
        commanded width is larger by at least the same amount. Otherwise, the ``last`` command is kept.
        """
        if not self._sets_width:
            command: float = applied.item(-1)
            return command
        lead = self._jaw.width_at(self._get_fingers()) - self._width
        return last if abs(lead) < CLOSING_LEAD_M else math.copysign(1.0, lead)

    def own_action(self, action: np.ndarray) -> np.ndarray:
        """Convert an ``ee_delta`` action to the equivalent action of this controller's action space.

        Planned motions are sequences of ``ee_delta`` actions. This method expresses them in the action space of a
        policy, starting from the state in which the controller was reset or last applied an action. It supports
        ``ee_delta`` itself and action spaces of absolute joint angles.

        Args:
            action: Action in ``ee_delta``, (7,).

        Raises:
            InvalidInputError: If the controller's action space is not supported.
        """
        if self.action_space.name == EE_DELTA.name:
            return action
        if self._advance not in (ArmController._joint_position, ArmController._scaled_joint_position):
            raise InvalidInputError(
                "action space",
                f"planned motions cannot be expressed in {self.action_space.name!r}",
                "Use ee_delta or an action space of absolute joint angles",
            )
        numbers = action.tolist()
        measured = self._get_joints()
        goal = _bounded(_moved(self._pose, numbers), self.ik.forward(measured))
        joints = self._toward(goal, measured, self._joints if self._play else self._get_reference())
        gripper = numbers[-1]
        if self._sets_width:
            width = self._move_gripper(gripper, self._jaw.width_at(self._get_fingers()))
            gripper = self._jaw.share_at(width) / self._scale[-1]
        return np.array([*(q / unit for q, unit in zip(joints, self._scale, strict=False)), gripper])

    def _attend(self, data: mujoco.MjData) -> None:
        """Prepare fast access to the engine's data. The data must stay at the same memory address."""
        if data is self._data:
            return
        self._data, self._ctrl = data, numbers_of(data.ctrl)
        self._get_joints, self._get_fingers = (number_reader(data.qpos, a) for a in (self._qpos, self._fingers))
        self._get_reference = number_reader(data.act, self._act)

    def state(self) -> ControllerState:
        """Return the values that the controller remembers between actions."""
        return ControllerState(self._pose, tuple(self._joints), self._width)

    def restore(self, state: ControllerState) -> None:
        """Restore the given state of the controller. Raises InvalidInputError if it belongs to a different robot."""
        if len(state.joints) != self.ik.home.size:
            raise InvalidInputError(
                "controller state", f"has {len(state.joints)} joints", f"Restore a state of a {self.spec.title}"
            )
        self._pose = state.pose
        self._joints = state.joints
        self._width = state.width_m

    def _ee_delta(self, action: list[float], measured: Joints, reference: Joints) -> list[float]:
        """Add the action to the commanded pose, limit how far this pose leads the arm, and step toward the result."""
        asked = _moved(self._pose, action)
        self._pose = _bounded(asked, self._measured or self.ik.forward(measured))
        return self._toward(self._pose, measured, reference)

    def _ee_delta_measured(
        self, action: list[float], measured: Sequence[float], reference: Sequence[float]
    ) -> list[float]:
        """Add the action to the measured pose, and step toward the result."""
        self._pose = _moved(self._measured or self.ik.forward(measured), action)
        return self._toward(self._pose, measured, reference)

    def _ee_pose(self, action: list[float], measured: Joints, reference: Joints) -> list[float]:
        """Step toward an absolute pose along a straight line at moderate speed."""
        x, y, z, qw, qx, qy, qz = action[:7]
        if qw * qw + qx * qx + qy * qy + qz * qz < 1e-6:
            raise InvalidActionError("ee_pose action: the quaternion is zero. Send a unit quaternion (w, x, y, z).")
        self._pose = Pose((x, y, z), normalize((qw, qx, qy, qz)))
        present = self.ik.forward(reference)
        waypoint = _bounded(self._pose, present, distance_m=POSE_STEP_M, angle_rad=POSE_STEP_RAD)
        return self._toward(_bounded(waypoint, self._measured or self.ik.forward(measured)), measured, reference)

    def _joint_position(
        self, action: list[float], measured: Sequence[float], reference: Sequence[float]
    ) -> list[float]:
        """Step toward absolute joint angles [rad]."""
        return self._joint_step(action[:-1], measured, reference)

    def _scaled_joint_position(self, action: list[float], measured: Joints, reference: Joints) -> list[float]:
        """Step toward absolute joint angles, given in the units of the action space."""
        goal = [unit * a for unit, a in zip(self._scale[:-1], action[:-1], strict=True)]
        return self._joint_step(goal, measured, reference)

    def _joint_delta(self, action: list[float], measured: Joints, reference: Joints) -> list[float]:
        """Add the action to the commanded joint angles, and step toward the result."""
        asked = [q + JOINT_STEP_PER_UNIT_RAD * a for q, a in zip(self._joints, action[:-1], strict=True)]
        return self._joint_step(asked, measured, reference)

    def _joint_step(self, goal: Joints, measured: Joints, reference: Joints) -> list[float]:
        """Return the next joint reference toward the goal, within the limits of position, speed and lead."""
        low, high = self.ik.window(reference, reference)
        near = [min(max(g, m - JOINT_LEAD_RAD), m + JOINT_LEAD_RAD) for g, m in zip(goal, measured, strict=True)]
        step = [min(max(g, least), most) for g, least, most in zip(near, low, high, strict=True)]
        self._pose = self.ik.forward(step)
        return step

    def _toward(self, target: Pose, measured: Joints, reference: Joints) -> list[float]:
        """Return the next joint reference toward a pose."""
        return self.ik.step(reference, target, around=measured, lead_rad=JOINT_LEAD_RAD)

    def _move_gripper(self, command: float, measured_width: float) -> float:
        """Return the commanded opening width [m] after one control step with the given gripper command."""
        if command == 0.0:
            return self._width
        spec = self.spec
        step = spec.gripper_speed_m_s * self._period
        width = self._width - math.copysign(step, command)
        width = min(max(width, measured_width - spec.gripper_lead_m), measured_width + spec.gripper_lead_m)
        return min(max(width, -spec.gripper_lead_m), spec.gripper_opening_m)

    def _set_gripper(self, command: float, _measured_width: float) -> float:
        """Return the opening width [m] for a command that is a fraction of the jaw's range."""
        return self._jaw.width_at_share(self._scale[-1] * command)

    def _check_base(self, model: mujoco.MjModel, prefix: str) -> None:
        """Check that the robot's base is at the world origin without rotation, as its kinematics require."""
        body = model.body(prefix + self.spec.arm_bodies[0]).id
        base = Pose()
        while body:
            x, y, z = model.body_pos[body].tolist()
            base = Pose((x, y, z), normalize(model.body_quat[body].tolist())) @ base
            body = int(model.body_parentid[body])
        if (
            distance(base.position, (0.0, 0.0, 0.0)) > 1e-9
            or angle_between(base.quaternion, IDENTITY_QUATERNION) > 1e-9
        ):
            raise InvalidInputError(
                f"base of the robot {self.spec.name!r}",
                f"expected the base at the world origin without rotation, but it is at {list(base.position)}",
                "Attach the robot at the world origin, because all poses are given in the base frame",
            )


# These are functions of the class instead of bound methods. Bound methods would create a reference cycle, which would
# keep the controller with its inverse kinematics models in memory until a garbage collection.
_Advance = Callable[[ArmController, list[float], Joints, Joints], list[float]]
_DRIVEN: dict[str, _Advance] = {
    EE_DELTA.name: ArmController._ee_delta,
    EE_DELTA_MEASURED.name: ArmController._ee_delta_measured,
    EE_POSE.name: ArmController._ee_pose,
    JOINT_POSITION.name: ArmController._joint_position,
    JOINT_DELTA.name: ArmController._joint_delta,
}


def _through_play(goal: Joints, held: Joints, play: Sequence[float]) -> list[float]:
    """Apply the backlash: return the positions at which the servos hold the joints after the references have moved.

    Args:
        goal: New references [rad].
        held: Previous positions at which the servos held the joints [rad].
        play: Half of the play of each joint [rad].
    """
    return [min(max(h, g - p), g + p) for g, h, p in zip(goal, held, play, strict=True)]


_COS_HALF_LEAD = math.cos(0.5 * ROTATION_LEAD_RAD)


def _moved(pose: Pose, action: list[float]) -> Pose:
    """Return a pose after a Cartesian delta action in the base frame."""
    x, y, z = pose.position
    s = TRANSLATION_PER_UNIT_M
    position: Vector = (x + s * action[0], y + s * action[1], z + s * action[2])
    quaternion: Quaternion = pose.quaternion
    rx, ry, rz = action[3], action[4], action[5]
    if rx != 0.0 or ry != 0.0 or rz != 0.0:
        a = ROTATION_PER_UNIT_RAD
        quaternion = unit_quaternion(multiply(from_axis_angle((a * rx, a * ry, a * rz)), quaternion))
    return Pose(position, quaternion)


def _bounded(
    pose: Pose, center: Pose, *, distance_m: float = POSITION_LEAD_M, angle_rad: float = ROTATION_LEAD_RAD
) -> Pose:
    """Return the pose, moved toward ``center`` if it is farther from ``center`` than the bounds allow."""
    position, quaternion = pose.position, pose.quaternion
    cx, cy, cz = center.position
    dx, dy, dz = position[0] - cx, position[1] - cy, position[2] - cz
    lead = math.sqrt(dx * dx + dy * dy + dz * dz)
    if lead > distance_m:
        f = distance_m / lead
        position = (cx + f * dx, cy + f * dy, cz + f * dz)
        pose = Pose(position, quaternion)
    w, x, y, z = quaternion
    cw, cx, cy, cz = center.quaternion
    # The dot product of two unit quaternions is, up to its sign, the cosine of half the angle between them.
    if abs(w * cw + x * cx + y * cy + z * cz) < (
        _COS_HALF_LEAD if angle_rad == ROTATION_LEAD_RAD else math.cos(0.5 * angle_rad)
    ):
        rx, ry, rz = to_axis_angle(turn_between(center.quaternion, quaternion))
        f = angle_rad / math.sqrt(rx * rx + ry * ry + rz * rz)
        quaternion = unit_quaternion(multiply(from_axis_angle((f * rx, f * ry, f * rz)), center.quaternion))
        pose = Pose(position, quaternion)
    return pose
