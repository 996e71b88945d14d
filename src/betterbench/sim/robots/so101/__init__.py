"""TheRobotStudio's SO-101: a 3D-printed arm with five joints and one moving jaw, driven by six STS3215 servos.

The kinematics, joint ranges, masses, inertias and meshes come from TheRobotStudio's ``SO-ARM100`` (``Simulation/SO101``
with the new calibration), as published in MuJoCo Menagerie's ``robotstudio_so101`` (commit
4c358ef9d9d7f32ca58b40b490884a0c1726a440). Both are licensed under Apache-2.0. The file ``meshes.npz`` contains the
decimated visual meshes. ``tools/so101_meshes.py`` generates the file and documents the changes. ``LICENSE`` is the
license of the original meshes.

**Zero angles.** The new calibration puts the zero of each joint in the middle of its range. TheRobotStudio's old
calibration, with the zero at the fully extended arm, is not used here.

**Servos.** ``kp`` 998.22 N m/rad and ``kv`` 2.731 N m s/rad are derived from a model of the DC motor (SO-ARM100, pull
request 141). Damping, friction loss and armature of the STS3215 are those of Open Duck Mini, a robot with the same
servo. We know of no measurements on this arm. LeRobot limits the gripper's servo to half of its torque.

**Collision shapes** are boxes fitted to the meshes. Each jaw has a flat pad along its inner face, so that a held object
touches two planes instead of printed ridges.

The base frame is on the table below the arm's mounting plate. Its x axis points away from the base.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from pathlib import Path

import mujoco

from betterbench.interface.actions import (
    EE_DELTA,
    EE_DELTA_MEASURED,
    EE_POSE,
    SO101_DEGREES,
    SO101_MOTORS,
    SO101_NORMALIZED,
)
from betterbench.sim.robots.building import (
    FIRM,
    SEEN,
    Link,
    Shape,
    about,
    add_joint_servos,
    add_link,
    add_servo,
    add_shape,
)
from betterbench.sim.robots.jaws import HingedJaw
from betterbench.sim.robots.meshes import MeshPart, parts_from_bytes
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.robots.spec import (
    CameraMount,
    IKWeights,
    Progress,
    RobotSpec,
    SteeringLimits,
    Workspace,
    register_robot,
)
from betterbench.sim.robots.varied import VariedQuantity

MESH_FILE = Path(__file__).parent / "meshes.npz"

SERVO_STIFFNESS = 998.22
"""Position gain of a servo [N m/rad]."""
SERVO_DAMPING = 2.731
"""Velocity gain of a servo [N m s/rad]."""
SERVO_TORQUE = 2.94
"""Stall torque of the STS3215 at 12 V [N m]. The data sheet gives it as 30 kg cm."""
GRIPPER_TORQUE = 0.5 * SERVO_TORQUE
"""Torque limit of the gripper's servo [N m].

LeRobot's ``so101_follower`` sets ``Max_Torque_Limit`` of the gripper to 500 of 1000 to protect the windings.
"""

JOINT_DAMPING = 0.60
"""Viscous friction of a servo [N m s/rad], taken from Open Duck Mini."""
JOINT_FRICTION = 0.052
"""Dry friction of a servo [N m], taken from Open Duck Mini."""
JOINT_ARMATURE = 0.028
"""Reflected rotor inertia of a servo [kg m2], taken from Open Duck Mini."""

PAD_FRICTION = (1.0, 0.01, 0.0001)
"""Sliding, torsional and rolling friction of a pad.

Sliding: printed jaws with grip tape. Torsional: two thirds of the radius of a 15 mm contact patch. Rolling: the
solver's default.
"""

_BASE_Z = 0.0024
"""Height of the model's base frame above its mounting plate [m]."""


@dataclass(frozen=True, slots=True)
class Part:
    """One mesh of a link: its file name without the extension, its pose in the link, and its paint."""

    link: str
    mesh: str
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    paint: str


_SERVO, _SERVO_NO_HORN = "sts3215_03a_v1", "sts3215_03a_no_horn_v1"

