"""Arm with safety limits and a software switch. Every motor command goes through this module.

Nothing is sent unless the switch is on. Any thread may stop the arm. When :meth:`SafeArm.stop` returns, the arm has
been commanded to hold its measured position. No further command is sent until the switch is turned on again.
"""

from __future__ import annotations

import logging
import threading

import numpy as np

from betterbench.errors import BetterError
from betterbench.real.limits import Limited, Limiter
from betterbench.real.robots.robot import Reading, Robot, RobotError

logger = logging.getLogger(__name__)


class NotArmedError(BetterError):
    """Error for a motion that was requested while the software switch of the arm was off."""


class SafeArm:
    """Robot that moves only within the safety limits, and only while its software switch is on."""

    def __init__(self, robot: Robot, limiter: Limiter) -> None:
        """Wrap a robot. The switch is off at first."""
        self.robot, self.limiter = robot, limiter
        self._lock = threading.RLock()
        self._is_armed, self._why = False, "the switch was never turned on"
        self._state: np.ndarray | None = None
        self._has_moved = False

    @property
    def is_armed(self) -> bool:
        """Whether the switch is on."""
        return self._is_armed

    @property
    def why_off(self) -> str:
        """Reason why the switch is off; empty if it is on."""
        return "" if self._is_armed else self._why

    def arm(self) -> None:
        """Turn the switch on. The arm does not move until it receives a command."""
        with self._lock:
            self._is_armed, self._why = True, ""

    def stop(self, why: str) -> None:
        """Turn the switch off, and command the arm to hold its last measured position."""
        # set before taking the lock, so that a command waiting for the lock is rejected
        self._is_armed, self._why = False, why
        with self._lock:
            self._is_armed, self._why = False, why
            if not self._has_moved or self._state is None:
                return
            self._has_moved = False
            try:
                self.robot.command(np.clip(self._state, self.limiter.low, self.limiter.high))
            except RobotError as problem:
                logger.warning("the command to hold the position could not be sent: %s", problem)

    def release(self) -> None:
        """Turn off the switch and the motor torque, so that the arm sinks."""
        self.stop("the torque was switched off")
        with self._lock:
            self.robot.release()

    def read(self) -> Reading:
        """Read the state of the robot. Raise RobotError if the robot cannot be read."""
        with self._lock:
            reading = self.robot.read()
            if np.isfinite(reading.state).all():
                self._state = reading.state.copy()
            return reading

    def begin(self, reading: Reading) -> None:
        """Start an episode at the measured state of a reading. Raise LimitError if the state is not finite."""
        with self._lock:
            self.limiter.start(reading.state)

    def move(self, asked: np.ndarray, reading: Reading) -> Limited:
        """Apply the limits to a target position, send the resulting command, and return it.

        Raises:
            NotArmedError: If the switch is off.
            LimitError: If the arm is overloaded or does not follow. The switch is then turned off.
            RobotError: If the robot cannot be reached.
        """
        with self._lock:
            if not self._is_armed:
                raise NotArmedError(f"The arm does not move: {self._why}. Turn its switch on.")
            try:
                limited = self.limiter.limit(asked, reading.state, reading.load)
            except BetterError as problem:
                self.stop(str(problem))
                raise
            self._has_moved = True
            self.robot.command(limited.command)
            return limited
