"""Robots: their description, their inverse kinematics and the controller that turns actions into motion."""

from betterbench.robots.control import ArmController, ControllerState
from betterbench.robots.ik import ArmIK, IKResult
from betterbench.robots.panda import PANDA
from betterbench.robots.spec import Progress, RobotSpec, build_robot_spec, robot, robot_names

__all__ = [
    "PANDA",
    "ArmController",
    "ArmIK",
    "ControllerState",
    "IKResult",
    "Progress",
    "RobotSpec",
    "build_robot_spec",
    "robot",
    "robot_names",
]