PARTS = (
    Part("base", "base_motor_holder_so101_v1", (-0.006365, -9.9e-05, 0.0), (1.0, 1.0, 1.0, 1.0), "print"),
    Part("base", "base_so101_v2", (-0.006365, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0), "print"),
    Part("base", _SERVO, (0.0263353, 0.0, 0.0461), (1.0, 0.0, 0.0, 0.0), "dark"),
    Part("base", "waveshare_mounting_plate_so101_v2", (-0.0309827, -0.000199, 0.0498), (1.0, 1.0, 1.0, 1.0), "print"),
    Part("shoulder", _SERVO, (-0.030399, 0.000422, -0.0417), (1.0, 1.0, 1.0, -1.0), "dark"),
    Part("shoulder", "motor_holder_so101_base_v1", (-0.067599, -0.000178, 0.01585), (1.0, 1.0, -1.0, 1.0), "print"),
    Part("shoulder", "rotation_pitch_so101_v1", (0.012201, 2.2e-05, 0.0464), (1.0, -1.0, 0.0, 0.0), "print"),
    Part("upper_arm", _SERVO, (-0.11257, -0.0155, 0.0187), (0.0, -1.0, 1.0, 0.0), "dark"),
    Part("upper_arm", "upper_arm_so101_v1", (-0.065085, 0.012, 0.0182), (0.0, 1.0, 0.0, 0.0), "print"),
    Part("lower_arm", "under_arm_so101_v1", (-0.06485, -0.032, 0.0182), (0.0, 1.0, 0.0, 0.0), "print"),
    Part("lower_arm", "motor_holder_so101_wrist_v1", (-0.06485, -0.032, 0.018), (0.0, -1.0, 0.0, 0.0), "print"),
    Part("lower_arm", _SERVO, (-0.1224, 0.0052, 0.0187), (0.0, 0.0, 1.0, 0.0), "dark"),
    Part("wrist", _SERVO_NO_HORN, (0.0, -0.0424, 0.0306), (1.0, 1.0, 1.0, -1.0), "dark"),
    Part("wrist", "wrist_roll_pitch_so101_v2", (0.0, -0.028, 0.0181), (1.0, -1.0, -1.0, -1.0), "print"),
    Part("gripper", _SERVO, (0.0077, 0.0001, -0.0234), (1.0, -1.0, 0.0, 0.0), "dark"),
    Part("gripper", "wrist_roll_follower_so101_v1", (0.0, -0.000218, 0.00095), (0.0, 1.0, 0.0, 0.0), "jaw"),
    Part("camera", "wrist_roll_follower_so101_camera_mount", (0.0, -0.000218, 0.00095), (0.0, 1.0, 0.0, 0.0), "jaw"),
    Part("moving_jaw", "moving_jaw_so101_v1", (0.0, 0.0, 0.0189), (1.0, 0.0, 0.0, 0.0), "jaw"),
)
"""Visual meshes of the arm."""

_BASE = Link(
    "base",
    (0.0, 0.0, 0.0),
    (1.0, 0.0, 0.0, 0.0),
    0.147,
    (0.0137179, -5.19711e-05, 0.0334843 + _BASE_Z),
    (0.000114686, 0.000136117, 0.000130364, -4.59787e-07, 4.97151e-06, 9.75275e-08),
    (
        Shape("box", (0.021, 0.0, 0.007), (0.043, 0.0555, 0.007)),
        Shape("box", (0.016, 0.0, 0.043), (0.047, 0.026, 0.029)),
    ),
)

