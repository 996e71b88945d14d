"""Safety limits on motor commands: joint range, speed, lead, load and workspace.

The limits are applied in this order, so that no limit can violate an earlier limit:

1. A command that is not finite is replaced by the last command.
2. Each target is clipped to the range of its joint.
3. Each target is clipped to within ``lead`` of the measured position. A blocked joint then does not jump when it is
   released, and the arm moves only a little farther if the program is killed.
4. A joint whose load is above the maximum keeps its last command. The gripper may still open.
5. The step from the last command is scaled down to the maximum speed, all arm joints by the same factor.
6. The step is shortened until the tool center point is inside the workspace. Its position is computed by the forward
   kinematics of the simulated arm.

If a joint is overloaded or does not follow its command for some time, :class:`LimitError` is raised and the trial is
aborted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from betterbench.errors import BetterError, InvalidInputError
from betterbench.interface.actions import SO101_MOTORS, ActionSpace
from betterbench.json_form import strict_form
from betterbench.sim.robots import ArmIK, robot
from betterbench.sim.robots.ik import LIMIT_MARGIN_RAD

ROBOT = "so101"
_ARM = slice(0, 5)
_GRIPPER = 5
_FRACTIONS = (1.0, 0.75, 0.5, 0.25)
"""Fractions to which a step is shortened, tried in turn, if the full step would leave the workspace."""


class LimitError(BetterError):
    """Error for a motor that is overloaded or does not follow its command. A person must check the arm."""


@strict_form
@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Safety limits of an SO-101, in units that are independent of the unit in the plan.

    Attributes:
        speed_rad_s: Maximum speed of each arm joint [rad/s]. The simulated servos reach 3 rad/s.
        gripper_speed: Maximum speed of the gripper, in percent of its travel per second.
        lead_s: Maximum distance of a target from the measured position, given as the time that the joint takes for this
            distance at maximum speed [s].
        load: Maximum load, as a fraction of the load that the motor can carry.
        load_s: Maximum time for which an arm joint may be overloaded [s].
        stall_rad: An arm joint that lags behind its command by more than this angle is considered stalled [rad].
        stall_s: Maximum time for which a joint may be stalled [s].
        box_low: Lower corner of the workspace of the tool center point, in the base frame [m]: x ahead, y left, z up
            from the table.
        box_high: Upper corner of the workspace, in the base frame [m].
        watchdog_s: Time without an answer from the policy after which the arm holds its measured position [s].
    """

    speed_rad_s: float = 1.5
    gripper_speed: float = 150.0
    lead_s: float = 0.25
    load: float = 0.85
    load_s: float = 0.5
    stall_rad: float = 0.2
    stall_s: float = 0.6
    box_low: tuple[float, float, float] = (0.04, -0.36, 0.008)
    box_high: tuple[float, float, float] = (0.44, 0.36, 0.36)
    watchdog_s: float = 0.5

    def __post_init__(self) -> None:
        """Raise InvalidInputError if a limit is not positive, or the workspace is empty."""
        for name in ("speed_rad_s", "gripper_speed", "lead_s", "load", "load_s", "stall_rad", "stall_s", "watchdog_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InvalidInputError(
                    f"limits: {name}", f"expected a positive number, got {value}", "Correct the limit"
                )
        if not all(low < high for low, high in zip(self.box_low, self.box_high, strict=True)):
            raise InvalidInputError(
                "limits: box", f"{self.box_low} is not below {self.box_high}", "Set box_low below box_high"
            )

    def to_json(self) -> dict[str, Any]:
        """Return the limits as a JSON-serializable dict."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False)
class Limited:
    """Command (6,) to which all limits were applied, and the names of the limits that changed it."""

    command: np.ndarray
    by: tuple[str, ...]


class Limiter:
    """Applies the limits to the commands of one episode. Call :meth:`start` before the first command."""

    def __init__(self, limits: SafetyLimits, space: ActionSpace, *, rate_hz: float) -> None:
        """Convert the limits to the units of an action space, for a given control rate [Hz]."""
        spec = robot(ROBOT)
        self.limits, self.space = limits, space
        self._ik = ArmIK(spec)
        self._unit = np.array(space.scale[:5])  # radians per unit
        margin = LIMIT_MARGIN_RAD
        low = np.array([v + margin for v in spec.joint_low]) / self._unit
        high = np.array([v - margin for v in spec.joint_high]) / self._unit
        self.low = np.maximum(np.array([*low, 0.0]), space.low)
        """(6,) lowest allowed command."""
        self.high = np.minimum(np.array([*high, 100.0]), space.high)
        """(6,) highest allowed command."""
        speed = np.array([*(limits.speed_rad_s / self._unit), limits.gripper_speed])
        self.most_step = speed / rate_hz
        """(6,) maximum step between two commands."""
        self._lead = np.maximum(speed * limits.lead_s, 2.0 * self.most_step)
        self._stall = limits.stall_rad / self._unit
        self._period_s = 1.0 / rate_hz
        self._last = np.zeros(6)
        self._over_s, self._stalled_s = np.zeros(5), np.zeros(5)
        self._is_started = False

    def start(self, state: np.ndarray) -> None:
        """Start an episode at a measured state (6,).

        Raises:
            LimitError: If the state is not finite.
        """
        if not np.isfinite(state).all():
            raise LimitError(
                f"The arm reports no finite position for {_named(~np.isfinite(state))}. Check its bus and cables."
            )
        # An arm resting against a mechanical stop may be slightly outside its range.
        self._last = np.clip(state, self.low, self.high)
        self._over_s[:], self._stalled_s[:] = 0.0, 0.0
        self._is_started = True

    @property
    def last(self) -> np.ndarray:
        """Last command (6,)."""
        return self._last.copy()

    def tool(self, positions: Sequence[float] | np.ndarray) -> np.ndarray:
        """Return the position (3,) of the tool center point in the base frame [m], for given motor positions."""
        return np.array(self._ik.forward(np.asarray(positions)[_ARM] * self._unit).position)

    def limit(self, asked: np.ndarray, state: np.ndarray, load: np.ndarray) -> Limited:
        """Return the command to send for a requested target (6,), given the measured state (6,) and load (6,).

        Raises:
            LimitError: If the measured state is not finite, or a joint is overloaded or lags behind its command for too
                long.
        """
        if not self._is_started:
            raise InvalidInputError("limits", "start was not called", "Call start with the measured state")
        if not np.isfinite(state).all():
            raise LimitError(
                f"The arm reports no finite position for {_named(~np.isfinite(state))}. Check its bus and cables."
            )
        self._watch(state, load)
        by = []
        if np.shape(asked) == (6,) and np.isfinite(asked).all():
            wanted = np.asarray(asked, dtype=np.float64)
        else:
            by.append("not finite")
            wanted = self._last
        for name, low, high in (("range", self.low, self.high), ("lead", state - self._lead, state + self._lead)):
            clipped = np.clip(wanted, low, high)
            if (clipped != wanted).any():
                by.append(name)
            wanted = clipped
        wanted = np.clip(wanted, self.low, self.high)  # a state outside the range
        over = np.abs(np.nan_to_num(load)) > self.limits.load
        if over.any():
            by.append("load")
            kept = np.where(over, self._last, wanted)
            kept[_GRIPPER] = max(wanted[_GRIPPER], self._last[_GRIPPER]) if over[_GRIPPER] else wanted[_GRIPPER]
            wanted = kept
        step = wanted - self._last
        scaled = self._scaled(step)
        if (scaled != step).any():
            by.append("speed")
        command = self._last + self._inside(scaled, by)
        # rounding of the sum may exceed the range slightly
        self._last = np.clip(command, self.low, self.high)
        return Limited(self._last.copy(), tuple(by))

    def _scaled(self, step: np.ndarray) -> np.ndarray:
        """Return a step that is scaled down to the maximum speed. All arm joints are scaled by the same factor."""
        ratio = float(np.max(np.abs(step[_ARM]) / self.most_step[_ARM]))
        arm = step[_ARM] / ratio if ratio > 1.0 else step[_ARM]
        most = self.most_step[_GRIPPER]
        return np.array([*arm, min(max(step[_GRIPPER], -most), most)])

    def _inside(self, step: np.ndarray, by: list[str]) -> np.ndarray:
        """Return the largest fraction of a step that stays in the workspace.

        If the arm is outside the workspace, return the largest fraction that brings it closer.
        """
        before = self._outside(self._last)
        for fraction in _FRACTIONS:
            part = np.array([*(fraction * step[_ARM]), step[_GRIPPER]])
            there = self._outside(self._last + part)
            if there == 0.0 or there < before:
                if fraction < 1.0:
                    by.append("workspace")
                return part
        if np.any(step[_ARM]):
            by.append("workspace")
        return np.array([*np.zeros(5), step[_GRIPPER]])

    def _outside(self, positions: np.ndarray) -> float:
        """Return the distance of the tool center point from the workspace [m]; 0 if it is inside."""
        tool = self.tool(positions)
        beyond = np.maximum(
            np.maximum(np.array(self.limits.box_low) - tool, tool - np.array(self.limits.box_high)), 0.0
        )
        return float(np.linalg.norm(beyond))

    def _watch(self, state: np.ndarray, load: np.ndarray) -> None:
        """Raise LimitError if an arm joint was overloaded, or did not follow its command, for too long."""
        over = np.abs(np.nan_to_num(load[_ARM])) > self.limits.load
        lagging = np.abs(self._last - state)[_ARM] > self._stall
        self._over_s = np.where(over, self._over_s + self._period_s, 0.0)
        self._stalled_s = np.where(lagging, self._stalled_s + self._period_s, 0.0)
        if (self._over_s > self.limits.load_s).any():
            joint = int(np.argmax(self._over_s))
            lasted = self._over_s[joint]
            text = f"{SO101_MOTORS[joint]} carried {abs(load[joint]):.0%} of its maximum load for {lasted:.1f} s"
            raise LimitError(f"{text}; the limit is {self.limits.load:.0%}. Free the arm, and let it cool down.")
        if (self._stalled_s > self.limits.stall_s).any():
            joint = int(np.argmax(self._stalled_s))
            lag, lasted = abs(self._last[joint] - state[joint]), self._stalled_s[joint]
            text = f"{SO101_MOTORS[joint]} does not follow its command: it has been {lag:.0f} behind for {lasted:.1f} s"
            raise LimitError(f"{text}. Check that nothing blocks the joint, and check its cable and power.")


def _named(mask: np.ndarray) -> str:
    """Return the names of the motors selected by a mask."""
    return ", ".join(name for name, marked in zip(SO101_MOTORS, mask, strict=True) if marked)
