"""Steering: the action of one control step toward a tool target, within reach and at a limited speed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from betterbench.geometry import Pose, angle_between, distance, normalize, straight_way
from betterbench.policies.experts.motion import FREE, delta_action
from betterbench.sim.robots import RobotSpec

LOWEST_TIP_M = 0.002
"""Minimum height of the fingertips above the table that the operator can command [m]."""
SHOULDER_HEIGHT_M = 0.333
"""Height of the Panda's second joint above its base [m] (Franka's data sheet), from which the reach is measured."""
FLANGE_TO_TOOL_M = 0.21
"""Distance between the tool center point and the flange [m], which reduces the reach when the tool points down."""
REACH_SHARE = 0.97
"""Share of the full reach that the operator can command, because a fully stretched arm cannot rotate."""
NEAREST_M = 0.20
"""Minimum horizontal distance from the base axis [m], below which the arm would hit itself."""
HIGHEST_M = 0.75
"""Largest height of the tool [m]."""
SLOWEST = 0.1
"""Minimum fraction of the full speed."""
OUT_OF_REACH = "out of reach: the arm goes as far as it can"
IN_THE_TABLE = "below the table: the fingers stop above it"


@dataclass(frozen=True, slots=True)
class Reach:
    """Limits of the poses to which a robot's tool may be sent.

    Attributes:
        longest_m: Largest distance of the flange from the shoulder [m].
        lowest_m: Minimum height of the tool center point above the table with the tool pointing down [m].
    """

    longest_m: float
    lowest_m: float

    @classmethod
    def of(cls, spec: RobotSpec) -> Reach:
        """Return the reach of a robot."""
        return cls(REACH_SHARE * spec.reach_m, spec.tip_below_tcp_m + LOWEST_TIP_M)

    def within(self, wanted: Pose) -> tuple[Pose, str]:
        """Return the nearest allowed pose, and the reason for a difference ("" if there is none)."""
        position, why = np.array(wanted.position), ""
        if position[2] < self.lowest_m:
            position[2], why = self.lowest_m, IN_THE_TABLE
        shoulder = np.array([0.0, 0.0, SHOULDER_HEIGHT_M])
        back = Pose((0.0, 0.0, 0.0), wanted.quaternion).apply((0.0, 0.0, -FLANGE_TO_TOOL_M))
        arm = position + np.array(back) - shoulder
        length = float(np.linalg.norm(arm))
        if length > self.longest_m:
            position, why = shoulder + arm * (self.longest_m / length) - np.array(back), OUT_OF_REACH
            position[2] = max(position[2], self.lowest_m)
        across = float(np.hypot(position[0], position[1]))
        if across < NEAREST_M:
            out = position[:2] / across if across > 1e-6 else np.array([1.0, 0.0])
            position[:2], why = NEAREST_M * out, OUT_OF_REACH
        if position[2] > HIGHEST_M:
            position[2], why = HIGHEST_M, OUT_OF_REACH
        x, y, z = (float(v) for v in position)
        return Pose((x, y, z), wanted.quaternion), why


@dataclass(frozen=True, slots=True)
class Steering:
    """Steering state between control steps: the current speed of the commanded pose [m/s]."""

    speed_m_s: float = 0.0

    def toward(
        self, now: Pose, wanted: Pose, gripper: float, *, share: float, period_s: float
    ) -> tuple[Steering, np.ndarray]:
        """Return the next state and the ``ee_delta`` action, (7,), that moves the commanded pose toward a target.

        Translation and rotation arrive together. The speed changes with the acceleration of the expert's free motion. A
        moved target is followed immediately, because only the speed of the commanded pose is limited.

        Args:
            now: Commanded pose.
            wanted: Target pose.
            gripper: Gripper command in [-1, 1].
            share: Fraction of the expert's full speed.
            period_s: Control period [s].
        """
        turning = angle_between(now.quaternion, wanted.quaternion) * FREE.speed / FREE.turning
        length = max(distance(now.position, wanted.position), turning)
        if length < 1e-5:
            return replace(self, speed_m_s=0.0), np.array([0.0] * 6 + [gripper])
        most = FREE.speed * min(1.0, max(SLOWEST, share))
        braking = math.sqrt(2.0 * FREE.acceleration * length)
        speed = max(0.01, min(most, self.speed_m_s + FREE.acceleration * period_s, braking))
        part = min(1.0, speed * period_s / length)
        return Steering(speed), delta_action(now, straight_way(now, wanted)(part), gripper)


def is_finite(pose: Pose) -> bool:
    """Return whether all numbers in a pose are finite and its quaternion is a rotation."""
    numbers = (*pose.position, *pose.quaternion)
    return all(map(math.isfinite, numbers)) and sum(v * v for v in pose.quaternion) > 1e-6


def unit(pose: Pose) -> Pose:
    """Return an external pose with a unit quaternion, w >= 0."""
    return Pose(pose.position, normalize(pose.quaternion))