_CHAIN = (
    Link(
        "shoulder",
        (0.0388353, 0.0, 0.0624 + _BASE_Z),
        (0.0, 0.0, -1.0, 0.0),
        0.100006,
        (-0.0307604, -1.7e-05, -0.0252713),
        (8.3759e-05, 8.10403e-05, 2.39783e-05, 7.55525e-08, -1.16342e-06, 1.54663e-07),
        (Shape("box", (-0.029, 0.001, -0.041), (0.021, 0.024, 0.022)),),
        armature=JOINT_ARMATURE,
    ),
    Link(
        "upper_arm",
        (-0.0303992, -0.0182778, -0.0542),
        (1.0, -1.0, -1.0, -1.0),
        0.103,
        (-0.089847, -0.008382, 0.018409),
        (4.08002e-05, 0.000147318, 0.000142487, -1.97819e-05, -4.03016e-08, 8.97326e-09),
        (
            Shape("box", (-0.056, 0.0, 0.0182), (0.048, 0.0115, 0.030)),
            Shape("box", (-0.115, -0.012, 0.0182), (0.014, 0.024, 0.020)),
        ),
        armature=JOINT_ARMATURE,
    ),
    Link(
        "lower_arm",
        (-0.11257, -0.028, 0.0),
        (1.0, 0.0, 0.0, 1.0),
        0.104,
        (-0.098070, 0.0032438, 0.018283),
        (2.87438e-05, 0.000159844, 0.00014529, 7.41152e-06, 1.26409e-06, -4.90188e-08),
        (
            Shape("box", (-0.050, 0.0, 0.0182), (0.050, 0.0115, 0.030)),
            Shape("box", (-0.122, 0.004, 0.0182), (0.024, 0.014, 0.025)),
        ),
        armature=JOINT_ARMATURE,
    ),
    Link(
        "wrist",
        (-0.1349, 0.0052, 0.0),
        (1.0, 0.0, 0.0, -1.0),
        0.079,
        (-0.000103312, -0.0386143, 0.0281156),
        (3.68263e-05, 2.5391e-05, 2.1e-05, 1.7893e-08, -5.28128e-08, 3.6412e-06),
        (
            Shape("box", (0.0, 0.0, 0.0222), (0.013, 0.012, 0.031)),
            Shape("box", (-0.001, -0.040, 0.0222), (0.018, 0.025, 0.031)),
        ),
        armature=JOINT_ARMATURE,
    ),
    Link(
        "gripper",
        (0.0, -0.0611, 0.0181),
        (0.0172091, -0.0172091, 0.706897, 0.706897),
        0.087,
        (0.000214, 0.000245, -0.025187),
        (2.75087e-05, 4.33657e-05, 3.45059e-05, -3.35241e-07, -5.7352e-06, -5.17847e-08),
        (Shape("box", (-0.002, -0.002, -0.018), (0.032, 0.023, 0.018)),),
        armature=JOINT_ARMATURE,
    ),
)
"""Links of the arm from the base to the gripper. The five arm joints turn them about their z axes."""

_CAMERA = Link(
    "camera",
    (0.0, 0.0, 0.0),
    (1.0, 0.0, 0.0, 0.0),
    0.012,
    (0.0, 0.053, -0.038),
    (3.0e-06, 2.0e-06, 4.0e-06, 0.0, 0.0, 0.0),
    (Shape("box", (0.0, 0.053, -0.038), (0.020, 0.031, 0.006), turn=("x", -0.548)),),
)
"""Camera module and its mount on the gripper."""

_FIXED_JAW_SHAPES = (Shape("box", (-0.0225, 0.0, -0.063), (0.0060, 0.0075, 0.030), turn=("y", -0.25)),)
_FIXED_PAD = Shape("box", (-0.01458, 0.0, -0.0755), (0.003, 0.006, 0.0294), turn=("y", -0.1159))

_MOVING_JAW = Link(
    "moving_jaw",
    (0.0202, 0.0188, -0.0234),
    (1.0, 1.0, 0.0, 0.0),
    0.012,
    (-0.001575, -0.0300244, 0.0192755),
    (6.61427e-06, 1.89032e-06, 5.28738e-06, -3.19807e-07, -5.90717e-09, -1.09945e-07),
    (
        Shape("box", (0.0, -0.006, 0.0189), (0.010, 0.015, 0.0235)),
        Shape("box", (0.0005, -0.046, 0.0189), (0.0045, 0.024, 0.0065), turn=("z", -0.10)),
    ),
    armature=JOINT_ARMATURE,
)
_MOVING_PAD = Shape("box", (-0.0073, -0.0562, 0.0189), (0.003, 0.0262, 0.006), turn=("z", -0.0768))

_TOOL_X, _TOOL_Z = 0.0165, -0.094
"""Position of the tool center point in the gripper's frame [m].

The point is 10 mm from the tip of the fixed jaw and 26 mm from that jaw's face, so that a fruit 52 mm wide between the
jaws is centered on the point.
"""
_FACE_X = -0.0094
"""Position of the fixed pad's face at the height of the tool center point, in the gripper's frame [m]."""

