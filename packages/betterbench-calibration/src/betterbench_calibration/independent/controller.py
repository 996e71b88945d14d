"""Cartesian controller for the independent family. It executes tool paths as ``ee_delta`` actions.

A motion is a generator that yields one action per control step, receives the resulting state, and returns a result.
Motions are combined with ``yield from``. There is no joint-space planning. A path is a line or an arc between two tool
poses in the world frame. The motion style determines its speed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Generator
from typing import TypeVar

import numpy as np

from betterbench.geometry import (
    TOOL_DOWN,
    Pose,
    Quaternion,
    Vector,
    angle_between,
    conjugate,
    distance,
    from_yaw,
    multiply,
    normalize,
    rotate,
    slerp,
    to_axis_angle,
)
from betterbench.interface.actions import ROTATION_PER_UNIT_RAD, TRANSLATION_PER_UNIT_M
from betterbench.interface.state import WorldState
from betterbench_calibration.independent.events import EventLog
from betterbench_calibration.independent.manner import Manner

T = TypeVar("T")
Actions = Generator[np.ndarray, WorldState, T]
"""Generator that yields actions (7,), receives states, and returns a result."""

RATE_HZ = 20.0
TURN_RAD_S = 1.6
FINGER_SPEED_M_S = 0.1
OPEN, CLOSE, KEEP = -1.0, 1.0, 0.0
HALT_EVERY_M, HALT_S = 0.15, 0.3
ARRIVED_M, ARRIVED_RAD = 0.003, 0.03
LONG_WAY_M = 0.15


def tool_yaw(quaternion: Quaternion) -> float:
    """Return the yaw of the tool's x axis in the world frame [rad]."""
    x, y, _ = rotate(quaternion, (1.0, 0.0, 0.0))
    return math.atan2(y, x)


def tool_down(yaw: float) -> Quaternion:
    """Return the rotation of a tool that points straight down, given the yaw of its x axis [rad]."""
    return normalize(multiply(from_yaw(yaw), TOOL_DOWN))


