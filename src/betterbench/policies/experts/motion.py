"""Motion of the tool center point along straight segments, with limited speed and acceleration."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np

from betterbench.geometry import Pose, angle_between, distance, straight_way, to_axis_angle, turn_between
from betterbench.interface.actions import ROTATION_PER_UNIT_RAD, TRANSLATION_PER_UNIT_M
from betterbench.interface.state import WorldState

Motion = Generator[np.ndarray, WorldState, WorldState]
"""Generator that performs a motion: it yields actions, receives the state after each action, and returns the last
state.
"""

OPEN, CLOSE = -1.0, 1.0


@dataclass(frozen=True, slots=True)
class Pace:
    """Limits on the speed and acceleration of a motion.

    Attributes:
        speed: Maximum speed of the tool center point [m/s].
        corner_speed: Speed at the corners between two segments [m/s].
        acceleration: Maximum acceleration [m/s^2].
        turning: Maximum angular speed [rad/s].
    """

    speed: float
    corner_speed: float = 0.08
    acceleration: float = 0.8
    turning: float = 1.2


FREE = Pace(0.50, 0.15, 1.6, 1.8)
"""Limits for a motion with an empty gripper."""
CARRY = Pace(0.32, 0.10, 0.8, 1.6)
"""Limits for a motion with an object in the gripper. An object held with 40 N then slips by less than 1 mm."""
RAILS = Pace(0.14, 0.05, 0.4)
"""Limits for moving a drawer. The motion is slow, so that objects in the drawer do not slide."""
APPROACH = Pace(0.16, 0.05, 0.6)
"""Limits for the last part of a motion, before contact."""


def disturbed(action: np.ndarray, noise_m: float, generator: np.random.Generator) -> np.ndarray:
    """Return an action in the action space ``ee_delta`` with noise on its translation. The action may be changed.

    Args:
        action: The action. If it does not translate the tool, no noise is drawn.
        noise_m: Standard deviation of the noise along each axis [m].
        generator: Source of the noise.
    """
    if noise_m > 0.0 and action[:3].any():
        action[:3] += generator.normal(0.0, noise_m / TRANSLATION_PER_UNIT_M, 3)
        np.clip(action, -1.0, 1.0, out=action)
    return action


def delta_action(now: Pose, wanted: Pose, gripper: float) -> np.ndarray:
    """Return the ``ee_delta`` action that moves the commanded pose from ``now`` to ``wanted``.

    Args:
        now: Commanded pose before the action.
        wanted: Commanded pose after the action.
        gripper: Gripper command in [-1, 1].

    Returns:
        Action (7,), clipped to [-1, 1].
    """
    rx, ry, rz = to_axis_angle(turn_between(now.quaternion, wanted.quaternion))
    (x, y, z), (px, py, pz) = wanted.position, now.position
    m, rad = TRANSLATION_PER_UNIT_M, ROTATION_PER_UNIT_RAD
    action = ((x - px) / m, (y - py) / m, (z - pz) / m, rx / rad, ry / rad, rz / rad, gripper)
    return np.array([v if -1.0 <= v <= 1.0 else min(max(v, -1.0), 1.0) for v in action])


def _span(a: Pose, b: Pose, pace: Pace) -> float:
    """Return the length of a motion segment [m].

    For a rotation, the length is the distance that the tool could travel in the same time.
    """
    return max(distance(a.position, b.position), angle_between(a.quaternion, b.quaternion) * pace.speed / pace.turning)


def follow(
    state: WorldState, waypoints: Sequence[Pose], *, gripper: float, pace: Pace, period_s: float, settle: int = 14
) -> Motion:
    """Move along straight segments, and wait until the arm has arrived.

    Args:
        state: Current state.
        waypoints: Poses that the path connects. The motion stops at the last pose.
        gripper: Gripper command during the motion.
        pace: Limits on speed and acceleration.
        period_s: Control period [s].
        settle: Maximum number of control steps to wait for the arm at the end.

    Returns:
        State after the last action.
    """
    speed = 0.0
    for i, goal in enumerate(waypoints):
        start = state.commanded_pose
        length, way = _span(start, goal, pace), straight_way(start, goal)
        end_speed = 0.0 if i == len(waypoints) - 1 else pace.corner_speed
        done = 0.0
        while done < length - 1e-6:
            braking = math.sqrt(end_speed**2 + 2.0 * pace.acceleration * (length - done))
            speed = max(0.01, min(pace.speed, speed + pace.acceleration * period_s, braking))
            done = min(length, done + speed * period_s)
            state = yield delta_action(state.commanded_pose, way(done / length), gripper)
    goal = waypoints[-1]
    for _ in range(settle):
        near = distance(state.ee_pose.position, goal.position) < 0.0015
        if near and angle_between(state.ee_pose.quaternion, goal.quaternion) < 0.015:
            break
        state = yield delta_action(state.commanded_pose, goal, gripper)
    return state


def hold(state: WorldState, steps: int, *, gripper: float) -> Motion:
    """Keep the commanded pose for a number of control steps."""
    for _ in range(steps):
        state = yield delta_action(state.commanded_pose, state.commanded_pose, gripper)
    return state


def close_gripper(state: WorldState, *, steps: int = 24) -> Motion:
    """Close the gripper until the fingers have stopped moving.

    Args:
        state: Current state.
        steps: Maximum number of control steps to wait.
    """
    still = 0
    for _ in range(steps):
        width = state.finger_width_m
        state = yield delta_action(state.commanded_pose, state.commanded_pose, CLOSE)
        still = still + 1 if abs(state.finger_width_m - width) < 2e-4 else 0
        if still >= 4:
            break
    return state


def release_to(state: WorldState, *, width_m: float, steps: int = 20) -> Motion:
    """Open the gripper to ``width_m`` and keep it there while the released object comes to rest.

    Args:
        state: Current state.
        width_m: Opening width at which to stop [m].
        steps: Maximum number of control steps to wait.
    """
    state = yield from open_gripper(state, width_m=width_m, steps=steps)
    for _ in range(3):
        state = yield delta_action(state.commanded_pose, state.commanded_pose, 0.0)
    return state


def open_gripper(state: WorldState, *, width_m: float, steps: int = 20) -> Motion:
    """Open the gripper until the fingers are ``width_m`` apart.

    Args:
        state: Current state.
        width_m: Opening width that must be reached [m].
        steps: Maximum number of control steps to wait.
    """
    for _ in range(steps):
        if state.finger_width_m >= width_m:
            break
        state = yield delta_action(state.commanded_pose, state.commanded_pose, OPEN)
    return state
