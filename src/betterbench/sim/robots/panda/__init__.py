"""The Franka Emika Panda with its two-finger hand, modeled from Franka's public description.

Kinematics (joint origins, limits of position and speed, the hand turned by -45 degrees on the flange, the fingers 58.4
mm and the tool center point 103.4 mm below the hand frame): the URDF of Franka's own ``franka_description``
(Apache-2.0) and the Denavit-Hartenberg table in the documentation of the Franka Control Interface.

Masses and inertias of the links: C. Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano, A. De Luca, "Dynamic
Identification of the Franka Emika Panda Robot With Retrieval of Feasible Parameters Using Penalty-Based Optimization",
IEEE RA-L 4(4), 2019. Hand and fingers: ``franka_description``, ``inertial.yaml``.

Reflected rotor inertias: 0.6057 (joints 1-2), 0.4625 (3-4) and 0.2055 kg m2 (5-7), given by Franka for the successor
FR3 and published in the README of Drake's ``franka_description``. Joint friction is omitted, because the Panda's joint
torque controllers compensate it, as they compensate gravity (``gravcomp``).

Collision shapes are capsules, cylinders and boxes fitted to the visual meshes. ``tests/sim/robots`` measures how far
they deviate from the meshes.
"""

from __future__ import annotations

import functools
import itertools
import math

import mujoco
import numpy as np

from betterbench.interface.actions import ACTION_SPACES, PANDA_OPENING_M
from betterbench.sim.robots.building import (
    COLLIDES,
    FIRM,
    SEEN,
    Link,
    Shape,
    about,
    add_joint_servos,
    add_link,
    add_servo,
)
from betterbench.sim.robots.jaws import ParallelJaw
from betterbench.sim.robots.meshes import MeshPart, visual_parts
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

FACE_BUDGET = 7600
"""Number of triangles of the arm and the hand together, counting the two fingers once.

The budget of the complete robot is 8,000 (design, section 3).
"""

PAD_HALF_SIZE = (0.010, 0.004, 0.012)
"""Half extents of a finger pad [m]. Its face is 20 x 24 mm, and it is 8 mm deep."""

PAD_CENTER_Z = 0.042
"""Height of the pad's center in the finger frame [m].

The lower edge of the pad is flush with the fingertip at 54 mm.
"""

PAD_FRICTION = (1.2, 0.01, 0.0001)
"""Sliding, torsional and rolling friction of a pad.

Sliding: rubber on a smooth solid. Torsional: two thirds of the radius of a 15 mm contact patch. Rolling: the solver's
default.
"""

_HALF_PI = 0.5 * math.pi


