"""Operator input from the browser and from devices, collected between two control steps. All methods are thread-safe.

The page that is opened first controls the robot. Other pages only display the scene until one of them takes over
control. Input cannot block or crash the control loop: unreadable input is reported in one line, and held keys expire
unless they are renewed.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, cast, get_args

from betterbench.browser.keys import NO_PUSH, PageKeys, new_taps, read_keys
from betterbench.demonstrations.teleop.steering import is_finite
from betterbench.errors import BetterError, one_line
from betterbench.geometry import Pose

Tap = Literal["gripper", "undo", "restart", "save", "discard"]
"""Actions that a single press of a button or key triggers."""
TAPS: tuple[str, ...] = get_args(Tap)

HELD_FOR_S = 0.6
"""Time after which held keys and axes count as released if the page does not renew them [s].

The page renews them every 0.2 s.
"""
DEAD_ZONE = 0.12
"""Maximum deflection of an axis that counts as zero."""
MOST_TAPS = 32
"""Maximum number of key presses that wait for a control step.

Additional presses are dropped, because a person cannot press this many keys.
"""

KEYS: dict[str, tuple[int, float]] = {
    "KeyW": (0, 1.0),
    "KeyS": (0, -1.0),
    "KeyA": (1, 1.0),
    "KeyD": (1, -1.0),
    "KeyR": (2, 1.0),
    "KeyF": (2, -1.0),
    "KeyJ": (3, -1.0),
    "KeyL": (3, 1.0),
    "KeyI": (4, 1.0),
    "KeyK": (4, -1.0),
    "KeyQ": (5, 1.0),
    "KeyE": (5, -1.0),
}
"""Component and sign of the motion that each key causes.