_JAW_LOW, _JAW_HIGH = -0.174533, 1.745329
_LEVEL_X, _LEVEL_Y = -0.0114, -0.0706
"""Point on the moving pad's face that is level with the tool center point at zero angle, in the jaw's frame [m]."""

_ARM = SO101_MOTORS[:-1]
_OPENING_M = 0.085

SO101 = RobotSpec(
    name="so101",
    title="SO-101 follower arm",
    dataset_type="so101_follower",
    source="TheRobotStudio SO-ARM100, Simulation/SO101 (new calibration), by MuJoCo Menagerie robotstudio_so101; servo "
    "damping, friction and armature of Open Duck Mini",
    license="Apache-2.0",
    arm_joints=_ARM,
    position_actuators=tuple(f"{joint}_position" for joint in _ARM),
    velocity_actuators=tuple(f"{joint}_velocity" for joint in _ARM),
    gripper_actuator="gripper",
    finger_joints=("gripper",),
    finger_bodies=("moving_jaw", "fixed_jaw"),
    pad_geoms=("moving_pad", "fixed_pad"),
    hand_body="gripper",
    arm_bodies=("base", "shoulder", "upper_arm", "lower_arm", "wrist"),
    tcp_site="tcp",
    # At home, the tool is 8 cm above the table and 20 cm in front of the base's origin. It points straight down, with
    # the camera on the far side.
    home_joints=(-0.1031, -0.2731, 0.3105, 1.5334, -1.6252),
    joint_low=(-1.91986, -1.74533, -1.69, -1.65806, -2.7438473),
    joint_high=(1.91986, 1.74533, 1.69, 1.65806, 2.84121),
    # Without load, the STS3215 turns at 4.7 rad/s (60 degrees in 0.222 s). With the friction above and the weight of
    # the arm, its torque suffices for 3.5 rad/s.
    joint_velocity=(3.0,) * 5,
    joint_effort=(SERVO_TORQUE,) * 5,
    gripper_opening_m=_OPENING_M,
    pad_size_m=(2.0 * _FIXED_PAD.end[1], 2.0 * _FIXED_PAD.end[2]),
    tip_below_tcp_m=0.1044 + _TOOL_Z,
    gripper_speed_m_s=0.15,
    # The torque limit, divided by the lever arm of the tool center point.
    gripper_force_n=round(GRIPPER_TORQUE / abs(_LEVEL_Y), 1),
    gripper_lead_m=0.012,
    control_rate_hz=PHYSICS.control_rate_hz,
    reach_m=0.41,
    jaw=HingedJaw(
        offset_m=_MOVING_JAW.position[0] - _FACE_X,
        radius_m=math.hypot(_LEVEL_X, _LEVEL_Y),
        phase_rad=math.atan2(_LEVEL_X, _LEVEL_Y) + math.pi,
        low_rad=_JAW_LOW,
        high_rad=_JAW_HIGH,
        fixed_m=_TOOL_X - _FACE_X,
        clearance_m=0.005,
        press_m=0.001,
    ),
    action_spaces=tuple(s.name for s in (SO101_DEGREES, SO101_NORMALIZED, EE_DELTA, EE_DELTA_MEASURED, EE_POSE)),
    ik=IKWeights(
        # At the length of the arm, a rotation error of 0.5 rad displaces the tool by less than 0.05 mm.
        orientation=0.003,
        posture=1e-5,
        step_damping=1e-6,
        reach_damping=1e-7,
        rotation_slack_rad=0.8,
    ),
    posture_offsets=(
        (0.0, 0.0, 0.0, 0.0, 0.0),
        (1.0, 0.0, 0.0, 0.0, 0.0),
        (-1.0, 0.0, 0.0, 0.0, 0.0),
        (0.0, 0.5, -0.5, 0.0, 0.0),
        (0.0, 0.0, 0.0, 0.0, 2.5),
        (1.0, 0.0, 0.0, 0.0, 2.5),
        (-1.0, 0.0, 0.0, 0.0, 2.5),
    ),
    # The pose is that of TheRobotStudio's camera mount for a 32 x 32 mm module. With the field of view of MuJoCo
    # Menagerie (48.5 degrees), only the fixed jaw would be in the image. With the usual wide lens, both jaws are
    # visible.
    wrist_camera=CameraMount((0.0, 0.055, -0.045), (0.0, 0.01722, -0.10393), (0.0, 1.0, 0.0), 70.0),
    # The camera is placed as on a stand in front of the arm, as in LeRobot's kits.
    front_camera=CameraMount((0.72, 0.0, 0.46), (0.17, 0.0, 0.045), (0.0, 0.0, 1.0), 52.0),
    workspace=Workspace(
        carry_heights_m=(0.09, 0.11, 0.13, 0.16, 0.19),
        detours_m=((0.24, 0.0),),
        lift_m=0.06,
        retreat_m=0.05,
        leave_m=0.015,
        check_step_m=0.012,
    ),
    # This sphere is centered on the first axis at the height of the second. At its edge, the tool tilts by up to 40°.
    steering=SteeringLimits(center=(0.0388, 0.0, 0.119), back_m=0.0, longest_m=0.32, nearest_m=0.11, highest_m=0.24),
    # The first three quantities are taken from another robot, so their ranges are wide. The gains come from a model of
    # the motor, and depend on firmware and supply voltage. Each servo has its own values.
    dynamics=(
        VariedQuantity("joint_damping", 0.5, 2.0, "borrowed from Open Duck Mini; a choice"),
        VariedQuantity("joint_friction", 0.5, 2.0, "borrowed from Open Duck Mini; a choice"),
        VariedQuantity("joint_armature", 0.7, 1.4, "borrowed from Open Duck Mini; a choice"),
        VariedQuantity("servo_stiffness", 0.7, 1.4, "a model of the motor, SO-ARM100 pull request 141; a choice"),
        VariedQuantity("servo_damping", 0.7, 1.4, "a model of the motor, SO-ARM100 pull request 141; a choice"),
        VariedQuantity(
            "backlash",
            math.radians(0.3),
            math.radians(1.3),
            "data sheet of the STS3215: at most 0.5 degrees; measured: about 1 degree (SO-ARM100 issue 134), 0.8 to "
            "1.3 degrees (Robonine, Backlash Compensation in STS3215 Servo Actuators)",
        ),
    ),
    # Near its base, the arm folds so far that the wrist camera or the gripper comes close to the first link.
    kept_apart=(("camera", "base"), ("camera", "shoulder"), ("gripper", "shoulder"), ("moving_jaw", "shoulder")),
)

