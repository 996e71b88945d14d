"""Descriptions of robots, as one frozen value per robot, and the registry of robots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import mujoco

from betterbench.errors import InvalidInputError, PolicyError, UnknownNameError
from betterbench.geometry import Vector
from betterbench.interface import Observation
from betterbench.interface.actions import USUAL_ROBOT, ActionSpace
from betterbench.sim.robots.jaws import Jaw
from betterbench.sim.robots.varied import VariedQuantity

Progress = Callable[[str, int, int], None]
"""Function that is called during a long task with the name of the task, the number of completed steps and the total
number."""


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Camera that is fixed to a body. All vectors are in the frame of the body.

    Attributes:
        position: Position [m].
        target: Point on the optical axis [m].
        up: Direction that points upward in the image.
        fovy_deg: Vertical field of view [degree].
    """

    position: Vector
    target: Vector
    up: Vector
    fovy_deg: float


@dataclass(frozen=True, slots=True)
class IKWeights:
    """Costs of the inverse kinematics relative to a position error of 1 m, and the accepted rotation error.

    An arm with fewer than six joints cannot reach every pose. Its rotation cost is small, so that positions are exact
    and rotations are as close as the arm allows.

    Attributes:
        orientation: Cost of a rotation error [1/rad].
        posture: Cost of the distance to the home posture [1/rad].
        step_damping: Damping of a control step [1/rad2].
        reach_damping: Damping of an iteration when searching for the joint angles of a pose [1/rad2].
        rotation_slack_rad: Largest rotation error that is accepted when a pose is reached [rad].
    """

    orientation: float
    posture: float
    step_damping: float
    reach_damping: float
    rotation_slack_rad: float


@dataclass(frozen=True, slots=True)
class Workspace:
    """Heights and distances that a motion planner uses for a robot [m].

    Attributes:
        carry_heights_m: Heights of the tool center point at which objects are carried across the table, lowest first.
        detours_m: Points (x, y) on the table. If the straight path is blocked, the planner tries a path over one of
            these points. They are needed for an arm that cannot pass close to its own base.
        lift_m: Length of the straight approach to an object, and of the first lift.
        retreat_m: Height by which the tool retreats after releasing an object.
        leave_m: Length at the beginning of a path on which contacts are allowed, because the planner cannot choose
            where a path starts.
        check_step_m: Distance between configurations that are checked along a path. It is small enough that a finger
            cannot pass through a wall between two checked configurations.
    """

    carry_heights_m: tuple[float, ...]
    detours_m: tuple[tuple[float, float], ...]
    lift_m: float
    retreat_m: float
    leave_m: float
    check_step_m: float


@dataclass(frozen=True, slots=True)
class SteeringLimits:
    """Limits of the tool positions that an operator can command, in the robot's base frame.

    Attributes:
        center: Point from which the reach is measured [m].
        back_m: Distance [m] from the tool center point, back along the approach direction, to the point that must stay
            within reach. It is the length of the gripper for an arm that keeps the rotation of its tool, and 0 for an
            arm that tilts its tool.
        longest_m: Largest distance of this point from the center [m].
        nearest_m: Smallest horizontal distance of the tool from the center [m]. If the tool came closer, the arm would
            hit itself.
        highest_m: Largest height of the tool [m].
    """

    center: Vector
    back_m: float
    longest_m: float
    nearest_m: float
    highest_m: float


