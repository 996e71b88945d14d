"""Browser page with the 3-D scene, the gizmo, the control panel and camera images.

The page is served by viser and connects only to this process. The page sends input to
:class:`~betterbench.demonstrations.teleop.controls.Controls` and receives its content from the control loop. The page
and the control loop do not wait for each other.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from betterbench.browser.keys import MARK, key_table, script_element
from betterbench.browser.server import PageServer
from betterbench.demonstrations.teleop.controls import GAMEPAD_TAPS, KEYS, TAP_KEYS, Controls, Tap
from betterbench.demonstrations.teleop.steering import SLOWEST
from betterbench.geometry import Pose
from betterbench.quoting import markup_text

GIZMO = "/tool"
GIZMO_M = 0.20
"""Length of the gizmo's arrows [m]."""
EYE_M, LOOK_AT_M = (-0.25, -0.70, 0.68), (0.42, 0.0, 0.10)
"""Initial position and target of the camera [m].

It looks over the robot's right shoulder, so that "forward" points away from the operator.
"""
PANEL_PX, IMAGES_PX = 380, 300
TOLD_EVERY_S = 3.0
"""Minimum time between two notices on a page that does not control the robot [s]."""


@dataclass(frozen=True, slots=True)
class PanelState:
    """Content of the control panel. Only changes are sent to the page.

    Attributes:
        title: Headline with the demonstration and the number of saved demonstrations.
        instruction: Instruction of the demonstration.
        subgoals: Text of each subgoal, and whether it is done.
        share: Fraction of the step limit that has been used.
        clock: Elapsed time and time limit, as text.
        status: State of the episode, in a few words.
        tone: Color of the status: "go", "wait", "good" or "bad".
        notice: Reason why the tool cannot follow or a request failed; "" if there is none.
        said: The most recent messages, in order of time.
        undo_to: Name of the moment to which an undo would return.
        closed: Whether the gripper should be closed.
        can_save: Whether the episode can be saved.
        height: Text with the height of the tool above the table; "" if no episode is loaded.
        images: Text with the delay of the camera images; "" if they are up to date.
    """

    title: str
    instruction: str
    subgoals: tuple[tuple[str, bool], ...]
    share: float
    clock: str
    status: str
    tone: str
    notice: str
    said: tuple[str, ...]
    undo_to: str
    closed: bool
    can_save: bool
    height: str = ""
    images: str = ""