class Arm:
    """Arm in one episode, whose tool moves in a certain motion style.

    Attributes:
        manner: Motion style.
        state: Latest state.
        log: Log of the events in the episode.
        home: Pose of the tool at the start of the episode.
        tempo: Factor by which all tool speeds are multiplied, in addition to ``pace`` of a single path.
    """

    def __init__(self, manner: Manner, noise: np.random.Generator, first: WorldState) -> None:
        """Prepare an episode. ``noise`` is the generator of action noise, and ``first`` the state at the reset."""
        self.manner, self.state = manner, first
        self.log = EventLog(first)
        self.home = first.ee_pose
        self._noise = noise
        self._grip = KEEP
        self.tempo = 1.0

    @property
    def here(self) -> Pose:
        """Commanded pose of the tool."""
        return self.state.commanded_pose

    def step(self, target: Pose) -> Actions[None]:
        """Command a pose for the next control step."""
        now = self.here
        dx, dy, dz = (b - a for a, b in zip(now.position, target.position, strict=True))
        turn = to_axis_angle(multiply(target.quaternion, conjugate(now.quaternion)))
        shake = self._noise.normal(0.0, 1.0, 3) * self.manner.noise_m
        action = np.array(
            [
                *((np.array((dx, dy, dz)) + shake) / TRANSLATION_PER_UNIT_M),
                *(np.array(turn) / ROTATION_PER_UNIT_RAD),
                self._grip,
            ]
        )
        before = self.state
        self.state = yield np.clip(action, -1.0, 1.0)
        self.log.see(before, self.state, self._grip)

    def go(self, target: Pose, *, pace: float = 1.0, bow: bool = False) -> Actions[None]:
        """Move to a pose, and wait until the tool has arrived.

        ``pace`` is a factor on the speed of the motion style. If ``bow`` is True, a long path may deviate sideways.
        """
        start = self.here
        length = distance(start.position, target.position)
        turn = angle_between(start.quaternion, target.quaternion)
        duration = max(length / (self.manner.speed_m_s * pace * self.tempo), turn / (TURN_RAD_S * self.tempo), 0.15)
        n = math.ceil(duration * RATE_HZ)
        side = self.manner.bow_m if bow and length > LONG_WAY_M else 0.0
        halts = int(length / HALT_EVERY_M) if self.manner.profile == "halting" else 0
        for i in range(1, n + 1):
            yield from self.step(_between(start, target, self._progress(i / n), side))
            if halts and i in {n * k // (halts + 1) for k in range(1, halts + 1)}:
                yield from self.wait(HALT_S)
        yield from self.arrive(target)

    def along(self, way: Callable[[float], Pose], *, pace: float = 1.0) -> Actions[None]:
        """Follow a curve without a stop, and wait until the tool has arrived at its end.

        ``way`` returns the tool pose at a fraction of the path, from 0 to 1.
        """
        points = [way(i / 16) for i in range(17)]
        length = sum(distance(a.position, b.position) for a, b in itertools.pairwise(points))
        turn = sum(angle_between(a.quaternion, b.quaternion) for a, b in itertools.pairwise(points))
        duration = max(length / (self.manner.speed_m_s * pace * self.tempo), turn / (TURN_RAD_S * self.tempo), 0.15)
        n = math.ceil(duration * RATE_HZ)
        for i in range(1, n + 1):
            yield from self.step(way(self._progress(i / n)))
        yield from self.arrive(way(1.0))

    def arrive(self, target: Pose, *, patience_s: float = 0.6) -> Actions[bool]:
        """Command a pose until the tool reaches it. Return whether the tool has reached it in time."""
        for _ in range(round(patience_s * RATE_HZ)):
            p = self.state.ee_pose
            near = distance(p.position, target.position) < ARRIVED_M + 2.0 * self.manner.noise_m
            if near and angle_between(p.quaternion, target.quaternion) < ARRIVED_RAD:
                return True
            yield from self.step(target)
        return False

    def wait(self, seconds: float) -> Actions[None]:
        """Hold the commanded pose for some time."""
        hold = self.here
        for _ in range(round(seconds * RATE_HZ)):
            yield from self.step(hold)

    def stay(self) -> Actions[None]:
        """Hold the commanded pose until the episode ends."""
        hold = self.here
        while True:
            yield from self.step(hold)

    def close(self) -> Actions[None]:
        """Close the gripper until the fingers stop."""
        self._grip = CLOSE
        hold, width = self.here, self.state.finger_width_m
        for i in range(round(1.4 * RATE_HZ)):
            yield from self.step(hold)
            now = self.state.finger_width_m
            if i > 4 and abs(now - width) < 0.0003:
                break
            width = now
        self.log.closed(self.state)

    def open(self, width_m: float | None = None) -> Actions[None]:
        """Open the gripper fully, or until the pads have a given distance [m]."""
        self._grip = OPEN
        goal = self.state.info.gripper_opening_m - 0.004 if width_m is None else width_m
        self.log.opening(self.state)
        hold = self.here
        for _ in range(round(1.2 * RATE_HZ)):
            if self.state.finger_width_m >= goal - 0.003:
                break
            yield from self.step(hold)
        if width_m is not None:
            self._grip = KEEP

    def begin_to_open(self) -> None:
        """Command the gripper to open from the next step on. Return immediately."""
        self._grip = OPEN
        self.log.opening(self.state)

    def begin_to_close(self) -> None:
        """Command the gripper to close from the next step on. Return immediately."""
        self._grip = CLOSE

    def narrow(self, width_m: float) -> Actions[None]:
        """Move the pads of the empty gripper to a distance [m]."""
        if self.state.finger_width_m < width_m - 0.004:
            yield from self.open(width_m)
            return
        self._grip = CLOSE
        hold = self.here
        for _ in range(round(1.2 * RATE_HZ)):
            if self.state.finger_width_m <= width_m + 0.004:
                break
            yield from self.step(hold)
        self._grip = KEEP

    def rise(self, height_m: float, *, pace: float = 1.0) -> Actions[None]:
        """Move the tool straight up to a height above the table [m], unless it is already higher."""
        if self.here.position[2] < height_m - 0.005:
            x, y, _ = self.here.position
            yield from self.go(Pose((x, y, height_m), self.here.quaternion), pace=pace)

    def lower_until_touch(self, height_m: float) -> Actions[None]:
        """Move the tool slowly straight down to a height [m], or until the gripper touches an object."""
        x, y, _ = self.here.position
        while self.here.position[2] > height_m + 0.001 and not self._touches():
            z = max(height_m, self.here.position[2] - 0.003)
            yield from self.step(Pose((x, y, z), self.here.quaternion))

    def _touches(self) -> bool:
        return any(self.state.touched_by_gripper(o.name) for o in self.state.info.objects)

    def go_home(self) -> Actions[None]:
        """Move up, and then to the initial pose of the tool."""
        yield from self.rise(self.home.position[2])
        yield from self.go(self.home)

    def _progress(self, t: float) -> float:
        if self.manner.profile == "minimum_jerk":
            return t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
        return t


def _between(start: Pose, target: Pose, s: float, side_m: float) -> Pose:
    """Return the pose at fraction ``s`` of a path that deviates sideways by ``side_m`` at its midpoint."""
    a, b = start.position, target.position
    x, y, z = (p + s * (q - p) for p, q in zip(a, b, strict=True))
    if side_m:
        flat = math.hypot(b[0] - a[0], b[1] - a[1])
        if flat > LONG_WAY_M:
            out = side_m * math.sin(math.pi * s)
            x, y = x - out * (b[1] - a[1]) / flat, y + out * (b[0] - a[0]) / flat
    position: Vector = (x, y, z)
    return Pose(position, slerp(start.quaternion, target.quaternion, s))
