"""Robot interface of the control loop: positions and loads of six motors, and timestamped camera images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from betterbench.errors import BetterError
from betterbench.real.plan import PlannedTrial


class RobotError(BetterError):
    """Error for a robot that cannot be reached or read. It aborts the trial.

    The message names the part and what to check.
    """


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Camera image, upright RGB (height, width, 3) uint8, with its arrival time on the robot's clock [s]."""

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
    """Follower arm with cameras. Only :class:`~betterbench.real.arm.SafeArm` may send commands to it."""

    @property
    def name(self) -> str:
        """Name in the records."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """Camera names; the first camera shows the whole scene."""

    def connect(self) -> None:
        """Open the connection without moving the arm. Raises RobotError or MissingDependencyError."""

    def now(self) -> float:
        """Return the time on the robot's monotonic clock [s]."""

    def set_up(self, trial: PlannedTrial) -> None:
        """Set up the scene of a trial on a simulated robot; on a real robot, a person does this."""

    def read(self) -> Reading:
        """Return the state. Raises RobotError."""

    def command(self, positions: np.ndarray) -> None:
        """Send target positions, (6,), in the unit of the plan. Raises RobotError."""

    def release(self) -> None:
        """Switch off the torque of all motors; the arm sinks. Raises RobotError."""

    def disconnect(self) -> None:
        """Close the connection and leave the arm where it is. It is safe to call this more than once."""
