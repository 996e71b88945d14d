"""Web page for the review of objects: visual shape, collision shape, gripper, gizmos, and a panel."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from betterbench.browser.keys import key_table
from betterbench.geometry import Pose, normalize
from betterbench.review.command_page import WORKING, CommandPage
from betterbench.review.desk import FINE_DEGREES, MODES, SIZE_STEP, TURN_DEGREES, ReviewDesk
from betterbench.review.drawing import (
    HULL_COLORS,
    box_edges,
    foot,
    head,
    ruler,
    ruler_labels,
    turned_about_middle,
)
from betterbench.review.panel import queue_list
from betterbench.sim.assets import Asset
from betterbench.sim.assets.importing.review import ScaleChange
from betterbench.sim.scenes.tryouts import (
    FRAME_S,
    Tryout,
    asset_glb,
    collision_surfaces,
    gripper_glbs,
    gripper_poses,
)

TURN_GIZMO, FRAME_GIZMO = "/seen/turn", "/seen/frame"
SIDE_PX = 250
EYE_M, LOOK_AT_M = (0.38, -0.06, 0.25), (0.0, 0.0, 0.085)
"""Initial position of the view, and the point that it looks at [m]."""
OPEN_M = 0.08
"""Opening of the gripper that is shown next to the object for scale [m]."""
TAP_KEYS: dict[str, str] = {
    "ArrowLeft": "previous",
    "ArrowRight": "next",
    "Digit1": "pose",
    "Digit2": "support",
    "Digit3": "grasp",
    "Digit4": "frame",
    "KeyX": "x+90",
    "KeyY": "y+90",
    "KeyZ": "z+90",
    "KeyJ": "x-5",
    "KeyL": "x+5",
    "KeyI": "y-5",
    "KeyK": "y+5",
    "KeyU": "z-5",
    "KeyO": "z+5",
    "BracketLeft": "smaller",
    "BracketRight": "larger",
    "KeyT": "select",
    "KeyN": "new",
    "Delete": "remove",
    "Enter": "keep",
    "Escape": "drop edit",
    "KeyD": "drop test",
    "KeyG": "lift test",
    "KeyA": "accept",
    "KeyR": "reject",
    "Backspace": "undo",
}
"""Command that each key sends."""
KEY_ROWS = (
    ("← →", "previous, next object"),
    ("1 2 3 4", "gizmo: pose, support plane, grasp, frame"),
    ("X Y Z", "turn by 90° about red, green, blue"),
    ("J L, I K, U O", "turn by 5° about red, green, blue"),
    ("[ ]", "5 % smaller, larger"),
    ("T", "next grasp or frame"),
    ("N, Delete", "new grasp or frame; remove it"),
    ("Enter, Escape", "keep or drop the edit"),
    ("D, G", "drop test; lift test with the selected grasp"),
    ("A", "accept (a fix if something was changed)"),
    ("R", "reject, with the reason above"),
    ("Backspace", "undo the last decision"),
)


class ReviewPage(CommandPage[ReviewDesk]):
    """Web page for one review of objects."""

    def __init__(self, desk: ReviewDesk, *, host: str, port: int) -> None:
        """Start the web server of the page, and build the page.

        Raises:
            MissingDependencyError: If viser is not installed.
            InvalidInputError: If the port is in use.
        """
        super().__init__(desk, TAP_KEYS, host=host, port=port)
        self._shown: tuple[object, ...] = ()
        self._nodes: list[Any] = []
        self._visual: Any = None
        self._asset: Asset | None = None
        self._gripper: dict[str, Any] = {}
        self._opened = gripper_poses(OPEN_M)
        self._do = self._verbs()
        self._build_scene()
        self._build_panel()

    def obey(self, command: str, value: Any, stopped: threading.Event) -> None:  # noqa: ANN401 - of the page
        """Execute a command, and show its result on the page."""
        tryout: Tryout | None = None
        if self._is_of_page(command, value):
            return
        if command in ("next", "previous", "accept", "reject", "keep", "drop test", "lift test"):
            # Show that work is in progress, because importing an object and computing its shapes takes seconds.
            self._status.content = WORKING
        if command in ("drop test", "lift test"):
            tryout = self._desk.try_drop() if command == "drop test" else self._desk.try_lift()
        elif command in self._do:
            self._do[command](value)
        self.show()
        if tryout is not None:
            self._play(tryout, stopped)
            self._shown = ()
            self.show()

    def _verbs(self) -> dict[str, Callable[[Any], object]]:
        desk = self._desk
        axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
        do: dict[str, Callable[[Any], object]] = {
            "smaller": lambda _: desk.size_by(1.0 / SIZE_STEP),
            "larger": lambda _: desk.size_by(SIZE_STEP),
            "new": lambda _: desk.add(),
            "remove": lambda _: desk.remove(),
            "size": lambda value: desk.size(float(value) / 100.0),
            "mass": lambda value: desk.weigh(float(value) / 1000.0),
            "name": lambda value: desk.call(str(value)),
        }
        for name, axis in axes.items():
            for degrees in (TURN_DEGREES, FINE_DEGREES, -FINE_DEGREES):
                do[f"{name}{degrees:+.0f}"] = _turning(desk, axis, degrees)
        return do | self._common_verbs(MODES)

    # ---------------------------------------------------------------------------------------------------------- scene

    def _build_scene(self) -> None:
        scene = self._set_stage(0.45)
        scene.add_grid(
            "/table",
            2.0,
            2.0,
            cell_size=0.01,
            section_size=0.1,
            cell_color=(226, 229, 233),
            section_color=(180, 186, 194),
            cell_thickness=0.6,
            section_thickness=1.0,
            plane_color=(246, 247, 249),
            plane_opacity=1.0,
            position=(0.0, 0.0, -0.0008),
        )
        self._seen = scene.add_frame("/seen", show_axes=False)
        self._touched = scene.add_frame("/touched", show_axes=False)
        self._turn = scene.add_transform_controls(
            TURN_GIZMO, scale=0.09, line_width=3.0, disable_axes=True, disable_sliders=True, depth_test=False
        )
        self._frame = scene.add_transform_controls(FRAME_GIZMO, scale=0.06, line_width=3.0, depth_test=False)
        for gizmo in (self._turn, self._frame):
            gizmo.on_update(self._dragged)
        for name, data in gripper_glbs().items():
            self._gripper[name] = scene.add_glb(f"/seen/gripper_{name}", data, cast_shadow=False)

    def show(self, *, is_dragging: bool = False) -> None:
        """Update the page. The gizmo is not moved while the user is dragging it."""
        desk = self._desk
        key = (desk.index, len(desk.at_hand.states), desk.history.last)
        with self._viser.atomic():
            if key != self._shown:
                self._show_object()
                self._shown = key
            self._show_edit(is_dragging=is_dragging)
        self._head.content, self._status.content = head(desk), foot(desk)
        self._list.content = queue_list([q.name for q in desk.queue], desk.verdicts(), desk.index)

    def _show_object(self) -> None:
        """Show the meshes of the object with all saved changes. Show its size, mass and name in the panel."""
        for node in self._nodes:
            node.remove()
        self._nodes, self._visual = [], None
        self._version += 1
        seen, touched = f"/seen/object{self._version}", f"/touched/object{self._version}"
        asset = self._asset = self._desk.asset
        scene = self._viser.scene
        for node in (*self._gripper.values(), self._turn, self._frame):
            node.visible = asset is not None
        if asset is None:
            return
        apart = max(0.12, 0.5 * asset.size_m[1] + 0.07)
        self._seen.position, self._touched.position = (0.0, -apart, 0.0), (0.0, apart, 0.0)
        self._visual = scene.add_glb(f"{seen}_visual", asset_glb(asset))
        self._nodes.append(self._visual)
        for k, (vertices, faces) in enumerate(collision_surfaces(asset)):
            self._nodes.append(
                scene.add_mesh_simple(
                    f"{touched}_part{k}",
                    vertices.astype(np.float32),
                    faces.astype(np.uint32),
                    flat_shading=True,
                    color=HULL_COLORS[k % len(HULL_COLORS)],
                    opacity=0.75,
                    side="double",
                )
            )
        front = 0.5 * asset.size_m[0] + 0.05
        for name, text in ((seen, "visual shape"), (touched, "collision shape")):
            label = scene.add_label(
                f"{name}_title", text, position=(front, 0.0, 0.0), anchor="top-center", font_screen_scale=1.1
            )
            self._nodes.append(label)
        for name in (seen, touched):
            self._nodes.append(
                scene.add_line_segments(
                    f"{name}_ruler", ruler(asset.size_m), (70, 80, 95), thickness=1.5, thickness_units="screen"
                )
            )
        for k, (text, at) in enumerate(ruler_labels(asset.size_m)):
            self._nodes.append(scene.add_label(f"{seen}_length{k}", text, position=at, anchor="center-center"))
        self._size.value = round(100 * max(asset.size_m), 2)
        self._mass.value = round(1000 * asset.mass_kg, 1)
        self._name.value = "" if self._desk.state is None else self._desk.state.name

    def _show_edit(self, *, is_dragging: bool) -> None:
        """Show the edit in progress, and place the gizmo at the element that it controls."""
        desk, asset = self._desk, self._asset
        self._begin_marks()
        if asset is None or self._visual is None:
            return
        shown = turned_about_middle(asset, Pose((0.0, 0.0, 0.0), desk.turn))
        self._visual.position, self._visual.wxyz = shown.position, shown.quaternion
        factor = desk.edit.after / desk.edit.before if isinstance(desk.edit, ScaleChange) else 1.0
        self._visual.scale = factor
        self._turn.visible, self._frame.visible = desk.mode == "pose", desk.mode != "pose"
        gizmo = Pose((0.0, 0.0, 0.5 * asset.size_m[2]), desk.turn)
        opened = OPEN_M
        grip = Pose((0.0, 0.0, asset.size_m[2] + 0.035), (0.0, 1.0, 0.0, 0.0))
        if desk.mode == "support":
            gizmo = self._mark_support(asset)
        elif desk.mode == "grasp" and desk.grasp is not None:
            gizmo = grip = desk.grasp.pose
            opened = min(OPEN_M, desk.grasp.width_m + 2.0 * desk.grasp.clearance_m)
            for k, grasp in enumerate(asset.grasps):
                self._mark_frame(f"/seen/grasp{self._version}_{k}", grasp.pose)
        elif desk.mode == "frame":
            gizmo = self._mark_regions(asset)
        self._frame.visible = self._frame.visible and (desk.mode != "grasp" or desk.grasp is not None)
        for node in self._gripper.values():
            node.visible = desk.mode in ("pose", "grasp")
        self._place_gripper({name: grip @ _closer(pose, opened) for name, pose in self._opened.items()})
        target = self._turn if desk.mode == "pose" else self._frame
        if not is_dragging:
            target.position, target.wxyz = gizmo.position, gizmo.quaternion

    def _mark_frame(self, name: str, pose: Pose) -> None:
        frame = self._viser.scene.add_frame(
            name, axes_length=0.015, axes_radius=0.0006, position=pose.position, wxyz=pose.quaternion
        )
        self._marks.append(frame)

    def _mark_support(self, asset: Asset) -> Pose:
        """Show the support plane, and return the pose for its gizmo."""
        plane = self._desk.plane
        x, y, z = plane.normal
        turn = normalize((1.0 + z, -y, x, 0.0)) if z > -0.999 else (0.0, 1.0, 0.0, 0.0)
        pose = Pose((x * plane.height_m, y * plane.height_m, z * plane.height_m), turn)
        side = 1.3 * max(asset.size_m[:2])
        self._marks.append(
            self._viser.scene.add_box(
                f"/seen/support{self._version}",
                (46, 134, 222),
                (side, side, 0.0006),
                opacity=0.35,
                cast_shadow=False,
                position=pose.position,
                wxyz=pose.quaternion,
            )
        )
        return pose

    def _mark_regions(self, asset: Asset) -> Pose:
        """Show all placement frames, and return the pose of the selected one."""
        chosen = self._desk.region
        others = [region for region in asset.regions if chosen is None or region.name != chosen.name]
        for k, region in enumerate([*others, *([] if chosen is None else [chosen])]):
            is_chosen = region is chosen
            x, y, z = region.half_size
            color = (247, 140, 20) if is_chosen else (96, 115, 140)
            placed = {"position": region.position, "wxyz": region.quaternion}
            scene, name = self._viser.scene, f"/seen/region{self._version}_{k}"
            self._marks += [
                scene.add_box(
                    name,
                    color,
                    (2 * x, 2 * y, max(2 * z, 0.001)),
                    opacity=0.6 if is_chosen else 0.2,
                    cast_shadow=False,
                    **placed,
                ),
                scene.add_line_segments(
                    f"{name}_edges",
                    box_edges(region.half_size),
                    color,
                    thickness=4.0 if is_chosen else 2.0,
                    thickness_units="screen",
                    **placed,
                ),
            ]
        if chosen is None:
            return Pose()
        name = f"/seen/region{self._version}_name"
        x, y, z = chosen.position
        self._marks.append(self._viser.scene.add_label(name, chosen.name, position=(x, y - 0.02, z + 0.015)))
        return chosen.pose

    def _place_gripper(self, poses: dict[str, Pose]) -> None:
        for name, pose in poses.items():
            self._gripper[name].position, self._gripper[name].wxyz = pose.position, pose.quaternion

    def _play(self, tryout: Tryout, stopped: threading.Event) -> None:
        """Play the motion of a simulated test in real time. Late frames are skipped."""
        if self._visual is None:
            return
        self._turn.visible = self._frame.visible = False
        for node in self._marks:
            node.remove()
        self._marks = []
        for node in self._gripper.values():
            node.visible = bool(tryout.gripper)
        began = time.monotonic()
        last = len(tryout.asset) - 1
        while not stopped.is_set():
            k = min(last, int((time.monotonic() - began) / FRAME_S))
            with self._viser.atomic():
                self._visual.position, self._visual.wxyz = tryout.asset[k, :3], tryout.asset[k, 3:]
                for name, rows in tryout.gripper.items():
                    self._gripper[name].position, self._gripper[name].wxyz = rows[k, :3], rows[k, 3:]
            if k == last:
                break
            time.sleep(FRAME_S)
        stopped.wait(0.8)

    # ---------------------------------------------------------------------------------------------------------- panel

    def _build_panel(self) -> None:
        gui = self._begin_panel(EYE_M, LOOK_AT_M)
        self._begin_verdicts(gui)
        self._button("Drop test  D", "drop test", "blue", "Drops the object on a table, in simulation.")
        self._button("Lift test  G", "lift test", "blue", "Lifts the object by the selected grasp, in simulation.")
        self._size = self._input(gui.add_number("longest side [cm]", 10.0, step=0.1), "number", "size")
        self._mass = self._input(gui.add_number("mass [g]", 100.0, step=1.0), "number", "mass")
        self._name = self._input(gui.add_text("name", ""), "text", "name")
        self._button("Keep the edit  ⏎", "keep", "gray", "Writes the edit in progress as a change.")
        side = gui.add_panel()
        with side.add_tab("Queue and keys"):
            self._list = gui.add_html("")
            gui.add_html(key_table(KEY_ROWS))
        side.dock_left()
        side.set_width(SIDE_PX)
        self._listen()


def _closer(pose: Pose, opened_m: float) -> Pose:
    """Return the pose of a gripper finger when the gripper is opened by ``opened_m`` [m].

    ``pose`` is the finger's pose when the gripper is fully open. The fingers move along the y axis.
    """
    x, y, z = pose.position
    return Pose((x, y * opened_m / OPEN_M, z), pose.quaternion)


def _turning(desk: ReviewDesk, axis: tuple[float, float, float], degrees: float) -> Callable[[Any], None]:
    return lambda _: desk.turn_by(axis, degrees)
