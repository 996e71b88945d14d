"""Base of the pages of ``better review``: a queue of commands from keys, buttons and fields of a browser page.

Callbacks of the page only put commands into a queue; :meth:`CommandPage.run` executes them in order.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Mapping
from typing import Any

import numpy as np

from betterbench.browser.incoming import InputKind
from betterbench.browser.keys import MARK, new_taps, read_keys, script_element
from betterbench.browser.server import PageServer
from betterbench.errors import BetterError
from betterbench.geometry import Pose, Vector, normalize

PANEL_PX = 380
MOST_WAITING = 200
"""Maximum number of queued commands; a person does not send more."""


class CommandPage:
    """A page whose keys, buttons and fields send commands; a subclass executes them.

    Attributes:
        server: The server of the page.
    """

    def __init__(self, taps: Mapping[str, str], *, host: str, port: int) -> None:
        """Listen.

        Args:
            taps: Command of each key, by key code.
            host: Interface.
            port: Port; 0 for any free port.

        Raises:
            MissingDependencyError: If viser is not installed.
            InvalidInputError: If the port is taken.
        """
        self._commands: queue.Queue[tuple[str, Any]] = queue.Queue(MOST_WAITING)
        self.server = PageServer(host=host, port=port, verb="better review", complain=self._complain)
        self._viser = self.server.viser
        self._keys = dict(taps)
        self._taps: dict[int, dict[str, int]] = {}

    def begin(self) -> None:
        """Show the first item of the queue."""
        raise NotImplementedError

    def obey(self, command: str, value: Any, stopped: threading.Event) -> None:  # noqa: ANN401 - of the page
        """Execute a command, and show the result."""
        raise NotImplementedError

    def run(self, stopped: threading.Event) -> None:
        """Execute the commands of the page until the event is set."""
        self.begin()
        while not stopped.is_set():
            try:
                command, value = self._commands.get(timeout=0.1)
            except queue.Empty:
                continue
            while command == "drag" and not self._commands.empty():  # only the newest pose of a drag is used
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

    # ---------------------------------------------------------------------------------------------------------- panel

    def _begin_panel(self, eye: Vector, look_at: Vector) -> Any:  # noqa: ANN401 - viser's
        """Set up the empty panel and the view, and return the maker of panel elements."""
        gui = self._viser.gui
        gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=False, brand_color=(46, 134, 222))
        gui.set_panel_label("better review")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_PX)
        camera = self._viser.initial_camera
        camera.position, camera.look_at = eye, look_at
        return gui

    def _listen(self) -> None:
        """Accept the keys of the page."""
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
        """Accept typed values of a field; with a command, each new value sends it."""
        self.server.expect(element, kind)
        if command is not None:

            async def typed(event: Any) -> None:  # noqa: ANN401
                if event.client_id is not None:  # typed by a person; None means that this program set the value
                    self._put(command, event.target.value)

            element.on_update(typed)
        return element


WORKING = '<div style="padding:4px 10px;font-size:13px"><b>working …</b></div>'
"""Content of the status while a command takes seconds."""
