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
"""Attributes of a collision geom, whose inertia comes from its link."""

SEEN: dict[str, Any] = {"group": VISUAL_GROUP, "contype": 0, "conaffinity": 0, "mass": 0.0}
"""Attributes of a visual geom."""


FIRM: dict[str, Any] = {
    "solref": (0.006, 1.0),
    "solimp": (0.95, 0.99, 0.001, 0.5, 2.0),
    "solmix": 50.0,
}
"""Contact of a finger pad: time constant [s] (three physics steps: firm rubber), damping ratio and impedance.

MuJoCo's default time constant of 20 ms lets a pad sink 1.3 mm into an object at full force. ``solmix`` is the weight of
the pad's parameters against the object's. Unlike a higher priority it keeps the larger friction.
"""


@dataclass(frozen=True, slots=True)
class Shape:
    """A collision primitive in the frame of its link [m].

    A "capsule" or "cylinder" goes from ``start`` to ``end``. A "box" has its center at ``start`` and ``end`` as its
    half extents, and is rotated by ``turn``: an axis of the link and an angle [rad].
    """

    kind: str
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float = 0.0
    turn: tuple[str, float] = ("x", 0.0)


@dataclass(frozen=True, slots=True)
class Link:
    """Link, with its pose in its parent, its inertia and its collision shapes.

    Attributes:
        name: Body name.
        position: Joint origin in the parent link [m].
        quaternion: Rotation of the link in its parent at zero joint angle. It need not have unit length.
        mass: Mass [kg].
        com: Center of mass in the link frame [m].
        inertia: xx, yy, zz, xy, xz, yz about the center of mass, in link axes [kg m2].
        shapes: Collision primitives.
        armature: Reflected rotor inertia of the link's joint [kg m2], or moving mass of a slide [kg], or 0 for a link
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
    """Return the rotation by an angle [rad] about the axis "x", "y" or "z"."""
    cos, sin = math.cos(0.5 * angle), math.sin(0.5 * angle)
    return (cos, sin * (axis == "x"), sin * (axis == "y"), sin * (axis == "z"))


def add_link(
    parent: mujoco.MjsBody, link: Link, name: str = "", *, quaternion: Quaternion | None = None, gravcomp: float = 0.0
) -> mujoco.MjsBody:
    """Add a link's body with inertia and collision shapes.

    Args:
        parent: Body to which the link is attached.
        link: Description of the link.
        name: Body name. By default, the link's name.
        quaternion: Rotation in the parent. By default, the link's rotation.
        gravcomp: Share of its weight that the robot's own controller compensates.
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
    """Add one collision primitive to a body. ``contact`` are further attributes of the geom."""
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
    """Add a servo to a joint with a force of ``gain`` times the control, plus ``bias`` times (1, length, velocity)."""
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
    """Add the two servos of each arm joint, both controlled by the joint's reference velocity [rad/s].

    The first integrates it to a reference position (its activation) and pulls with the stiffness. The second damps
    toward the reference velocity itself. The reference therefore moves evenly within a control step, and a moving arm
    does not lag by damping over stiffness, as it does with a position servo.

    Args:
        spec: Model.
        names: Names of the joints, of the position servos and of the velocity servos.
        stiffness: Position gain per joint [N m/rad].
        damping: Velocity gain per joint [N m s/rad].
        limits: Range of the reference position per joint [rad].
    """
    for joint, position, velocity, kp, kv, (low, high) in zip(*names, stiffness, damping, limits, strict=True):
        servo = add_servo(spec, position, joint, gain=kp, bias=(0.0, -kp, 0.0))
        servo.dyntype = mujoco.mjtDyn.mjDYN_INTEGRATOR
        servo.actlimited = True
        servo.actrange = (low, high)
        add_servo(spec, velocity, joint, gain=kv, bias=(0.0, 0.0, -kv))