_LINKS = (
    Link(
        "link0",
        (0.0, 0.0, 0.0),
        about("z", 0.0),
        0.629769,
        (-0.041018, -0.00014, 0.049974),
        (0.00315, 0.00388, 0.004285, 8.2904e-07, 0.00015, 8.2299e-06),
        (
            Shape("box", (-0.042, 0.0, 0.010), (0.111, 0.092, 0.010)),
            Shape("box", (-0.034, 0.0, 0.048), (0.096, 0.076, 0.030)),
            Shape("box", (-0.030, 0.0, 0.091), (0.066, 0.064, 0.015)),
            Shape("cylinder", (0.0, 0.0, 0.020), (0.0, 0.0, 0.140), 0.057),
        ),
    ),
    Link(
        "link1",
        (0.0, 0.0, 0.333),
        about("z", 0.0),
        4.970684,
        (0.003875, 0.002081, -0.04762),
        (0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169),
        (
            Shape("cylinder", (0.0, 0.0, -0.192), (0.0, 0.0, -0.100), 0.055),
            Shape("capsule", (0.0, -0.012, -0.110), (0.0, -0.060, -0.035), 0.049),
            Shape("cylinder", (0.0, -0.122, 0.0), (0.0, 0.0, 0.0), 0.055),
        ),
        armature=0.6057,
    ),
    Link(
        "link2",
        (0.0, 0.0, 0.0),
        about("x", -_HALF_PI),
        0.646926,
        (-0.003141, -0.02872, 0.003495),
        (0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704),
        (
            Shape("cylinder", (0.0, -0.194, 0.0), (0.0, -0.100, 0.0), 0.055),
            Shape("capsule", (0.0, -0.110, 0.012), (0.0, -0.035, 0.060), 0.049),
            Shape("cylinder", (0.0, 0.0, 0.0), (0.0, 0.0, 0.122), 0.055),
        ),
        armature=0.6057,
    ),
    Link(
        "link3",
        (0.0, -0.316, 0.0),
        about("x", _HALF_PI),
        3.228604,
        (0.027518, 0.039252, -0.066502),
        (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805),
        (
            Shape("cylinder", (0.0, 0.0, -0.121), (0.0, 0.0, -0.030), 0.055),
            Shape("capsule", (0.0075, 0.015, -0.060), (0.0725, 0.050, -0.010), 0.050),
            Shape("cylinder", (0.0825, 0.0, 0.0), (0.0825, 0.106, 0.0), 0.054),
        ),
        armature=0.4625,
    ),
    Link(
        "link4",
        (0.0825, 0.0, 0.0),
        about("x", _HALF_PI),
        3.587895,
        (-0.05317, 0.104419, 0.027454),
        (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641),
        (
            Shape("cylinder", (-0.0825, 0.030, 0.0), (-0.0825, 0.124, 0.0), 0.055),
            Shape("capsule", (-0.075, 0.063, 0.015), (-0.010, 0.010, 0.050), 0.050),
            Shape("cylinder", (0.0, 0.0, 0.0), (0.0, 0.0, 0.106), 0.054),
        ),
        armature=0.4625,
    ),
    Link(
        "link5",
        (-0.0825, 0.384, 0.0),
        about("x", -_HALF_PI),
        1.225946,
        (-0.011953, 0.041065, -0.038437),
        (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229),
        (
            Shape("cylinder", (0.0, 0.0, -0.259), (0.0, 0.0, -0.190), 0.055),
            Shape("capsule", (0.0, 0.020, -0.200), (0.0, 0.070, -0.150), 0.040),
            Shape("box", (0.0, 0.087, -0.095), (0.032, 0.024, 0.060), turn=("x", -0.11)),
            Shape("cylinder", (0.0, 0.016, 0.0), (0.0, 0.126, 0.0), 0.051),
        ),
        armature=0.2055,
    ),
    Link(
        "link6",
        (0.0, 0.0, 0.0),
        about("x", _HALF_PI),
        1.666555,
        (0.060149, -0.014117, -0.010517),
        (0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341),
        (
            Shape("cylinder", (0.0, 0.0, -0.015), (0.0, 0.0, 0.055), 0.048),
            Shape("box", (0.045, 0.004, 0.018), (0.035, 0.050, 0.036)),
            Shape("cylinder", (0.088, -0.051, 0.0), (0.088, 0.080, 0.0), 0.044),
        ),
        armature=0.2055,
    ),
    Link(
        "link7",
        (0.088, 0.0, 0.0),
        about("x", _HALF_PI),
        0.735522,
        (0.010517, -0.004252, 0.061597),
        (0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741),
        (
            Shape("cylinder", (0.0, 0.0, 0.052), (0.0, 0.0, 0.107), 0.044),
            Shape("capsule", (0.020, 0.020, 0.080), (0.057, 0.057, 0.080), 0.020),
            Shape("capsule", (0.067, 0.026, 0.081), (0.026, 0.067, 0.081), 0.015),
        ),
        armature=0.2055,
    ),
)

_HAND = Link(
    "hand",
    (0.0, 0.0, 0.107),
    about("z", -0.25 * math.pi),
    0.73,
    (-0.01, 0.0, 0.03),
    (0.001, 0.0025, 0.0017, 0.0, 0.0, 0.0),
    (
        Shape("box", (0.0, 0.0, 0.028), (0.023, 0.101, 0.038)),
        Shape("box", (0.0, 0.0, 0.003), (0.031, 0.053, 0.007)),
        Shape("box", (0.0, -0.069, -0.017), (0.006, 0.025, 0.009)),
    ),
)

_FINGER = Link(
    "finger",
    (0.0, 0.0, 0.0584),
    about("z", 0.0),
    0.015,
    # The mesh spans 54 mm. Nevertheless, the center of mass stays where the public description has it.
    (0.0, 0.0, 0.0),
    (2.375e-06, 2.375e-06, 7.5e-07, 0.0, 0.0, 0.0),
    (
        Shape("box", (0.0, 0.0185, 0.011), (0.0110, 0.0075, 0.010)),
        Shape("box", (0.0, 0.0068, 0.0022), (0.0110, 0.0044, 0.0019)),
        Shape("box", (0.0, 0.0159, 0.0284), (0.00875, 0.0035, 0.0118), turn=("x", math.pi / 6.0)),
        Shape("box", (0.0, 0.0115, 0.0450), (0.00875, 0.0035, 0.0090)),
    ),
    # The spindle drive of the Franka Hand is not back-drivable. 0.1 kg per finger represents its reflected inertia.
    armature=0.1,
)

