"""Parts of robot models: links with primitive collision shapes, and joint servos that follow a moving reference."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import mujoco

from betterbench.geometry import Quaternion
from betterbench.sim.robots.physics import PHYSICS

VISUAL_GROUP = 2
COLLISION_GROUP = 3

COLLIDES: dict[str, Any] = {
    "group": COLLISION_GROUP,
    "mass": 0.0,
    "condim": PHYSICS.condim,
    "rgba": (0.9, 0.4, 0.1, 0.5),
}
"""Attributes of a collision geom. It has no mass, because the mass and inertia are given for the whole link."""

SEEN: dict[str, Any] = {"group": VISUAL_GROUP, "contype": 0, "conaffinity": 0, "mass": 0.0}
"""Attributes of a visual geom, which neither collides nor has mass."""


FIRM: dict[str, Any] = {
    "solref": (0.006, 1.0),
    "solimp": (0.95, 0.99, 0.001, 0.5, 2.0),
    "solmix": 50.0,
}
"""Contact parameters of a finger pad, which behaves like firm rubber.

The parameters are the time constant [s] (three physics steps), the damping ratio and the impedance.

With MuJoCo's default time constant of 20 ms, a pad would sink 1.3 mm into an object at full force. ``solmix`` is the
weight of the pad's parameters relative to those of the object. Unlike a higher priority, it keeps the larger of the two
friction coefficients.
"""


@dataclass(frozen=True, slots=True)
class Shape:
    """Collision primitive in the frame of its link [m].

    A "capsule" or "cylinder" extends from ``start`` to ``end``. A "box" has its center at ``start``, and ``end``
    contains its half extents. The box is rotated by ``turn``, which consists of an axis of the link frame and an angle
    [rad].
    """

    kind: str
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float = 0.0
    turn: tuple[str, float] = ("x", 0.0)


@dataclass(frozen=True, slots=True)
class Link:
    """Link of a robot: its pose in its parent, its inertia and its collision shapes.

    Attributes:
        name: Body name.
        position: Joint origin in the parent link [m].
        quaternion: Rotation of the link in its parent at zero joint angle. It need not have unit length.
        mass: Mass [kg].
        com: Center of mass in the link frame [m].
        inertia: Components xx, yy, zz, xy, xz, yz of the inertia about the center of mass, in link axes [kg m2].
        shapes: Collision primitives.
        armature: Reflected rotor inertia of the link's joint [kg m2], moving mass of a slide [kg], or 0 for a link
            without a joint.
    """

    name: str
    position: tuple[float, float, float]
    quaternion: Quaternion
    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]
    shapes: tuple[Shape, ...]
    armature: float = 0.0


def about(axis: str, angle: float) -> Quaternion:
    """Return the quaternion of a rotation by an angle [rad] about the axis "x", "y" or "z"."""
    cos, sin = math.cos(0.5 * angle), math.sin(0.5 * angle)
    return (cos, sin * (axis == "x"), sin * (axis == "y"), sin * (axis == "z"))


def add_link(
    parent: mujoco.MjsBody, link: Link, name: str = "", *, quaternion: Quaternion | None = None, gravcomp: float = 0.0
) -> mujoco.MjsBody:
    """Add the body of a link, with its inertia and its collision shapes.

    Args:
        parent: Body to which the link is attached.
        link: Description of the link.
        name: Body name. By default, the link's name.
        quaternion: Rotation in the parent. By default, the link's rotation.
        gravcomp: Fraction of the link's weight that the robot's own controller compensates.
    """
    body = parent.add_body(
        name=name or link.name,
        pos=link.position,
        quat=quaternion or link.quaternion,
        mass=link.mass,
        ipos=link.com,
        fullinertia=link.inertia,
        explicitinertial=True,
        gravcomp=gravcomp,
    )
    for number, shape in enumerate(link.shapes):
        add_shape(body, shape, f"{name or link.name}_collision{number}")
    return body


def add_shape(
    body: mujoco.MjsBody, shape: Shape, name: str, contact: Mapping[str, Any] = MappingProxyType({})
) -> mujoco.MjsGeom:
    """Add a collision primitive to a body. ``contact`` contains further attributes of the geom."""
    if shape.kind == "box":
        axis, angle = shape.turn
        turn = about(axis, angle) if angle else (1.0, 0.0, 0.0, 0.0)
        box = mujoco.mjtGeom.mjGEOM_BOX
        return body.add_geom(name=name, type=box, pos=shape.start, size=shape.end, quat=turn, **COLLIDES, **contact)
    kind = mujoco.mjtGeom.mjGEOM_CAPSULE if shape.kind == "capsule" else mujoco.mjtGeom.mjGEOM_CYLINDER
    size, ends = (shape.radius, 0.0, 0.0), (*shape.start, *shape.end)
    return body.add_geom(name=name, type=kind, fromto=ends, size=size, **COLLIDES, **contact)


def add_servo(
    spec: mujoco.MjSpec, name: str, target: str, *, gain: float, bias: tuple[float, float, float]
) -> mujoco.MjsActuator:
    """Add a servo to a joint. Its force is ``gain`` times the control plus ``bias`` times (1, length, velocity)."""
    servo = spec.add_actuator(name=name, target=target, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    servo.gainprm[0] = gain
    servo.biasprm[:3] = bias
    return servo


def add_joint_servos(
    spec: mujoco.MjSpec,
    names: tuple[Sequence[str], Sequence[str], Sequence[str]],
    *,
    stiffness: Sequence[float],
    damping: Sequence[float],
    limits: Sequence[tuple[float, float]],
) -> None:
    """Add two servos to each arm joint. Both are controlled by the joint's reference velocity [rad/s].

    The first servo integrates this velocity to a reference position (its activation) and pulls the joint toward it with
    the stiffness. The second servo damps the joint toward the reference velocity itself. The reference therefore moves
    evenly within a control step, and a moving arm does not lag behind its reference. With a position servo alone, it
    would lag by its speed times damping divided by stiffness.

    Args:
        spec: Model to which the servos are added.
        names: Names of the joints, of the position servos and of the velocity servos.
        stiffness: Position gain of each joint [N m/rad].
        damping: Velocity gain of each joint [N m s/rad].
        limits: Range of each joint's reference position [rad].
    """
    for joint, position, velocity, kp, kv, (low, high) in zip(*names, stiffness, damping, limits, strict=True):
        servo = add_servo(spec, position, joint, gain=kp, bias=(0.0, -kp, 0.0))
        servo.dyntype = mujoco.mjtDyn.mjDYN_INTEGRATOR
        servo.actlimited = True
        servo.actrange = (low, high)
        add_servo(spec, velocity, joint, gain=kv, bias=(0.0, 0.0, -kv))