_PAINTS = {"print": (0.93, 0.92, 0.89, 1.0), "jaw": (0.95, 0.42, 0.08, 1.0), "dark": (0.11, 0.11, 0.12, 1.0)}
"""Colors of the printed parts, of the printed parts of the gripper, and of the servos."""


def build_so101(*, visuals: bool = True, progress: Progress | None = None) -> mujoco.MjSpec:
    """Return a new MuJoCo description of the SO-101. Its physics is the same with and without visual meshes."""
    del progress  # the packaged meshes are already decimated
    spec = mujoco.MjSpec()
    spec.modelname = SO101.name
    PHYSICS.set_solver(spec)
    for name, rgba in _PAINTS.items():
        spec.add_material(name=f"so101_{name}", rgba=rgba, specular=0.25, shininess=0.3)
    body = add_link(spec.worldbody, _BASE)
    bodies = {"base": body}
    limits = tuple(zip(SO101.joint_low, SO101.joint_high, strict=True))
    for link, joint, range_ in zip(_CHAIN, _ARM, limits, strict=True):
        body = bodies[link.name] = add_link(body, link)
        _add_hinge(body, joint, range_, SERVO_TORQUE)
    bodies["camera"] = add_link(body, _CAMERA)
    bodies["moving_jaw"] = _add_jaws(body)
    stiffness, damping = (SERVO_STIFFNESS,) * len(_ARM), (SERVO_DAMPING,) * len(_ARM)
    names = (_ARM, SO101.position_actuators, SO101.velocity_actuators)
    add_joint_servos(spec, names, stiffness=stiffness, damping=damping, limits=limits)
    bias = (0.0, -SERVO_STIFFNESS, -SERVO_DAMPING)
    gripper = add_servo(spec, SO101.gripper_actuator, SO101.finger_joints[0], gain=SERVO_STIFFNESS, bias=bias)
    gripper.ctrllimited, gripper.ctrlrange = True, (_JAW_LOW, _JAW_HIGH)
    gripper.forcelimited, gripper.forcerange = True, (-GRIPPER_TORQUE, GRIPPER_TORQUE)
    _exclude_neighbors(spec)
    if visuals:
        _add_visuals(spec, bodies)
    return spec


