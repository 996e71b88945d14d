"""Interface through which the control loop uses a robot: six motors with loads, and timestamped camera images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from betterbench.errors import BetterError
from betterbench.real.plan import PlannedTrial


class RobotError(BetterError):
    """Error for a robot that cannot be reached or read. It aborts the trial.

    The message names the part that failed, and states what to check.
    """


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Camera image with its arrival time.

    Attributes:
        image: Upright RGB image, (height, width, 3) uint8.
        time_s: Arrival time on the robot's clock [s].
    """

    image: np.ndarray
    time_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """State of the robot at one time.

    Attributes:
        time_s: Time of the reading on the robot's clock [s].
        state: (6,) measured positions in the unit of the plan; the gripper is 0 if closed and 100 if open.
        load: (6,) signed load as a fraction of the maximum; NaN if unknown.
        frames: Newest image of each camera, by camera name.
    """

    time_s: float
    state: np.ndarray
    load: np.ndarray
    frames: Mapping[str, Frame]


class Robot(Protocol):
    """Follower arm with cameras. Only :class:`~betterbench.real.arm.SafeArm` may send commands to it."""

    @property
    def name(self) -> str:
        """Name of the robot in the records."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """Camera names. The first camera shows the whole scene."""

    def connect(self) -> None:
        """Open the connection without moving the arm. Raise RobotError or MissingDependencyError if this fails."""

    def now(self) -> float:
        """Return the time on the robot's monotonic clock [s]."""

    def set_up(self, trial: PlannedTrial) -> None:
        """Set up the scene of a trial on a simulated robot. On a real robot, a person does this."""

    def read(self) -> Reading:
        """Read the state of the robot. Raise RobotError if it cannot be read."""

    def command(self, positions: np.ndarray) -> None:
        """Send target positions (6,) in the unit of the plan. Raise RobotError if the robot does not answer."""

    def release(self) -> None:
        """Switch off the torque of all motors, so that the arm sinks. Raise RobotError if a motor does not answer."""

    def disconnect(self) -> None:
        """Close the connection and leave the arm where it is. It is safe to call this method more than once."""
