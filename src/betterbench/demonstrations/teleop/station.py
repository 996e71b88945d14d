"""Teleoperation loop: reads the input, steps the session and shows the result at the control rate.

The loop never blocks. The episode pauses while no page is open, and while the operator gives no command and all objects
are at rest. No rows are recorded during a pause, so the demonstration does not contain the time in which the operator
thinks.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from betterbench.demonstrations.making.attempt import DemonstrationAttempt
from betterbench.demonstrations.making.starts import Start
from betterbench.demonstrations.teleop.cameras import CameraThread
from betterbench.demonstrations.teleop.controls import ControlInput, Controls, Tap
from betterbench.demonstrations.teleop.loading import SessionLoader
from betterbench.demonstrations.teleop.page import PanelState
from betterbench.demonstrations.teleop.session import Command, TeleopSession
from betterbench.demonstrations.teleop.store import DemonstrationStore, can_keep
from betterbench.errors import BetterError, StorageError
from betterbench.geometry import Pose, distance, from_axis_angle, multiply, normalize, rotate
from betterbench.sim.scenes.glb import body_files

PUSH_M_S, PUSH_RAD_S = 0.30, 1.2
"""Speed of the target at full deflection of a key, stick or SpaceMouse and at full speed of the slider [m/s, rad/s]."""
PUSH_LEAD_M = 0.06
"""Maximum distance of the target from the tool while keys or a stick move it [m].