@dataclass(frozen=True, slots=True)
class RobotSpec:
    """Description of a robot, for controllers, scenes and experts.

    All names are those in the robot's own model. A scene attaches the robot with a prefix. Functions that look up the
    names in the scene need this prefix. Arm joints are listed from base to flange, and all per-joint tuples follow that
    order, with angles in rad and velocity limits in rad/s.

    Attributes:
        name: Name in the registry ("panda").
        dataset_type: Robot type in LeRobot data sets ("so101_follower").
        source: Source of kinematics, masses and meshes.
        position_actuators: For each arm joint, the servo that pulls the joint to its integrated reference.
        velocity_actuators: For each arm joint, the servo that damps the joint toward the reference velocity.
        gripper_actuator: Position servo of the gripper.
        finger_joints: Joints of the fingers. ``jaw`` relates them to the opening width.
        finger_bodies: Bodies of the left finger (+y of the gripper) and of the right finger.
        pad_geoms: Collision geoms of the left and the right pad.
        hand_body: Body that carries the fingers.
        arm_bodies: Bodies of the arm, without the gripper.
        tcp_site: Site of the tool center point between the pads, with z along the approach direction and y along the
            opening direction of the fingers.
        joint_effort: Maximum torque of each servo [N m].
        gripper_opening_m: Largest opening width [m].
        pad_size_m: Width and height of a pad's face [m].
        tip_below_tcp_m: Distance of the fingertips below the tool center point [m].
        gripper_speed_m_s: Speed at which the commanded opening width changes [m/s].
        gripper_force_n: Largest force of each pad on an object [N].
        gripper_lead_m: Largest difference between the commanded and the measured opening width [m].
        control_rate_hz: Number of actions per second [Hz].
        reach_m: Largest distance of the flange from the shoulder [m].
        jaw: Relation between finger joints, gripper servo and opening width.
        action_spaces: Names of the action spaces that the controller executes, starting with the default.
        ik: Costs of the inverse kinematics.
        posture_offsets: Offsets of additional start postures of the inverse kinematics from the home posture, per joint
            [rad].
        wrist_camera: Camera on ``hand_body``.
        front_camera: Camera in the robot's base frame that shows its workspace, or None to use the front camera of the
            stage.
        workspace: Heights and distances for motion planning.
        steering: Limits of an operator's targets. They are not part of the JSON form, because they do not change
            results.
        dynamics: Quantities of the dynamics for which each trial draws values. Empty if the robot's dynamics are known.
        kept_apart: Pairs of the robot's bodies that the planner keeps apart, because they could touch each other in the
            workspace. They are not part of the JSON form, because they do not change the physics.
    """

    name: str
    title: str
    dataset_type: str
    source: str
    license: str
    arm_joints: tuple[str, ...]
    position_actuators: tuple[str, ...]
    velocity_actuators: tuple[str, ...]
    gripper_actuator: str
    finger_joints: tuple[str, ...]
    finger_bodies: tuple[str, str]
    pad_geoms: tuple[str, str]
    hand_body: str
    arm_bodies: tuple[str, ...]
    tcp_site: str
    home_joints: tuple[float, ...]
    joint_low: tuple[float, ...]
    joint_high: tuple[float, ...]
    joint_velocity: tuple[float, ...]
    joint_effort: tuple[float, ...]
    gripper_opening_m: float
    pad_size_m: tuple[float, float]
    tip_below_tcp_m: float
    gripper_speed_m_s: float
    gripper_force_n: float
    gripper_lead_m: float
    control_rate_hz: float
    reach_m: float
    jaw: Jaw
    action_spaces: tuple[str, ...]
    ik: IKWeights
    posture_offsets: tuple[tuple[float, ...], ...]
    wrist_camera: CameraMount
    front_camera: CameraMount | None
    workspace: Workspace
    steering: SteeringLimits
    dynamics: tuple[VariedQuantity, ...] = ()
    kept_apart: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        """Check that all per-joint tuples have the same length and that the home posture is inside the limits."""
        n = len(self.arm_joints)
        per_joint = ("position_actuators", "velocity_actuators", "home_joints", "joint_low", "joint_high")
        for field in (*per_joint, "joint_velocity", "joint_effort"):
            if len(getattr(self, field)) != n:
                raise InvalidInputError(
                    f"robot {self.name!r}",
                    f"{field} has {len(getattr(self, field))} entries",
                    f"Use one entry per joint ({n})",
                )
        if any(len(offset) != n for offset in self.posture_offsets):
            raise InvalidInputError(
                f"robot {self.name!r}", "an entry of posture_offsets has a wrong length", f"Use {n} angles in each"
            )
        for joint, low, home, high in zip(
            self.arm_joints, self.joint_low, self.home_joints, self.joint_high, strict=True
        ):
            if not low < home < high:
                raise InvalidInputError(
                    f"robot {self.name!r}",
                    f"the home angle of {joint} is outside [{low}, {high}] rad",
                    "Choose an angle inside this range",
                )

    @property
    def control_period_s(self) -> float:
        """Time between two actions [s]."""
        return 1.0 / self.control_rate_hz

    def positions_in(self, space: ActionSpace, joints: Sequence[float], width_m: float) -> list[float]:
        """Convert joint angles and an opening width to the units of an action space that commands the robot's motors.

        The arguments are the joint angles [rad] and the opening width [m].
        """
        *units, gripper = space.scale
        return [*(q / unit for q, unit in zip(joints, units, strict=True)), self.jaw.share_at(width_m) / gripper]

    def contact_name(self, body: str) -> str | None:
        """Return the name that recorded contacts use for a body, or None if it has none.

        ``body`` is given without prefix.
        """
        if body == self.finger_bodies[0]:
            return "left_finger"
        if body == self.finger_bodies[1]:
            return "right_finger"
        if body == self.hand_body:
            return "hand"
        return "arm" if body in self.arm_bodies else None

    def to_json(self) -> dict[str, Any]:
        """Return the description in JSON form, for records and handshakes. Empty dynamics are omitted."""
        form = {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}
        del form["steering"], form["kept_apart"]
        if not self.dynamics:
            del form["dynamics"]
        return form


