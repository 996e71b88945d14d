"""Gripper of a robot without its arm, carried by three stiff slides. It is used to test grasps of a single object."""

from __future__ import annotations

import mujoco

from betterbench.geometry import Pose, normalize, vector_of
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.robots.spec import RobotSpec, build_robot_spec, robot

CARRIER_JOINTS = ("carrier_x", "carrier_y", "carrier_z")
"""Slides of the carrier along the world axes [m]. Actuators with the same names set the positions of the slides."""
TOOL_BODY = "tool"
"""Body whose frame is that of the tool center point. Its orientation (``body_quat``) may be set before a trial."""

PREFIX = "robot_"
"""Prefix of the names of the robot's own bodies, geoms, joints and actuators."""

_STIFFNESS = 20_000.0
"""Position gain of a slide [N/m].

A mass of 1 kg sags by half a millimeter, less than it would on a gravity-compensated arm.
"""
_DAMPING = 400.0
"""Velocity gain of a slide [N s/m]. It is above critical damping for a gripper and an object of 2 kg together."""
_ARMATURE_KG = 1.0


def add_floating_gripper(spec: mujoco.MjSpec, name: str = USUAL_ROBOT) -> RobotSpec:
    """Add a robot's gripper (fingers, pads, coupling and servo) to a model, on a carrier with three slides.

    The tool center point is at the position of the carrier, with the orientation of the body ``tool``. Returns the
    description of the robot.

    Raises:
        UnknownNameError: If there is no robot with this name.
    """
    known = robot(name)
    arm = build_robot_spec(name, visuals=False)
    PHYSICS.set_solver(spec)  # MuJoCo warns if the attached model has different options
    carrier = spec.worldbody.add_body(name="carrier", gravcomp=1.0)
    carrier.mass, carrier.inertia, carrier.explicitinertial = 0.1, (1e-4, 1e-4, 1e-4), True
    tool = carrier.add_body(name=TOOL_BODY)
    site = arm.site(known.tcp_site)
    T_tool_hand = Pose(vector_of(site.pos), normalize(site.quat)).inverse()
    hand = tool.add_frame().attach_body(arm.body(known.hand_body), PREFIX, "")
    hand.pos, hand.quat = T_tool_hand.position, T_tool_hand.quaternion
    for joint, axis in zip(CARRIER_JOINTS, ((1, 0, 0), (0, 1, 0), (0, 0, 1)), strict=True):
        carrier.add_joint(name=joint, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, armature=_ARMATURE_KG)
        servo = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        servo.gainprm[0] = _STIFFNESS
        servo.biasprm[:3] = (0.0, -_STIFFNESS, -_DAMPING)
    return known
