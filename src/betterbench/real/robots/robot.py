"""Interface between the loop and a robot: positions of six motors, their load, and camera images with their times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from betterbench.errors import BetterError
from betterbench.real.plan import PlannedTrial


class RobotError(BetterError):
    """The robot cannot be reached or read; the message says which part, and what to check. The trial is aborted."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Camera image, upright RGB (height, width, 3) uint8, and the time of its arrival on the robot's clock [s]."""

    image: np.ndarray
    time_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """State of the robot.

    Attributes:
        time_s: Time of the reading on the robot's clock [s].
        state: (6,) measured positions in the unit of the plan; gripper 0 closed to 100 open.
        load: (6,) signed load as a fraction of the maximum; NaN if unknown.
        frames: Newest image of each camera.
    """

    time_s: float
    state: np.ndarray
    load: np.ndarray
    frames: Mapping[str, Frame]


class Robot(Protocol):
    """A follower arm with cameras. Only :class:`~betterbench.real.arm.SafeArm` sends it commands."""

    @property
    def name(self) -> str:
        """Name in the records."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras; the first one shows the whole scene."""

    def connect(self) -> None:
        """Open the connection. The arm does not move. Raises RobotError or MissingDependencyError."""

    def now(self) -> float:
        """Return the time on the robot's clock [s], which only increases."""

    def set_up(self, trial: PlannedTrial) -> None:
        """Set up the scene of a trial, if the robot is simulated; a person does it for a real one."""

    def read(self) -> Reading:
        """Return the state. Raises RobotError."""

    def command(self, positions: np.ndarray) -> None:
        """Send target positions, (6,), in the unit of the plan. Raises RobotError."""

    def release(self) -> None:
        """Switch the torque of all motors off. The arm sinks. Raises RobotError."""

    def disconnect(self) -> None:
        """Close the connection and leave the arm where it is. Disconnecting it again is harmless."""
