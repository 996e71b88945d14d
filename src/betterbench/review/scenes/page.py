"""Web page for the review of scenes: the 3D scene, gizmos for slots and frames, camera images, and a panel."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from betterbench.browser.keys import key_table
from betterbench.geometry import Pose, from_yaw
from betterbench.interface.observation import observation_spec
from betterbench.review.command_page import WORKING, CommandPage
from betterbench.review.drawing import HULL_COLORS, box_edges
from betterbench.review.panel import queue_list
from betterbench.review.scenes.desk import MODES, STEP_DEGREES, STEP_M, SceneDesk, bodies_of
from betterbench.review.scenes.drawing import foot, head
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.glb import body_files
from betterbench.sim.scenes.rendering import Renderers
from betterbench.sim.scenes.tryouts import collision_surfaces

GIZMO = "/scene/gizmo"
SIDE_PX = 300
EYE_M, LOOK_AT_M = (1.15, -0.55, 0.75), (0.5, 0.0, 0.02)
"""Initial position of the view, and the point that it looks at [m]."""
Shown = Literal["visual", "collision", "both"]
SHOWN: tuple[Shown, ...] = ("visual", "collision", "both")
LEAST_MARK_M = 0.01
"""Minimum half side of the square that marks a slot [m]."""
SLOT_COLOR, CHOSEN_COLOR = (46, 134, 222), (247, 140, 20)

TAP_KEYS: dict[str, str] = {
    "ArrowLeft": "previous",
    "ArrowRight": "next",
    "Digit1": "slot",
    "Digit2": "frame",
    "KeyT": "select",
    "KeyI": "away",
    "KeyK": "near",
    "KeyJ": "left",
    "KeyL": "right",
    "KeyU": "turn left",
    "KeyO": "turn right",
    "Enter": "keep",
    "Escape": "drop edit",
    "KeyV": "view",
    "KeyS": "seed",
    "KeyC": "certify",
    "KeyA": "accept",
    "KeyR": "reject",
    "Backspace": "undo",
}
"""Command that each key sends."""
KEY_ROWS = (
    ("← →", "previous, next scene"),
    ("1 2", "gizmo: slot, placement frame"),
    ("T", "next slot or frame"),
    ("I K, J L", "5 mm away from the robot, nearer; left, right"),
    ("U O", "turn by 5°"),
    ("Enter, Escape", "keep or drop the edit"),
    ("V", "visual shapes, collision shapes, both"),
    ("S", "next seed"),
    ("C", "certify this scene"),
    ("A", "accept (a fix if something was changed)"),
    ("R", "reject, with the reason above"),
    ("Backspace", "undo the last decision"),
)


class ScenePage(CommandPage[SceneDesk]):
    """Web page for one review of scenes."""

    def __init__(self, desk: SceneDesk, *, host: str, port: int) -> None:
        """Start the web server of the page, and build the page.

        Raises:
            MissingDependencyError: If viser is not installed.
            InvalidInputError: If the port is in use.
        """
        super().__init__(desk, TAP_KEYS, host=host, port=port)
        self._spec = observation_spec("default")
        self._renderers = Renderers(2)
        self._view: Shown = "visual"
        self._drawn: Scene | None = None
        self._bodies: dict[int, Any] = {}
        self._touched: dict[str, list[Any]] = {}
        self._do = self._verbs()
        self._build_stage()
        self._build_panel()

    def obey(self, command: str, value: Any, stopped: threading.Event) -> None:  # noqa: ANN401, ARG002 - of the page
        """Execute a command, and show its result on the page."""
        if self._is_of_page(command, value):
            return
        if command in ("next", "previous", "accept", "reject", "keep", "seed", "certify", "undo"):
            # Show that work is in progress, because building or certifying a scene takes seconds.
            self._status.content = WORKING
        if command in self._do:
            self._do[command](value)
        self.show()

    def _verbs(self) -> dict[str, Callable[[Any], object]]:
        desk = self._desk
        still = (0.0, 0.0, 0.0)
        return self._common_verbs(MODES) | {
            "away": lambda _: desk.nudge((STEP_M, 0.0, 0.0)),
            "near": lambda _: desk.nudge((-STEP_M, 0.0, 0.0)),
            "left": lambda _: desk.nudge((0.0, STEP_M, 0.0)),
            "right": lambda _: desk.nudge((0.0, -STEP_M, 0.0)),
            "turn left": lambda _: desk.nudge(still, STEP_DEGREES),
            "turn right": lambda _: desk.nudge(still, -STEP_DEGREES),
            "view": lambda _: self._next_view(),
            "seed": lambda _: desk.step_seed(),
            "certify": lambda _: desk.certify(),
        }

    def _next_view(self) -> None:
        self._view = SHOWN[(SHOWN.index(self._view) + 1) % len(SHOWN)]
        self._desk.message, self._desk.is_problem = f"Shown: {self._view}.", False

    # ---------------------------------------------------------------------------------------------------------- scene

    def _build_stage(self) -> None:
        scene = self._set_stage(0.4)
        scene.add_frame("/scene", show_axes=False)
        self._gizmo = scene.add_transform_controls(GIZMO, scale=0.09, line_width=3.0, depth_test=False)
        self._gizmo.on_update(self._dragged)

    def show(self, *, is_dragging: bool = False) -> None:
        """Update the page. The gizmo is not moved while the user is dragging it."""
        desk = self._desk
        with self._viser.atomic():
            if desk.scene is not self._drawn:
                self._show_scene()
            self._show_poses()
            self._show_marks(is_dragging=is_dragging)
        verdicts = desk.verdicts()
        self._head.content = head(desk, sum(verdict is not None for verdict in verdicts))
        self._status.content = foot(desk)
        self._list.content = queue_list([q.name for q in desk.queue], verdicts, desk.index)

    def _show_scene(self) -> None:
        """Show a new scene: its bodies, the collision parts of its objects, and the images that the policy sees."""
        for node in (*self._bodies.values(), *(n for nodes in self._touched.values() for n in nodes)):
            node.remove()
        self._bodies, self._touched = {}, {}
        self._version += 1
        scene = self._drawn = self._desk.scene
        if scene is None:
            return
        viewer = self._viser.scene
        for number, data in body_files(scene.model).items():
            self._bodies[number] = viewer.add_glb(f"/scene/body{self._version}_{number}", data)
        for i, placement in enumerate(scene.placements):
            parts = []
            for k, (vertices, faces) in enumerate(collision_surfaces(placement.asset)):
                parts.append(
                    viewer.add_mesh_simple(
                        f"/scene/touched{self._version}_{i}_{k}",
                        vertices.astype(np.float32),
                        faces.astype(np.uint32),
                        flat_shading=True,
                        color=HULL_COLORS[k % len(HULL_COLORS)],
                        opacity=0.75,
                        side="double",
                    )
                )
            self._touched[placement.spec.name] = parts
        for name, images in scene.views(self._spec, self._renderers).items():
            if images.rgb is not None:
                self._images[name].image = images.rgb

    def _show_poses(self) -> None:
        scene = self._drawn
        if scene is None:
            return
        positions, quaternions = scene.body_poses()
        bodies, poses = bodies_of(scene), self._desk.poses()
        of_objects = {bodies[name]: name for name in poses}
        for number, node in self._bodies.items():
            name = of_objects.get(number)
            if name is None:
                node.position, node.wxyz = positions[number], quaternions[number]
                continue
            node.position, node.wxyz = poses[name].position, poses[name].quaternion
            node.visible = self._view != "collision"
        for name, parts in self._touched.items():
            for part in parts:
                part.position, part.wxyz = poses[name].position, poses[name].quaternion
                part.visible = self._view != "visual"

    def _show_marks(self, *, is_dragging: bool) -> None:
        """Show all slots or placement frames, and put the gizmo at the selected one."""
        self._begin_marks()
        desk = self._desk
        target = self._mark_slots() if desk.mode == "slot" else self._mark_frames()
        self._gizmo.visible = target is not None
        if target is not None and not is_dragging:
            self._gizmo.position, self._gizmo.wxyz = target.position, target.quaternion

    def _mark_slots(self) -> Pose | None:
        """Mark each slot by a square that covers all positions within the slot's jitter.

        Return the pose of the selected slot.
        """
        desk, chosen = self._desk, self._desk.slot
        for k, slot in enumerate(desk.slots):
            is_chosen = chosen is not None and slot.name == chosen.name
            half = max(slot.jitter_m, LEAST_MARK_M)
            pose = Pose((slot.x, slot.y, 0.002), from_yaw(slot.yaw))
            occupant = desk.condition.occupant(slot.name)
            name = slot.name if occupant is None else f"{slot.name}: {occupant}"
            self._mark(f"slot{k}", name, (half, half, 0.0005), pose, is_chosen=is_chosen)
        return None if chosen is None else Pose((chosen.x, chosen.y, 0.0), from_yaw(chosen.yaw))

    def _mark_frames(self) -> Pose | None:
        """Mark all placement frames, and return the pose of the selected one."""
        desk, poses = self._desk, self._desk.poses()
        chosen, target = desk.frame, None
        for k, (placement, region) in enumerate(desk.frames):
            pose = poses[placement.spec.name] @ region.pose
            is_chosen = chosen is not None and (placement, region.name) == (chosen[0], chosen[1].name)
            x, y, z = region.half_size
            name = f"{placement.spec.name}: {region.name}" if is_chosen else ""
            self._mark(f"frame{k}", name, (x, y, max(z, 0.0005)), pose, is_chosen=is_chosen)
            target = pose if is_chosen else target
        return target

    def _mark(self, key: str, text: str, half: tuple[float, float, float], pose: Pose, *, is_chosen: bool) -> None:
        viewer, name = self._viser.scene, f"/scene/{key}_{self._version}"
        color = CHOSEN_COLOR if is_chosen else SLOT_COLOR
        placed = {"position": pose.position, "wxyz": pose.quaternion}
        self._marks.append(
            viewer.add_line_segments(
                f"{name}_edges",
                box_edges(half),
                color,
                thickness=4.0 if is_chosen else 2.0,
                thickness_units="screen",
                **placed,
            )
        )
        self._marks.append(viewer.add_frame(f"{name}_axes", axes_length=0.03, axes_radius=0.001, **placed))
        if text:
            x, y, z = pose.position
            self._marks.append(viewer.add_label(f"{name}_name", text, position=(x + half[0] + 0.02, y, z + 0.004)))

    # ---------------------------------------------------------------------------------------------------------- panel

    def _build_panel(self) -> None:
        gui = self._begin_panel(EYE_M, LOOK_AT_M)
        self._begin_verdicts(gui)
        self._button("Certify  C", "certify", "blue", "Examines this scene as better certify does.")
        self._button("Visual, collision, both  V", "view", "gray", "Changes which shapes are shown.")
        self._button("Next seed  S", "seed", "gray", "Shows the scene with another seed.")
        self._button("Keep the edit  ⏎", "keep", "gray", "Writes the edit in progress as a change.")
        side = gui.add_panel()
        empty = np.full((256, 256, 3), 40, dtype=np.uint8)
        with side.add_tab("Cameras and keys"):
            self._images = {
                camera.name: gui.add_image(empty, label=camera.name, format="jpeg", jpeg_quality=85)
                for camera in self._spec.cameras
            }
            self._list = gui.add_html("")
            gui.add_html(key_table(KEY_ROWS))
        side.dock_left()
        side.set_width(SIDE_PX)
        self._listen()