class Page:
    """Server of the teleoperation page, which uses viser."""

    def __init__(self, controls: Controls, *, host: str, port: int, cameras: Sequence[str]) -> None:
        """Start the server, and build the page.

        Raises:
            MissingDependencyError: If viser is not installed.
            InvalidInputError: If the port is already in use.
        """
        self._controls = controls
        self._page = PageServer(host=host, port=port, verb="better teleop", complain=controls.complain)
        self._server, self.port = self._page.viser, self._page.port
        self._told: dict[int, float] = {}
        self._shown: PanelState | None = None
        self._bodies: dict[int, Any] = {}
        self._poses: dict[int, bytes] = {}
        self._gizmo: Any = None
        self._gizmo_at: Pose | None = None
        self._build_scene()
        self._build_panel()
        self._images = self._build_images(cameras)
        self._server.on_client_connect(self._connected)
        self._server.on_client_disconnect(self._disconnected)

    @property
    def url(self) -> str:
        """Address of the page, including the token that grants access."""
        return self._page.url

    @property
    def view_yaw(self) -> float:
        """Viewing direction on the page that controls the robot, seen from above [rad].

        The value is 0 if the view is directed away from the robot's base.
        """
        client = self._server.get_clients().get(self._controls.driver if self._controls.driver is not None else -1)
        if client is None:
            return 0.0
        along = np.asarray(client.camera.look_at) - np.asarray(client.camera.position)
        if not np.isfinite(along).all() or float(np.hypot(along[0], along[1])) < 1e-6:
            return 0.0
        return float(math.atan2(along[1], along[0]))

    @property
    def speed(self) -> float:
        """Speed set by the slider, as a fraction of the full speed."""
        return max(SLOWEST, min(1.0, float(self._speed.value) / 100.0))

    def close(self) -> None:
        """Close all connections and stop the server, see :meth:`~betterbench.browser.server.PageServer.close`."""
        self._page.close()

    @property
    def is_busy(self) -> bool:
        """Whether the server is still waiting for a page to close."""
        return self._page.is_busy

    def show_scene(self, files: Mapping[int, bytes]) -> None:
        """Show the bodies of another scene, given as the content of a GLB file for each body index."""
        with self._server.atomic():
            for node in self._bodies.values():
                node.remove()
            self._poses = {}
            self._bodies = {n: self._server.scene.add_glb(f"/bodies/{n}", data) for n, data in files.items()}

    def show_state(self, positions: np.ndarray, quaternions: np.ndarray, gizmo: Pose | None) -> None:
        """Show the poses of the bodies and of the gizmo.

        Args:
            positions: (n, 3) positions of the bodies [m].
            quaternions: (n, 4) orientations of the bodies.
            gizmo: Pose of the gizmo; None if the operator is dragging it.
        """
        with self._server.atomic():
            for number, node in self._bodies.items():
                pose = np.concatenate([positions[number], quaternions[number]]).round(5)
                if self._poses.get(number) != pose.tobytes():
                    self._poses[number] = pose.tobytes()
                    node.position, node.wxyz = pose[:3], pose[3:]
            if gizmo is not None and gizmo != self._gizmo_at:
                self._gizmo.position, self._gizmo.wxyz = gizmo.position, gizmo.quaternion
            self._gizmo_at = gizmo

    def show(self, shown: PanelState) -> None:
        """Show the given content in the panel."""
        if shown == self._shown:
            return
        before, self._shown = self._shown, shown
        head, foot = _head(shown), _foot(shown)
        if before is None or _head(before) != head:
            self._head.content = head
        if before is None or _foot(before) != foot:
            self._foot.content = foot
        if before is None or before.closed != shown.closed:
            self._gripper.label = f"{'Open' if shown.closed else 'Close'} gripper  ␣"
        if before is None or before.undo_to != shown.undo_to:
            self._undo.label = f"Undo to {shown.undo_to}  Z"
        if before is None or before.can_save != shown.can_save:
            self._save.disabled = not shown.can_save

    def show_image(self, camera: str, image: np.ndarray) -> None:
        """Show the image of a camera, (height, width, 3) uint8. Called by the thread that renders."""
        self._images[camera].image = image

    def _connected(self, client: Any) -> None:  # noqa: ANN401 - viser's
        if not self._controls.connected(client.client_id):
            self._tell(client.client_id, again=True)

    def _disconnected(self, client: Any) -> None:  # noqa: ANN401
        self._told.pop(client.client_id, None)
        self._controls.disconnected(client.client_id)

    def _tell(self, page: int, *, again: bool = False) -> None:
        """Tell the operator of a page that it does not control the robot.

        The message appears at most once per interval.
        """
        now = time.monotonic()
        client = self._server.get_clients().get(page)
        if client is None or (not again and now - self._told.get(page, 0.0) < TOLD_EVERY_S):
            return
        self._told[page] = now
        text = "Another page controls the robot. Press “Drive from this page” to take over."
        client.add_notification("Looking on", text, auto_close_seconds=6.0, color="yellow")

    def _build_scene(self) -> None:
        scene = self._server.scene
        scene.set_up_direction("+z")
        scene.world_axes.visible = False
        scene.configure_environment_map("studio", environment_intensity=0.35)
        scene.configure_default_lights(enabled=True, cast_shadow=True)
        camera = self._server.initial_camera
        camera.position, camera.look_at = EYE_M, LOOK_AT_M
        self._gizmo = scene.add_transform_controls(GIZMO, scale=GIZMO_M, line_width=3.0, depth_test=False, opacity=0.9)

        async def moved(event: Any) -> None:  # noqa: ANN401
            at, turn = event.target.position, event.target.wxyz
            pose = Pose(tuple(map(float, at)), tuple(map(float, turn)))  # type: ignore[arg-type] # three and four
            if not self._controls.dragged(event.client_id, pose, is_over=event.phase == "end"):
                # With this value, the next update moves the gizmo back.
                self._gizmo_at = None
                self._tell(event.client_id)

        self._gizmo.on_update(moved)

    def _build_panel(self) -> None:
        gui = self._server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=True, brand_color=(46, 134, 222))
        gui.set_panel_label("better teleop")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_PX)
        self._head = gui.add_html("")
        self._gripper = self._button("Close gripper  ␣", "gripper", "blue", "Shortcut: Space.")
        self._undo = self._button("Undo", "undo", "orange", "Shortcut: Z. Undone steps are not recorded.")
        self._foot = gui.add_html("")
        self._save = self._button("Save  ⏎", "save", "green", "Saves the demonstration and goes to the next start.")
        self._save.disabled = True
        self._button("Reset to the start", "restart", "gray", "Restarts this demonstration.")
        self._button(
            "Discard, next start", "discard", "red", "Discards the demonstration. This start is repeated later."
        )
        self._speed = gui.add_slider(
            "speed [%]", min=round(100 * SLOWEST), max=100, step=5, initial_value=60, hint="Share of the full speed."
        )
        take = gui.add_button("Drive from this page", color="gray", hint="Takes over from another page.")

        async def taken(event: Any) -> None:  # noqa: ANN401
            self._controls.take_over(event.client_id)

        take.on_click(taken)
        self._page.expect(take, "button")
        self._page.expect(self._speed, "number")
        with gui.add_folder("Keys", expand_by_default=True):
            gui.add_html(_KEY_TABLE)
        text = gui.add_text("", MARK + "{}")

        async def typed(event: Any) -> None:  # noqa: ANN401
            if not self._controls.sent(event.client_id, str(event.target.value), time.monotonic()):
                self._tell(event.client_id)

        text.on_update(typed)
        self._page.expect(text, "text")
        gui.add_html(script_element(taps=TAP_KEYS, held=tuple(KEYS), gamepad=GAMEPAD_TAPS))

    def _button(self, label: str, tap: Tap, color: Any, hint: str) -> Any:  # noqa: ANN401
        button = self._server.gui.add_button(label, color=color, hint=hint)

        async def pressed(event: Any) -> None:  # noqa: ANN401
            if not self._controls.tapped(event.client_id, tap):
                self._tell(event.client_id)

        button.on_click(pressed)
        self._page.expect(button, "button")
        return button

    def _build_images(self, cameras: Sequence[str]) -> dict[str, Any]:
        if not cameras:
            return {}
        gui = self._server.gui
        panel = gui.add_panel()
        empty = np.full((256, 256, 3), 40, dtype=np.uint8)
        with panel.add_tab("Cameras"):
            made = {name: gui.add_image(empty, label=name, format="jpeg", jpeg_quality=85) for name in cameras}
        panel.dock_left()
        panel.set_width(IMAGES_PX)
        return made