class RobotBuilder(Protocol):
    """Function that builds the MuJoCo description of a robot."""

    def __call__(self, *, visuals: bool, progress: Progress | None) -> mujoco.MjSpec:
        """Return a new description, with or without visual meshes."""


_ROBOTS: dict[str, tuple[RobotSpec, RobotBuilder]] = {}


def register_robot(spec: RobotSpec, builder: RobotBuilder) -> None:
    """Register a robot under its name. Raises InvalidInputError if the name is already used."""
    if spec.name in _ROBOTS:
        raise InvalidInputError(
            f"robot {spec.name!r}", "a robot with this name is already registered", "Register each robot once"
        )
    _ROBOTS[spec.name] = (spec, builder)


def robot_names() -> tuple[str, ...]:
    """Return the names of all registered robots."""
    return tuple(sorted(_ROBOTS))


def robot(name: str) -> RobotSpec:
    """Return the robot with the given name. Raises UnknownNameError if there is none."""
    try:
        return _ROBOTS[name][0]
    except KeyError:
        raise UnknownNameError("robot", name, _ROBOTS) from None


def robot_of_space(action_space: str) -> RobotSpec:
    """Return the robot for an action space that commands the robot's motors directly.

    Raises UnknownNameError if no robot executes the action space.
    """
    known = {space: spec for spec, _ in reversed(_ROBOTS.values()) for space in spec.action_spaces}
    if action_space not in known:
        raise UnknownNameError("action space", action_space, known)
    return known[action_space]


def motor_positions(space: ActionSpace, observation: Observation) -> list[float]:
    """Return the measured motor positions in the units of a robot's action space.

    Raises PolicyError if the observation comes from a different robot.
    """
    spec, joints = robot_of_space(space.name), observation.joint_positions.tolist()
    if len(joints) != space.dim - 1:
        raise PolicyError(
            f"{space.name} is a state format of the robot {spec.title}, but the observed robot has {len(joints)} "
            f"joints. Evaluate with --robot {spec.name}, or choose another preset."
        )
    return spec.positions_in(space, joints, observation.gripper_width)


def robot_space(name: str, action_space: str | None = None) -> str:
    """Return the name of the action space to use with a robot: the requested one, or else the robot's default.

    Raises:
        UnknownNameError: If the robot is unknown or does not execute the requested action space.
    """
    known = robot(name)
    if action_space is None:
        return known.action_spaces[0]
    if action_space not in known.action_spaces:
        raise UnknownNameError(f"action space for the {known.title}", action_space, known.action_spaces)
    return action_space


def build_robot_spec(
    name: str = USUAL_ROBOT, *, visuals: bool = True, progress: Progress | None = None
) -> mujoco.MjSpec:
    """Return a new MuJoCo description of a robot with its base at the origin.

    It can be attached to a scene or compiled alone. The physics is the same with and without visual meshes.

    Raises:
        UnknownNameError: If the robot is unknown.
        MissingDependencyError: If the package with the meshes is not installed.
    """
    robot(name)
    return _ROBOTS[name][1](visuals=visuals, progress=progress)
