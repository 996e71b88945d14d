"""Base class of the ``better review`` pages, on which keys, buttons and fields send commands.

The callbacks of the page only put commands into a queue. :meth:`CommandPage.run` takes the commands out of the queue
and executes them in order.
"""

from __future__ import annotations

import functools
import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, TypeVar

import numpy as np

from betterbench.browser.incoming import InputKind
from betterbench.browser.keys import MARK, new_taps, read_keys, script_element
from betterbench.browser.server import PageServer
from betterbench.errors import BetterError
from betterbench.geometry import Pose, Vector, normalize
from betterbench.review.base_desk import Desk

DeskT = TypeVar("DeskT", bound=Desk[Any, Any, Any])

PANEL_PX = 380
MOST_WAITING = 200
"""Maximum number of waiting commands. A person cannot send this many commands."""


class CommandPage(Generic[DeskT]):
    """Review page on which keys, buttons and fields send commands. Subclasses can add further commands.

    Attributes:
        server: Server of the page.
    """

    def __init__(self, desk: DeskT, taps: Mapping[str, str], *, host: str, port: int) -> None:
        """Start the web server of the page.

        Args:
            desk: State of the review.
            taps: Command that each key sends, by key code.
            host: Network interface to listen on.
            port: Port to listen on. 0 chooses any free port.

        Raises:
            MissingDependencyError: If viser is not installed.
            InvalidInputError: If the port is in use.
        """
        self._desk = desk
        # Part of the node names, because the browser keeps the poses of removed nodes by name.
        self._version = 0
        self._marks: list[Any] = []
        self._commands: queue.Queue[tuple[str, Any]] = queue.Queue(MOST_WAITING)
        self.server = PageServer(host=host, port=port, verb="better review", complain=self._complain)
        self._viser = self.server.viser
        self._keys = dict(taps)
        self._taps: dict[int, dict[str, int]] = {}

    def begin(self) -> None:
        """Show the first item without a verdict."""
        self._desk.open_first()
        self.show()

    def show(self, *, is_dragging: bool = False) -> None:
        """Update the page. The gizmo is not moved while the user is dragging it."""
        raise NotImplementedError

    def obey(self, command: str, value: Any, stopped: threading.Event) -> None:  # noqa: ANN401 - of the page
        """Execute a command, and show its result on the page."""
        raise NotImplementedError

    def run(self, stopped: threading.Event) -> None:
        """Execute the commands in the queue in order, until the event ``stopped`` is set."""
        self.begin()
        while not stopped.is_set():
            try:
                command, value = self._commands.get(timeout=0.1)
            except queue.Empty:
                continue
            while command == "drag" and not self._commands.empty():  # use only the newest pose of a drag
                following, newest = self._commands.queue[0]
                if following != "drag":
                    break
                self._commands.get_nowait()
                value = newest
            self.obey(command, value, stopped)

    def _put(self, command: str, value: Any = None) -> None:  # noqa: ANN401
        try:
            self._commands.put_nowait((command, value))
        except queue.Full:
            return

    def _complain(self, problem: str) -> None:
        self._put("complain", problem)

    async def _dragged(self, event: Any) -> None:  # noqa: ANN401 - viser's
        at, turn = (np.asarray(v, dtype=float) for v in (event.target.position, event.target.wxyz))
        if np.isfinite(at).all() and np.isfinite(turn).all() and np.linalg.norm(turn) > 0.5:
            x, y, z = (round(v, 5) + 0.0 for v in at.tolist())
            quaternion = normalize([round(v, 7) + 0.0 for v in turn.tolist()])
            self._put("drag", (Pose((x, y, z), quaternion), event.phase == "end"))

    def _is_of_page(self, command: str, value: Any) -> bool:  # noqa: ANN401
        """If the command comes from the gizmo or reports a problem, execute it and return True.

        For any other command, return False.
        """
        if command == "drag":
            pose, is_over = value
            self._desk.drag(pose)
            self.show(is_dragging=not is_over)
        elif command == "complain":
            self._desk.complain(str(value))
            self.show()
        return command in ("drag", "complain")

    def _common_verbs(self, modes: Sequence[str]) -> dict[str, Callable[[Any], object]]:
        """Return the commands that all review pages share, including one command per mode that switches to it."""
        desk = self._desk
        do: dict[str, Callable[[Any], object]] = {
            "previous": lambda _: desk.step(-1),
            "next": lambda _: desk.step(1),
            "select": lambda _: desk.select_next(),
            "keep": lambda _: desk.keep(),
            "drop edit": lambda _: desk.drop_edit(),
            "accept": lambda _: desk.accept(),
            "reject": lambda _: self._reject(),
            "undo": lambda _: desk.undo(),
        }
        return do | {mode: functools.partial(_choose, desk, mode) for mode in modes}

    def _reject(self) -> None:
        if self._desk.reject(str(self._reason.value)):
            self._reason.value = ""

    def _set_stage(self, light: float) -> Any:  # noqa: ANN401 - viser's
        """Set up an empty 3D view with an environment light of the given intensity, and return the view."""
        scene = self._viser.scene
        scene.set_up_direction("+z")
        scene.world_axes.visible = False
        scene.configure_environment_map("studio", environment_intensity=light)
        scene.configure_default_lights(enabled=True, cast_shadow=True)
        return scene

    def _begin_marks(self) -> None:
        """Remove all marks from the 3D view, and use new node names for marks that are added later."""
        for node in self._marks:
            node.remove()
        self._marks = []
        self._version += 1

    # ---------------------------------------------------------------------------------------------------------- panel

    def _begin_verdicts(self, gui: Any) -> None:  # noqa: ANN401 - viser's
        """Add the heading, the status, the verdict buttons and a field for the reason to the panel."""
        item, subject = self._desk.ITEM, self._desk.SUBJECT
        self._head = gui.add_html("")
        self._status = gui.add_html("")
        self._button(
            "Accept  A", "accept", "green", f"Accepts the {item}. If something was changed, the verdict is a fix."
        )
        self._reason = self._input(gui.add_text("reason", ""), "text", None)
        self._button("Reject  R", "reject", "red", f"Rejects the {item}, with the reason above.")
        self._button("Undo  ⌫", "undo", "orange", f"Undoes the last decision about this {subject}.")

    def _begin_panel(self, eye: Vector, look_at: Vector) -> Any:  # noqa: ANN401 - viser's
        """Set up an empty panel and the initial camera view. Return viser's GUI interface."""
        gui = self._viser.gui
        gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=False, brand_color=(46, 134, 222))
        gui.set_panel_label("better review")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_PX)
        camera = self._viser.initial_camera
        camera.position, camera.look_at = eye, look_at
        return gui

    def _listen(self) -> None:
        """Add to the page the script that reports pressed keys."""
        gui = self._viser.gui
        text = gui.add_text("", MARK + "{}")
        text.on_update(self._typed)
        self.server.expect(text, "text")
        gui.add_html(script_element(taps=self._keys))

    async def _typed(self, event: Any) -> None:  # noqa: ANN401
        try:
            sent = read_keys(str(event.target.value))
        except BetterError as problem:
            self._complain(str(problem))
            return
        known = self._taps.setdefault(int(event.client_id or 0), {})
        for command in new_taps(sent, known, tuple(self._keys.values())):
            self._put(command)

    def _button(self, label: str, command: str, color: Any, hint: str) -> None:  # noqa: ANN401
        button = self._viser.gui.add_button(label, color=color, hint=hint)

        async def pressed(_: Any) -> None:  # noqa: ANN401
            self._put(command)

        button.on_click(pressed)
        self.server.expect(button, "button")

    def _input(self, element: Any, kind: InputKind, command: str | None) -> Any:  # noqa: ANN401
        """Store the values that the user types into a field.

        If a command is given, it is also sent for each new value.
        """
        self.server.expect(element, kind)
        if command is not None:

            async def typed(event: Any) -> None:  # noqa: ANN401
                # The client is None if this program set the value.
                if event.client_id is not None:
                    self._put(command, event.target.value)

            element.on_update(typed)
        return element


def _choose(desk: Desk[Any, Any, Any], mode: str, _: object) -> None:
    desk.choose(mode)


WORKING = '<div style="padding:4px 10px;font-size:13px"><b>working …</b></div>'
"""Status shown while a slow command is running."""