_COLORS = {"go": "#2e86de", "wait": "#8395a7", "good": "#20bf6b", "bad": "#eb3b5a"}


def _head(shown: PanelState) -> str:
    """Return the upper part of the panel as HTML, with the instruction and the state of each subgoal."""
    rows = "".join(
        f'<div style="padding:2px 0;color:{"#20bf6b" if done else "inherit"}">'
        f"<b>{'✔' if done else '○'}</b>&ensp;{markup_text(text)}</div>"
        for text, done in shown.subgoals
    )
    return (
        f'<div style="padding:4px 10px;font-size:13px;line-height:1.4">'
        f'<div style="opacity:.65;font-size:12px">{markup_text(shown.title)}</div>'
        f'<div style="font-size:16px;font-weight:600;margin:6px 0">{markup_text(shown.instruction)}</div>{rows}</div>'
    )


def _foot(shown: PanelState) -> str:
    """Return the lower part of the panel as HTML, with the status and the messages."""
    color = _COLORS[shown.tone]
    notice = markup_text(shown.notice)
    said = "".join(f'<div style="opacity:.7">{markup_text(line)}</div>' for line in shown.said)
    percent = f"{100.0 * min(1.0, shown.share):.0f}"
    return (
        f'<div style="padding:4px 10px;font-size:13px;line-height:1.4">'
        f'<div style="height:4px;background:#8884;border-radius:2px;margin-bottom:6px">'
        f'<div style="height:4px;width:{percent}%;background:{color};border-radius:2px"></div></div>'
        f'<div><b style="color:{color}">{markup_text(shown.status)}</b>'
        f'<span style="float:right;opacity:.65">{markup_text(shown.clock)}</span></div>'
        f'<div style="opacity:.8">{markup_text(shown.height)}</div>'
        f'<div style="opacity:.65">{markup_text(shown.images)}</div>'
        f'<div style="color:#f7b731;min-height:18px">{notice}</div>{said}</div>'
    )


_KEY_TABLE = key_table(
    (
        ("W A S D", "away, left, back, right, as you look"),
        ("R F", "up, down"),
        ("Q E", "turn left, right"),
        ("I K, J L", "tilt, roll"),
        ("Shift", "a quarter of the speed"),
        ("Space", "close or open the gripper"),
        ("Z", "undo to the last subgoal"),
        ("Enter", "save"),
        ("gamepad", "sticks, triggers; A gripper, B undo, Start save"),
        ("SpaceMouse", "six axes; left button gripper, right button undo"),
    )
)