The components are forward, left, up, roll, pitch and yaw, as seen by the operator.
"""
TAP_KEYS: dict[str, Tap] = {"Space": "gripper", "KeyZ": "undo", "Enter": "save"}
GAMEPAD_TAPS: dict[int, Tap] = {0: "gripper", 1: "undo", 9: "save"}
"""Actions that the buttons of a standard gamepad trigger (W3C Gamepad, "standard" mapping)."""
SLOW = 0.25
"""Speed factor while Shift is held."""


@dataclass(frozen=True, slots=True)
class ControlInput:
    """Input of the operator since the last control step.

    Attributes:
        taps: Actions that were triggered by buttons and keys, in order.
        drag: Pose to which the operator dragged the gizmo (the handle that marks the target pose in the 3-D scene), or
            pose that the leader arm commands; None if there is neither.
        is_dragging: Whether the operator is still dragging the gizmo.
        push: Deflections that move the tool: forward, left, up, roll, pitch and yaw as seen by the operator, each in
            [-1, 1].
        closed: Whether the gripper of the leader arm is closed; None without a leader arm.
        driver: Number of the page that controls the robot; None if no page is open.
    """

    taps: tuple[Tap, ...] = ()
    drag: Pose | None = None
    is_dragging: bool = False
    push: tuple[float, ...] = NO_PUSH
    closed: bool | None = None
    driver: int | None = None


@dataclass(slots=True)
class _Push:
    values: tuple[float, ...]
    at_s: float


@dataclass(slots=True)
class Controls:
    """Collector of the operator's input. The control loop calls ``take`` once per control step."""

    driver: int | None = None
    """Number of the page that controls the robot."""
    problems: list[str] = field(default_factory=list)
    """Messages of one line about unreadable input. Messages are removed when the control loop takes them."""
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _pages: list[int] = field(default_factory=list)
    _taps: list[Tap] = field(default_factory=list)
    _counts: dict[int, dict[str, int]] = field(default_factory=dict)
    _drag: Pose | None = None
    _is_dragging: bool = False
    _pushes: dict[str, _Push] = field(default_factory=dict)
    _closed: bool | None = None
    _grip: int = 0
    _tool: Pose | None = None

    def connected(self, page: int) -> bool:
        """Register a page that was opened. Return whether this page controls the robot."""
        with self._lock:
            self._pages.append(page)
            if self.driver is None:
                self.driver = page
            return self.driver == page

    def disconnected(self, page: int) -> bool:
        """Unregister a page that was closed, and release its keys. Return whether this page controlled the robot."""
        with self._lock:
            self._pages = [p for p in self._pages if p != page]
            self._counts.pop(page, None)
            drove = self.driver == page
            if drove:
                self._let_go()
                self.driver = self._pages[0] if self._pages else None
            return drove

    def take_over(self, page: int) -> None:
        """Give control of the robot to the given page."""
        with self._lock:
            if page in self._pages and page != self.driver:
                self._let_go()
                self.driver = page

    def tapped(self, page: int | None, tap: Tap) -> bool:
        """Register the press of a button or key. Return False if it came from a page that does not control the robot.

        Args:
            page: Number of the page; None for a device.
            tap: Action that the press triggers.
        """
        with self._lock:
            if page is not None and page != self.driver:
                return False
            self._taps = [*self._taps, tap][:MOST_TAPS]
            return True

    def dragged(self, page: int, pose: Pose, *, is_over: bool) -> bool:
        """Register the pose of the gizmo. Return False if the page does not control the robot.

        Args:
            page: Number of the page.
            pose: Pose of the gizmo.
            is_over: Whether the operator has released the gizmo.
        """
        with self._lock:
            if page != self.driver:
                return False
            if is_finite(pose):
                self._drag, self._is_dragging = pose, not is_over
            else:
                self._tell("the pose of the gizmo contains a number that is not finite, so it was ignored")
            return True

    def sent(self, page: int, text: str, now_s: float) -> bool:
        """Process a message from a page. Return False if it is a command and the page does not control the robot.

        Args:
            page: Number of the page.
            text: The message.
            now_s: Current time [s].
        """
        try:
            form = read_keys(text)
        except BetterError as problem:
            with self._lock:
                self._tell(str(problem))
            return True
        with self._lock:
            # Presses are counted even before the page controls the robot, so that they are not executed later.
            known = self._counts.setdefault(page, {})
            made = cast("list[Tap]", new_taps(form, known, TAPS))
            push = _push_of(form)
            if page != self.driver:
                return not (made or any(push))
            self._taps = [*self._taps, *made][:MOST_TAPS]
            self._pushes["page"] = _Push(push, now_s)
            return True

    def pushed(self, device: str, values: Sequence[float], now_s: float) -> None:
        """Register the deflections of a device's axes, as six numbers in [-1, 1].

        Values that are not finite are ignored.
        """
        with self._lock:
            if len(values) != 6 or not all(map(math.isfinite, values)):
                self._tell(f"{device}: its values are not finite, so they were ignored; the arm does not move")
                self._pushes.pop(device, None)
                return
            self._pushes[device] = _Push(tuple(calmed(v) for v in values), now_s)

    def led(self, pose: Pose, *, closed: bool) -> None:
        """Register the pose that the leader arm commands. Values that are not finite are ignored."""
        with self._lock:
            if is_finite(pose):
                self._drag, self._closed = pose, closed
            else:
                self._tell("leader arm: its pose is not finite, so it was ignored; the arm does not move")

    def complain(self, problem: str) -> None:
        """Register a problem with a device, as a message of one line."""
        with self._lock:
            self._tell(problem)

    def hold_from(self, tool: Pose) -> None:
        """Start to follow the leader arm again, from the current target of the robot's tool."""
        with self._lock:
            self._grip += 1
            self._tool, self._drag = tool, None

    def grip(self) -> tuple[int, Pose | None]:
        """Return the number of calls of :meth:`hold_from`, and the target of the robot's tool at the last call.

        Before the first call, the target is None.
        """
        with self._lock:
            return self._grip, self._tool

    def take(self, now_s: float) -> ControlInput:
        """Return the input of the operator since the last call, and start to collect new input."""
        with self._lock:
            for device in [d for d, push in self._pushes.items() if now_s - push.at_s > HELD_FOR_S]:
                del self._pushes[device]
            summed = [sum(push.values[i] for push in self._pushes.values()) for i in range(6)]
            push = tuple(max(-1.0, min(1.0, v)) for v in summed)
            asked = ControlInput(tuple(self._taps), self._drag, self._is_dragging, push, self._closed, self.driver)
            self._taps, self._drag = [], None
            return asked

    def take_problems(self) -> list[str]:
        """Return the messages about unreadable input since the last call."""
        with self._lock:
            found, self.problems = self.problems, []
            return found

    def _let_go(self) -> None:
        self._taps, self._drag, self._is_dragging = [], None, False
        self._pushes.pop("page", None)

    def _tell(self, problem: str) -> None:
        line = one_line(problem, most=200)
        if line not in self.problems and len(self.problems) < 5:
            self.problems.append(line)


def calmed(value: float) -> float:
    """Remove the dead zone from the deflection of a stick, and scale the rest to [-1, 1]."""
    size = max(0.0, min(1.0, abs(value)) - DEAD_ZONE) / (1.0 - DEAD_ZONE)
    return math.copysign(size, value) if size else 0.0


def _push_of(form: PageKeys) -> tuple[float, ...]:
    values = [calmed(v) for v in form.push]
    for key in form.held:
        if key in KEYS:
            component, sign = KEYS[key]
            values[component] += sign
    scale = SLOW if form.slow else 1.0
    return tuple(scale * max(-1.0, min(1.0, v)) for v in values)
