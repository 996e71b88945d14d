"""Steering: computation of the action that moves the tool toward a target in one control step.

The target is limited to the robot's workspace, and the speed of the tool is limited.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from betterbench.geometry import Pose, angle_between, distance, normalize, straight_way, vector_of
from betterbench.policies.experts.motion import FREE, delta_action
from betterbench.sim.robots import RobotSpec
from betterbench.sim.robots.spec import SteeringLimits

LOWEST_TIP_M = 0.002
"""Minimum height of the fingertips above the table that the operator can command [m]."""
SLOWEST = 0.1
"""Minimum speed, as a fraction of the full speed."""
OUT_OF_REACH = "out of reach: the arm moves as far as it can"
IN_THE_TABLE = "below the table: the fingers stop above it"


@dataclass(frozen=True, slots=True)
class Reach:
    """Limits on the target poses of a robot's tool.

    Attributes:
        limits: Limits of the robot's workspace.
        lowest_m: Minimum height of the tool center point above the table when the tool points down [m].
    """

    limits: SteeringLimits
    lowest_m: float

    @classmethod
    def of(cls, spec: RobotSpec) -> Reach:
        """Return the limits for a robot."""
        return cls(spec.steering, spec.tip_below_tcp_m + LOWEST_TIP_M)

    def within(self, wanted: Pose) -> tuple[Pose, str]:
        """Return the pose within the limits that is nearest to the wanted pose.

        Also return the reason why the two poses differ, or "" if they are equal.
        """
        position, why, limits = np.array(wanted.position), "", self.limits
        if position[2] < self.lowest_m:
            position[2], why = self.lowest_m, IN_THE_TABLE
        center = np.array(limits.center)
        back = np.array(Pose((0.0, 0.0, 0.0), wanted.quaternion).apply((0.0, 0.0, -limits.back_m)))
        arm = position + back - center
        length = float(np.linalg.norm(arm))
        if length > limits.longest_m:
            position, why = center + arm * (limits.longest_m / length) - back, OUT_OF_REACH
            position[2] = max(position[2], self.lowest_m)
        flat = position[:2] - center[:2]
        across = float(np.hypot(flat[0], flat[1]))
        if across < limits.nearest_m:
            out = flat / across if across > 1e-6 else np.array([1.0, 0.0])
            position[:2], why = center[:2] + limits.nearest_m * out, OUT_OF_REACH
        if position[2] > limits.highest_m:
            position[2], why = limits.highest_m, OUT_OF_REACH
        return Pose(vector_of(position), wanted.quaternion), why


@dataclass(frozen=True, slots=True)
class Steering:
    """Steering state between two control steps: the current speed of the commanded pose [m/s]."""

    speed_m_s: float = 0.0

    def toward(
        self, now: Pose, wanted: Pose, gripper: float, *, share: float, period_s: float
    ) -> tuple[Steering, np.ndarray]:
        """Return the next steering state, and the action that moves the commanded pose toward a target.

        The action is in the ``ee_delta`` action space, as an array of shape (7,). Translation and rotation reach the
        target at the same time. The tool speeds up and brakes with the same acceleration as the expert in free motion.
        A moving target is followed without delay, because the limits apply only to the speed of the commanded pose.

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
    """Return whether all numbers in a pose are finite and its quaternion is not zero."""
    numbers = (*pose.position, *pose.quaternion)
    return all(map(math.isfinite, numbers)) and sum(v * v for v in pose.quaternion) > 1e-6


def unit(pose: Pose) -> Pose:
    """Normalize the quaternion of a pose so that w >= 0. Use this function for poses from outside this program."""
    return Pose(pose.position, normalize(pose.quaternion))