SERVO_STIFFNESS = (3500.0, 3500.0, 2500.0, 2500.0, 700.0, 700.0, 500.0)
"""Position gain of each arm joint [N m/rad].

The gain is the square of a natural frequency of about 45 rad/s times the largest inertia of the joint over the
workspace. The slowest loop then settles within a tenth of a second, and its frequency is far (1:20) from the 500 Hz of
the physics.
"""

SERVO_DAMPING = (160.0, 160.0, 110.0, 110.0, 32.0, 32.0, 23.0)
"""Velocity gain of each arm joint [N m s/rad]. It gives critical damping: 2 times stiffness over natural frequency."""

_GRIPPER_STIFFNESS = 5000.0
"""Stiffness of the gripper servo [N/m]. The force limit is reached when the command is 8 mm inside the object."""

_GRIPPER_DAMPING = 60.0
"""Damping of the gripper servo [N s/m]. Critical damping for 0.115 kg per finger is 34. The larger value avoids
oscillation."""

_GRIPPER_FORCE_N = 40.0
"""Force of each pad [N].

The Franka Hand can hold 70 N continuously (data sheet), but in trials, 35 N already held round and flat objects.
"""

PANDA = RobotSpec(
    name="panda",
    title="Franka Emika Panda with Franka Hand",
    dataset_type="panda",
    source="franka_description (kinematics, limits); Gaz et al. 2019 (inertia); meshes of gymnasium-robotics",
    license="Apache-2.0 (Franka description and meshes), MIT (gymnasium-robotics)",
    arm_joints=tuple(f"joint{i}" for i in range(1, 8)),
    position_actuators=tuple(f"joint{i}_position" for i in range(1, 8)),
    velocity_actuators=tuple(f"joint{i}_velocity" for i in range(1, 8)),
    gripper_actuator="gripper",
    finger_joints=("finger_joint1", "finger_joint2"),
    finger_bodies=("left_finger", "right_finger"),
    pad_geoms=("left_pad", "right_pad"),
    hand_body="hand",
    arm_bodies=tuple(link.name for link in _LINKS),
    tcp_site="tcp",
    home_joints=(0.0, -0.528, 0.0, -2.722, 0.0, 2.194, 0.25 * math.pi),
    joint_low=(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    joint_high=(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    joint_velocity=(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    # Franka's limits are 87 N m (joints 1-4) and 12 N m (5-7). The large joints are limited to 50 N m here. This is
    # enough for their accelerations, but a blocked arm pushes less hard (Franka's examples stop the real arm at contact
    # torques of 20-40 N m).
    joint_effort=(50.0, 50.0, 50.0, 50.0, 12.0, 12.0, 12.0),
    gripper_opening_m=PANDA_OPENING_M,
    pad_size_m=(2.0 * PAD_HALF_SIZE[0], 2.0 * PAD_HALF_SIZE[2]),
    # The fingers are 58.4 mm below the hand frame and 54 mm long.
    tip_below_tcp_m=0.0584 + 0.054 - 0.1034,
    # Each finger moves at 50 mm/s (data sheet of the Franka Hand), so the opening width changes twice as fast.
    gripper_speed_m_s=0.1,
    gripper_force_n=_GRIPPER_FORCE_N,
    gripper_lead_m=0.012,
    control_rate_hz=PHYSICS.control_rate_hz,
    reach_m=0.855,
    jaw=ParallelJaw(PANDA_OPENING_M),
    action_spaces=tuple(ACTION_SPACES),
    ik=IKWeights(
        # The length of the gripper [m], so that position and rotation errors have the same effect at the wrist.
        orientation=0.3,
        # The posture cost displaces the tool by about the square of this number, 1 micrometer per rad.
        posture=1e-3,
        # The elbow returns to its posture by 5 % per step, and singular directions are damped.
        step_damping=2e-5,
        reach_damping=1e-6,
        rotation_slack_rad=0.0,
    ),
    posture_offsets=(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.2),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.2),
        (0.5, 0.4, 0.0, 0.4, 0.0, 0.3, 0.6),
        (-0.5, 0.4, 0.0, 0.4, 0.0, 0.3, -0.6),
        (0.0, 0.5, 0.5, -0.3, 0.5, 0.6, 0.0),
        (0.0, 0.5, -0.5, -0.3, -0.5, 0.6, 0.0),
    ),
    # The camera is placed like a depth camera mounted at the flange. In the hand frame, z points out between the
    # fingers (fingertips at about 0.11 m), y is the finger opening direction, and x points away from the robot when the
    # hand points down. The camera looks past the fingers at the object to grasp. With the hand pointing down, up in the
    # image is away from the robot and left is the robot's left.
    wrist_camera=CameraMount((0.068, 0.0, 0.020), (0.035, 0.0, 0.16), (1.0, 0.0, 0.0), 70.0),
    front_camera=None,
    workspace=Workspace(
        carry_heights_m=(0.22, 0.27, 0.32, 0.38),
        detours_m=(),
        lift_m=0.08,
        retreat_m=0.12,
        leave_m=0.05,
        check_step_m=0.03,
    ),
    # The center is the second joint (Franka's data sheet). A stretched arm cannot rotate, so 97 % of the reach is used.
    steering=SteeringLimits(
        center=(0.0, 0.0, 0.333), back_m=0.21, longest_m=0.97 * 0.855, nearest_m=0.20, highest_m=0.75
    ),
)

_PAINTS = {"shell": (0.93, 0.93, 0.92, 1.0), "trim": (0.80, 0.81, 0.82, 1.0), "dark": (0.16, 0.17, 0.18, 1.0)}

_SHARES = {
    "link0": 0.7,
    "link1": 1.0,
    "link2": 1.0,
    "link3": 1.0,
    "link4": 1.0,
    "link5": 1.0,
    "link6": 1.1,
    "link7": 1.6,
    "hand": 1.8,
    "finger": 4.0,
}


def _paint(link: str, rank: int) -> str:
    """Return the paint of a connected part of a link's mesh. ``rank`` is the rank of the part by size, largest first.

    The ranks were found by inspecting the parts, which are covers, connectors, buttons and rubber tips.
    """
    if rank == 0:
        return "trim" if link == "finger" else "shell"
    if link in {"link3", "link4"} and rank == 1:
        return "trim"
    if link == "link6" and rank <= 2:
        return "shell" if rank == 1 else "trim"
    if link == "hand" and rank == 0:
        return "shell"
    return "dark"


def build_panda(*, visuals: bool = True, progress: Progress | None = None) -> mujoco.MjSpec:
    """Return a new MuJoCo description of the Panda. Its physics is the same with and without visual meshes.

    The base is at the origin, with the mounting flange at ``z = 0``. Geoms in group 2 are visual, geoms in group 3
    collide.

    Raises:
        MissingDependencyError: If the package with the meshes is not installed.
    """
    spec = mujoco.MjSpec()
    spec.modelname = PANDA.name
    PHYSICS.set_solver(spec)
    for name, rgba in _PAINTS.items():
        spec.add_material(name=f"panda_{name}", rgba=rgba, specular=0.35, shininess=0.35)

    body = spec.worldbody
    bodies: dict[str, mujoco.MjsBody] = {}
    for index, link in enumerate(_LINKS):
        body = add_link(body, link, gravcomp=1.0)
        bodies[link.name] = body
        if index > 0:
            body.add_joint(
                name=PANDA.arm_joints[index - 1],
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=(0.0, 0.0, 1.0),
                range=(PANDA.joint_low[index - 1], PANDA.joint_high[index - 1]),
                armature=link.armature,
                # Limit on the total servo torque of this joint; gravity compensation is not included.
                actfrcrange=(-PANDA.joint_effort[index - 1], PANDA.joint_effort[index - 1]),
            )
    hand = add_link(body, _HAND, gravcomp=1.0)
    bodies["hand"] = hand
    hand.add_site(name=PANDA.tcp_site, pos=(0.0, 0.0, 0.1034), size=(0.004, 0.004, 0.004), group=4)
    _add_fingers(spec, hand)
    _add_servos(spec)
    _exclude_neighbors(spec)
    if visuals:
        _add_visuals(bodies, spec, progress)
    return spec


def _add_fingers(spec: mujoco.MjSpec, hand: mujoco.MjsBody) -> None:
    """Add both fingers with their pads. The fingers are coupled, so that an object stays in the center."""
    for index, name in enumerate(PANDA.finger_bodies):
        finger = add_link(hand, _FINGER, name, quaternion=about("z", index * math.pi), gravcomp=1.0)
        finger.add_joint(
            name=PANDA.finger_joints[index],
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=(0.0, 1.0, 0.0),
            range=(0.0, 0.5 * PANDA.gripper_opening_m),
            armature=_FINGER.armature,
            solref_limit=(0.004, 1.0),
        )
        finger.add_geom(
            name=PANDA.pad_geoms[index],
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=(0.0, PAD_HALF_SIZE[1], PAD_CENTER_Z),
            size=PAD_HALF_SIZE,
            friction=PAD_FRICTION,
            **FIRM,
            **COLLIDES,
        )
    spec.add_equality(
        name="finger_coupling",
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=PANDA.finger_joints[0],
        name2=PANDA.finger_joints[1],
        data=(0.0, 1.0) + (0.0,) * (mujoco.mjNEQDATA - 2),
        solref=(0.004, 1.0),
        solimp=(0.95, 0.99, 0.001, 0.5, 2.0),
    )


def _add_servos(spec: mujoco.MjSpec) -> None:
    """Add the joint servos, and a gripper servo that is controlled by the opening width [m] and moves both fingers."""
    add_joint_servos(
        spec,
        (PANDA.arm_joints, PANDA.position_actuators, PANDA.velocity_actuators),
        stiffness=SERVO_STIFFNESS,
        damping=SERVO_DAMPING,
        limits=tuple(zip(PANDA.joint_low, PANDA.joint_high, strict=True)),
    )
    width = spec.add_tendon(name="pad_distance")
    for joint in PANDA.finger_joints:
        width.wrap_joint(joint, 1.0)
    bias = (0.0, -_GRIPPER_STIFFNESS, -_GRIPPER_DAMPING)
    gripper = add_servo(spec, PANDA.gripper_actuator, "pad_distance", gain=_GRIPPER_STIFFNESS, bias=bias)
    gripper.trntype = mujoco.mjtTrn.mjTRN_TENDON
    gripper.ctrllimited = True
    # The range begins below zero, so that even the thinnest object is held with full force.
    gripper.ctrlrange = (-PANDA.gripper_lead_m, PANDA.gripper_opening_m)
    gripper.forcelimited = True
    gripper.forcerange = (-_GRIPPER_FORCE_N, _GRIPPER_FORCE_N)


def _exclude_neighbors(spec: mujoco.MjSpec) -> None:
    """Exclude collisions between bodies that always overlap.

    These are neighboring links. For the short wrist, they also include the links two joints away.
    """
    chain = [link.name for link in _LINKS] + [PANDA.hand_body]
    pairs = list(itertools.pairwise(chain))
    pairs += [("link5", "link7"), ("link6", PANDA.hand_body)]
    pairs += [(PANDA.hand_body, finger) for finger in PANDA.finger_bodies]
    pairs += [("link7", finger) for finger in PANDA.finger_bodies]
    for first, second in pairs:
        spec.add_exclude(name=f"{first}_{second}", bodyname1=first, bodyname2=second)


@functools.cache
def _visuals() -> tuple[MeshPart, ...]:
    return visual_parts(_SHARES, _paint, faces=FACE_BUDGET)


def _add_visuals(bodies: dict[str, mujoco.MjsBody], spec: mujoco.MjSpec, progress: Progress | None) -> None:
    """Add the decimated meshes to the bodies.

    Also add the rubber of the pads, which the meshes contain only in part.
    """
    fingers = [spec.body(name) for name in PANDA.finger_bodies]
    parts = _visuals() if progress is None else visual_parts(_SHARES, _paint, faces=FACE_BUDGET, progress=progress)
    for part in parts:
        mesh = spec.add_mesh(name=part.name)
        mesh.uservert = part.vertices.ravel()
        mesh.userface = part.faces.ravel()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        for number, body in enumerate(fingers if part.link == "finger" else [bodies[part.link]]):
            body.add_geom(
                name=f"{part.name}_visual{number}",
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=part.name,
                material=f"panda_{part.paint}",
                **SEEN,
            )
    for body in fingers:
        body.add_geom(
            name=f"{body.name}_pad_visual",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=(0.0, PAD_HALF_SIZE[1], PAD_CENTER_Z),
            size=np.array(PAD_HALF_SIZE),
            material="panda_dark",
            **SEEN,
        )


register_robot(PANDA, build_panda)