def _add_hinge(body: mujoco.MjsBody, name: str, limits: tuple[float, float], torque: float) -> None:
    """Add the joint of a servo, with its friction and its torque limit [N m]."""
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=(0.0, 0.0, 1.0),
        range=limits,
        damping=JOINT_DAMPING,
        frictionloss=JOINT_FRICTION,
        armature=JOINT_ARMATURE,
        actfrcrange=(-torque, torque),
    )


def _add_jaws(gripper: mujoco.MjsBody) -> mujoco.MjsBody:
    """Add the tool center point and both jaws with their pads. Return the moving jaw."""
    half = math.sqrt(0.5)
    gripper.add_site(
        name=SO101.tcp_site, pos=(_TOOL_X, 0.0, _TOOL_Z), quat=(0.0, half, half, 0.0), size=(0.004,) * 3, group=4
    )
    fixed = gripper.add_body(name="fixed_jaw")  # own body, so that its contacts differ from those of the palm
    for number, shape in enumerate(_FIXED_JAW_SHAPES):
        add_shape(fixed, shape, f"fixed_jaw_collision{number}")
    moving = add_link(gripper, _MOVING_JAW)
    _add_hinge(moving, SO101.finger_joints[0], (_JAW_LOW, _JAW_HIGH), GRIPPER_TORQUE)
    for body, name, pad in ((moving, "moving_pad", _MOVING_PAD), (fixed, "fixed_pad", _FIXED_PAD)):
        add_shape(body, pad, name, {"friction": PAD_FRICTION, **FIRM})
    return moving


def _exclude_neighbors(spec: mujoco.MjSpec) -> None:
    """Exclude collisions of bodies that always overlap: adjacent links, and the short wrist with its neighbors."""
    for first, second in (
        ("base", "shoulder"),
        ("base", "upper_arm"),
        ("shoulder", "upper_arm"),
        ("upper_arm", "lower_arm"),
        ("lower_arm", "wrist"),
        ("lower_arm", "gripper"),
        ("wrist", "gripper"),
        ("wrist", "fixed_jaw"),
        ("wrist", "moving_jaw"),
        ("gripper", "moving_jaw"),
        ("gripper", "fixed_jaw"),
        ("gripper", "camera"),
    ):
        spec.add_exclude(name=f"{first}_{second}", bodyname1=first, bodyname2=second)


@functools.cache
def _meshes() -> dict[str, MeshPart]:
    return {part.link: part for part in parts_from_bytes(MESH_FILE.read_bytes())}


def _add_visuals(spec: mujoco.MjSpec, bodies: dict[str, mujoco.MjsBody]) -> None:
    """Add the decimated meshes, and the camera in its mount."""
    for name, part in _meshes().items():
        mesh = spec.add_mesh(name=name)
        mesh.uservert = part.vertices.ravel()
        mesh.userface = part.faces.astype("int32").ravel()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    for number, piece in enumerate(PARTS):
        bodies[piece.link].add_geom(
            name=f"visual{number}_{piece.mesh}",
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=piece.mesh,
            pos=piece.position,
            quat=piece.quaternion,
            material=f"so101_{piece.paint}",
            **SEEN,
        )
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    look = about("x", -0.57)
    camera, dark = spec.body("camera"), "so101_dark"
    camera.add_geom(
        name="camera_board",
        type=box,
        pos=(0.0, 0.057, -0.043),
        size=(0.016, 0.016, 0.002),
        quat=look,
        material=dark,
        **SEEN,
    )
    camera.add_geom(
        name="camera_lens",
        type=cylinder,
        pos=(0.0, 0.054, -0.048),
        size=(0.007, 0.005, 0.0),
        quat=look,
        material=dark,
        **SEEN,
    )


register_robot(SO101, build_so101)
