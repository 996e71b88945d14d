"""Robots: their description, their inverse kinematics and the controller that turns actions into motion.

The controller and the inverse kinematics are imported when they are first used: who only draws needs neither.
"""

import importlib
from typing import TYPE_CHECKING

from betterbench.sim.graphics import require_engine

require_engine()  # MuJoCo reads these variables when it is imported, and its error would name no cure

from betterbench.sim.robots.panda import PANDA  # noqa: E402
from betterbench.sim.robots.spec import Progress, RobotSpec, build_robot_spec, robot, robot_names  # noqa: E402

if TYPE_CHECKING:
    from betterbench.sim.robots.control import ArmController, ControllerState
    from betterbench.sim.robots.ik import ArmIK, IKResult

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

_HOMES = {"ArmController": "control", "ControllerState": "control", "ArmIK": "ik", "IKResult": "ik"}


def __getattr__(name: str) -> object:
    """Import the module of a name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
