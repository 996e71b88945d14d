"""Robots: their descriptions, their inverse kinematics, and the controller that turns actions into motion.

Each robot is a folder next to this file. The ``__init__`` module of the folder registers the robot. New folders are
found automatically. The controller and the inverse kinematics are imported when they are first used, because rendering
needs neither of them.
"""

import importlib
import pkgutil
from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names
from betterbench.sim.graphics import require_engine

require_engine()  # MuJoCo reads these variables when it is imported, and its own error would not name a remedy

from betterbench.sim.robots.panda import PANDA  # noqa: E402
from betterbench.sim.robots.spec import (  # noqa: E402
    Progress,
    RobotSpec,
    build_robot_spec,
    motor_positions,
    register_robot,
    robot,
    robot_names,
    robot_of_space,
    robot_space,
)

for _found in pkgutil.iter_modules(__path__):
    if _found.ispkg:
        importlib.import_module(f"{__name__}.{_found.name}")

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
    "motor_positions",
    "register_robot",
    "robot",
    "robot_names",
    "robot_of_space",
    "robot_space",
]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(__name__, {"control": ("ArmController", "ControllerState"), "ik": ("ArmIK", "IKResult")})