Because of this limit, the tool stops soon after a key is released.
"""
WAIT_STEPS = 10
"""Number of control steps without commands and motion after which the episode pauses (0.5 s)."""
SAID_LINES = 3


class Display(Protocol):
    """Display of a teleoperation session, such as the page in the browser."""

    @property
    def view_yaw(self) -> float:
        """Viewing direction of the operator, seen from above [rad]."""

    @property
    def speed(self) -> float:
        """Speed that the operator requests, as a fraction of the full speed."""

    def show_scene(self, files: dict[int, bytes]) -> None:
        """Show another scene, given as the content of a GLB file for each body index."""

    def show_state(self, positions: np.ndarray, quaternions: np.ndarray, gizmo: Pose | None) -> None:
        """Show the poses of all bodies and of the gizmo."""

    def show(self, shown: PanelState) -> None:
        """Show the given content in the panel."""


class Station:
    """Teleoperation by one operator. The demonstrations are saved in one store."""

    def __init__(
        self,
        store: DemonstrationStore,
        controls: Controls,
        display: Display,
        *,
        name: str,
        cameras: CameraThread | None = None,
        loads_apart: bool = False,
    ) -> None:
        """Prepare the first initial state that is to be demonstrated.

        Args:
            store: Store of the demonstrations.
            controls: Input of the operator.
            display: Display for the operator.
            name: Name of the demonstrator.
            cameras: Renderer of the live camera images.
            loads_apart: Whether scenes are created in a separate thread, so that the loop continues and can be ended at
                any time.
        """
        self._loader = SessionLoader(lambda start: TeleopSession(store.scene(start)), apart=loads_apart)
        self._store, self._controls, self._display, self._cameras = store, controls, display, cameras
        self._name = name
        self._said: deque[str] = deque(maxlen=SAID_LINES)
        self._do: dict[Tap, Callable[[], None]] = {
            "gripper": self._turn_gripper,
            "undo": self._undo,
            "restart": self._restart,
            "save": self._save,
            "discard": self._discard,
        }
        self._driver: int | None = None
        self.start: Start | None = None
        self.session: TeleopSession | None = None
        self._found: DemonstrationAttempt | None = None
        self._target: Pose | None = None
        self._closed, self._is_waiting = False, True
        self._still_for, self._undone = WAIT_STEPS, 0
        self._began_s, self._starts = 0.0, 0
        self._begin_next()

    @property
    def is_done(self) -> bool:
        """Whether every planned demonstration is saved."""
        return self.start is None

    @property
    def is_busy(self) -> bool:
        """Whether a thread is creating a scene."""
        return self._loader.is_busy

    @property
    def is_loading(self) -> bool:
        """Whether the scene of the next demonstration is being created."""
        return self.session is None and self.start is not None

    def run(self, stopped: threading.Event) -> None:
        """Run the loop until the event is set. Control steps that are missed because the loop is late are skipped."""
        period = 0.05 if self.session is None else 1.0 / self.session.scene.control_rate_hz
        due = time.monotonic()
        while not stopped.is_set():
            self.tick(time.monotonic())
            due = max(due + period, time.monotonic() - period)
            stopped.wait(max(0.0, due - time.monotonic()))

    def tick(self, now_s: float) -> None:
        """Do the work of one control step."""
        asked = self._controls.take(now_s)
        for problem in self._controls.take_problems():
            self._say(problem)
        if self.is_loading:
            self._receive()
        else:
            self._obey(asked.taps)
        session = self.session
        if session is not None:
            self._follow(session, asked)
        self._show(asked)

    def _obey(self, taps: Sequence[Tap]) -> None:
        """Execute button and key presses up to the first press that changes the scene.

        Later presses are ignored, because they were made while the old scene was shown.
        """
        for tap in taps:
            before = self._starts
            self._do[tap]()
            if self._starts != before:
                return

    def _follow(self, session: TeleopSession, asked: ControlInput) -> None:
        """Take a control step toward the requested target, unless the episode is paused."""
        # If another page has taken control, keep the current target until this page gives a command.
        if asked.driver != self._driver:
            self._driver, self._target = asked.driver, None
            self._controls.hold_from(session.state.commanded_pose)
        if asked.closed is not None:
            self._closed = asked.closed
        if asked.drag is not None:
            self._target = asked.drag
        elif any(asked.push):
            self._target = self._pushed(session, asked.push)
        is_due = self._closed != (session.state.gripper_command > 0.0) or not session.is_waiting(self._target)
        self._still_for = 0 if is_due else self._still_for + 1
        self._is_waiting = asked.driver is None or session.phase != "going" or self._still_for > WAIT_STEPS
        if self._is_waiting:
            return
        try:
            session.step(Command(self._target, self._closed, self._display.speed))
        except BetterError as problem:
            self._target = None
            self._say(str(problem))
        if session.phase != "going":
            self._judge(session)

    def _pushed(self, session: TeleopSession, push: tuple[float, ...]) -> Pose:
        """Move the target by one control step of key or stick input, relative to the operator's view."""
        state, period = session.state, 1.0 / session.scene.control_rate_hz
        base = self._target or state.commanded_pose
        if distance(base.position, state.ee_pose.position) > PUSH_LEAD_M:
            base = state.commanded_pose
        yaw = self._display.view_yaw
        view = normalize((math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)))
        speed = self._display.speed * period
        dx, dy, dz = rotate(view, [PUSH_M_S * speed * v for v in push[:3]])
        turn = from_axis_angle(rotate(view, [PUSH_RAD_S * speed * v for v in push[3:]]))
        moved = base.translated(dx, dy, dz)
        return session.reach.within(Pose(moved.position, normalize(multiply(turn, moved.quaternion))))[0]

    def _turn_gripper(self) -> None:
        if self.session is not None and self.session.phase == "going":
            self._closed = not self._closed

    def _undo(self) -> None:
        if self.session is None:
            return
        before = self.session.steps
        to = self.session.undo()
        self._undone += before - self.session.steps
        self._let_go(self.session)
        self._say(f"returned to {to}; {before - self.session.steps} steps were removed")

    def _restart(self) -> None:
        if self.session is None:
            return
        self._undone += self.session.steps
        self.session.restart()
        self._let_go(self.session)
        self._say("back at the start")

    def _discard(self) -> None:
        if self.start is not None:
            self._store.put_off(self.start)
            self._say("discarded; this start will be repeated after the others")
            self._begin_next()

    def _save(self) -> None:
        session, start = self.session, self.start
        if session is None or start is None:
            return
        found = self._found
        if found is None or not can_keep(found):
            reason = "the subgoals are not done" if found is None else found.note.reason
            self._say(f"not saved: {reason}")
            return
        wall = {
            "total_s": round(time.monotonic() - self._began_s, 3),
            "steps": float(session.steps),
            "undone_steps": float(self._undone),
        }
        try:
            path = self._store.save(start, session.scene, found, wall)
        except (StorageError, OSError) as problem:
            self._say(f"not saved yet: {problem} Then press Save again; the demonstration is kept until then.")
            return
        self._say(f"saved {path.relative_to(self._store.run.path)}")
        self._begin_next()

    def _judge(self, session: TeleopSession) -> None:
        """Check whether an episode that has ended can be saved, and tell the operator."""
        self._found = session.finished(self._name)
        if session.phase == "step_limit":
            self._say("the step limit is reached; undo some steps, or reset to the start")
        elif self._found.note.failure:
            kept = "it can be saved with this note" if can_keep(self._found) else "undo some steps and try again"
            self._say(f"{self._found.note.failure}: {self._found.note.reason} ({kept})")

    def _begin_next(self) -> None:
        self.start = self._store.due()
        self.session = None
        self._found, self._target = None, None
        self._closed, self._is_waiting = False, True
        self._still_for, self._undone = WAIT_STEPS, 0
        self._began_s = time.monotonic()
        self._starts += 1
        if self.start is None:
            return
        self._loader.begin(self.start)
        self._receive()

    def _receive(self) -> None:
        """Switch to a session that has been prepared. Commands that arrived during the preparation are ignored."""
        session = self._loader.take()
        if session is None:
            return
        self.session, self._began_s = session, time.monotonic()
        self._controls.hold_from(session.state.commanded_pose)
        self._display.show_scene(body_files(session.scene.model))

    def _let_go(self, session: TeleopSession) -> None:
        """Discard the operator's target after the state has changed, e.g. by an undo.

        The gripper command is set to the gripper command of the new state.
        """
        self._found = None
        self._target = None
        self._closed = session.state.gripper_command > 0.0
        self._still_for = WAIT_STEPS
        self._controls.hold_from(session.state.commanded_pose)

    def _say(self, text: str) -> None:
        self._said.append(text)

    def _show(self, asked: ControlInput) -> None:
        session = self.session
        if session is None:
            shown = _all_saved if self.start is None else _loading
            self._display.show(shown(self._store, tuple(self._said)))
            return
        positions, quaternions = session.scene.body_poses()
        gizmo = None if asked.is_dragging else (self._target or session.state.commanded_pose)
        if gizmo is not None:
            gizmo = session.reach.within(gizmo)[0]
        self._display.show_state(positions, quaternions, gizmo)
        self._display.show(self._shown(session, asked))
        if self._cameras is not None:
            with contextlib.suppress(RuntimeError):
                self._cameras.look(session.scene)

    def _shown(self, session: TeleopSession, asked: ControlInput) -> PanelState:
        start, state = self.start, session.state
        status, tone = self._status(session, asked)
        title = "" if start is None else f"{start.task} · {start.condition} · seed {start.seed}"
        subgoals = session.scene.condition.instruction.subgoals
        return PanelState(
            f"{title} · {self._store.saved} of {self._store.planned} saved",
            session.scene.condition.instruction.text,
            tuple((g.name.replace("_", " "), done) for g, done in zip(subgoals, session.truth.subgoals, strict=True)),
            session.steps / session.limit,
            f"{state.time_s:.1f} s of {session.limit / session.scene.control_rate_hz:.0f} s",
            status,
            tone,
            session.notice,
            tuple(self._said),
            session.undo_to.replace("_", " "),
            self._closed,
            self._found is not None and can_keep(self._found),
            f"tool {100.0 * state.ee_pose.position[2]:.0f} cm above the table",
            self._images_text(),
        )

    def _images_text(self) -> str:
        """Return a text with the delay of the camera images, or "" if they are up to date."""
        late_s = 0.0 if self._cameras is None else self._cameras.late_s
        return f"camera images are {late_s:.0f} s late; steering does not wait for them" if late_s else ""

    def _status(self, session: TeleopSession, asked: ControlInput) -> tuple[str, str]:
        if session.phase == "success":
            found = self._found
            return ("done: save it", "good") if found is not None and can_keep(found) else ("did not last", "bad")
        if session.phase == "step_limit":
            return "out of steps", "bad"
        if asked.driver is None:
            return "paused: no page is open", "wait"
        held = session.state.held
        holds = f" · holds {held.replace('_', ' ')}" if held else ""
        if not self._is_waiting:
            return f"recording{holds}", "go"
        return (f"waiting for you{holds}" if session.steps else "ready: drag the gizmo or press a key"), "wait"


def _loading(store: DemonstrationStore, said: tuple[str, ...]) -> PanelState:
    title = f"{store.saved} of {store.planned} saved"
    return PanelState(
        title, "The next start is being prepared.", (), 0.0, "", "loading", "wait", "", said, "the start", False, False
    )


def _all_saved(store: DemonstrationStore, said: tuple[str, ...]) -> PanelState:
    title = f"{store.saved} of {store.planned} saved"
    text = "Every requested demonstration is saved. Stop with Ctrl-C; use a larger --demos for more."
    return PanelState(title, text, (), 1.0, "", "all saved", "good", "", said, "the start", False, False)
