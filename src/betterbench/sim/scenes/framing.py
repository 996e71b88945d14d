"""Framing checks: whether the front camera shows the gripper, the named objects and the targets well enough.

The limits are constants in this file and apply to every task. They do not affect how trials are judged.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from betterbench.geometry import Pose, Vector, from_yaw
from betterbench.interface.state import CameraOffset, ViewJitter
from betterbench.sim.robots import ArmIK
from betterbench.sim.scenes.appearance import CAMERA_SHIFT_M, CAMERA_TURN_RAD
from betterbench.sim.scenes.builder import slot_pose
from betterbench.sim.scenes.cameras import ViewPlacement, camera_matrices
from betterbench.sim.scenes.instances import ROBOT_PREFIX
from betterbench.sim.scenes.objects import rail_of
from betterbench.sim.scenes.rendering import NO_BODY, Renderer
from betterbench.sim.scenes.scene import Scene
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.tasks import Condition
from betterbench.tasks.relations.closed import MOUNTS

GRIPPER_PX = 60.0
"""Minimum number of pixels of the hand and the fingers in an image of 256 x 256 pixels."""

MARGIN_M = 0.008
"""Minimum distance between the edge of the image and slots or target regions, measured at their depth [m]."""

SIDE_PX = 24.0
"""Minimum length of the longer side of an object's bounding box, for objects that the instruction names [pixel].

The image has 256 x 256 pixels.
"""

VISIBLE = 0.6
"""Minimum fraction of a named object that must be visible, i.e. neither hidden nor cut off by the image's edge."""

BACKGROUND = 0.2
"""Maximum fraction of the image that shows neither table nor robot nor objects."""


SIZE_PX = 256
HOVER_M = 0.12
"""Height of the end effector over a slot at which the gripper must be visible [m]. Grasps from above begin there."""
_REGIONS = ("inside", "ring", "top", "base")


@dataclass(frozen=True, slots=True)
class ObjectFraming:
    """Size and visibility of an object that the instruction names.

    Attributes:
        side_px: Longer side of the bounding box around the object's visible part [pixel].
        visible: Fraction of the object that is inside the image and not occluded.
    """

    name: str
    side_px: float
    visible: float


@dataclass(frozen=True, slots=True)
class Framing:
    """Measurements in an image of the front camera at the start of a trial.

    Attributes:
        gripper_px: Number of pixels of the hand and the fingers.
        background: Fraction of pixels that show neither table nor robot nor objects.
        asked: Framing of the objects that the instruction names, except fixtures.
    """

    gripper_px: int
    background: float
    asked: tuple[ObjectFraming, ...]


class FramingView:
    """Renderer that measures the framing in images of a scene, without changing the scene."""

    def __init__(self, scene: Scene, *, camera: str = "front") -> None:
        """Copy the model of the scene, and create a renderer for the copy."""
        self._scene, self._camera = scene, camera
        self._model = copy.copy(scene.model)
        self._data = mujoco.MjData(self._model)
        self._renderer = Renderer(self._model, width=SIZE_PX, height=SIZE_PX, quality=QUALITIES["fast"])
        robot = scene.compiled.robot
        parts = (robot.hand_body, *robot.finger_bodies)
        self._gripper = [self._model.body(ROBOT_PREFIX + name).id for name in parts]
        names = self._renderer.body_names
        self._background = [NO_BODY, 0, names.index("pedestal")]

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()

    def start(self, jitter: ViewJitter | None = None) -> Framing:
        """Measure the image of the front camera at the start of the trial.

        The camera is moved by the given jitter. By default, the jitter of the trial is used.
        """
        masks = self._masks(self._scene.data.qpos, jitter)
        asked = tuple(self._object(name, masks) for name in asked_objects(self._scene.condition))
        background = float(np.isin(masks, self._background).mean())
        return Framing(int(np.isin(masks, self._gripper).sum()), background, asked)

    def of(self, name: str) -> ObjectFraming:
        """Return the size and visibility of an object in the image at the start of the trial."""
        return self._object(name, self._masks(self._scene.data.qpos, None))

    def gripper_over(self, slot: str, jitter: ViewJitter | None = None) -> int:
        """Return the number of gripper pixels when the end effector is over a slot and points down."""
        place, arm = self._scene.task.slot(slot), ArmIK(self._scene.compiled.robot)
        target = Pose((place.x, place.y, HOVER_M), arm.forward(arm.home).quaternion)
        qpos = self._scene.data.qpos.copy()
        qpos[self._scene.arm_addresses] = arm.reach(arm.home, target).q
        return int(np.isin(self._masks(qpos, jitter), self._gripper).sum())

    def _masks(self, qpos: np.ndarray, jitter: ViewJitter | None) -> np.ndarray:
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        ViewPlacement(self._model, jitter or self._scene.view_jitter).apply(self._data)
        return self._draw()

    def _draw(self, size: int = SIZE_PX) -> np.ndarray:
        masks = self._renderer.render(self._data, self._camera, rgb=False, masks=True, width=size, height=size).masks
        if masks is None:
            raise AssertionError("masks were requested")
        return masks

    def _object(self, name: str, masks: np.ndarray) -> ObjectFraming:
        number = [p.spec.name for p in self._scene.placements].index(name)
        body = int(self._scene.compiled.bodies[number])
        rows, columns = np.nonzero(masks == body)
        if not len(rows):
            return ObjectFraming(name, 0.0, 0.0)
        side = float(max(np.ptp(rows), np.ptp(columns)) + 1)
        return ObjectFraming(name, side, len(rows) / max(self._whole(body), 1))

    def _whole(self, body: int) -> int:
        """Return the number of pixels that a body would cover without occlusion, including pixels outside the image.

        For this, all other bodies are hidden, and an image with twice the width and height is rendered around the same
        center.
        """
        model, camera = self._model, self._model.camera(self._camera).id
        rgba, materials, angle = model.geom_rgba.copy(), model.geom_matid.copy(), float(model.cam_fovy[camera])
        others = model.geom_bodyid != body
        model.geom_matid[others] = -1
        model.geom_rgba[others, 3] = 0.0
        model.cam_fovy[camera] = math.degrees(2.0 * math.atan(2.0 * math.tan(0.5 * math.radians(angle))))
        try:
            return int((self._draw(2 * SIZE_PX) == body).sum())
        finally:
            model.geom_rgba[:], model.geom_matid[:], model.cam_fovy[camera] = rgba, materials, angle


def framing_faults(scene: Scene) -> tuple[str, ...]:
    """Return one sentence for each framing limit that is violated at the start of a trial."""
    view = FramingView(scene)
    try:
        shown = view.start()
    finally:
        view.close()
    found = []
    if shown.gripper_px < GRIPPER_PX:
        found.append(f"the gripper covers {shown.gripper_px} px, expected at least {GRIPPER_PX:g}")
    if shown.background > BACKGROUND:
        found.append(f"{shown.background:.0%} of the image is background, expected at most {BACKGROUND:.0%}")
    for asked in shown.asked:
        if asked.visible < VISIBLE:
            found.append(f"{asked.visible:.0%} of {asked.name} is visible, expected at least {VISIBLE:.0%}")
        elif asked.side_px < SIDE_PX:
            found.append(f"{asked.name} is {asked.side_px:.0f} px long in the image, expected at least {SIDE_PX:g}")
    margin = least_margin_m(scene)
    if margin < MARGIN_M:
        needed = f"expected at least {1e3 * MARGIN_M:g}"
        found.append(f"a slot or target is {1e3 * margin:.0f} mm from the edge of the image, {needed}")
    return tuple(found)


def asked_objects(condition: Condition) -> tuple[str, ...]:
    """Return the names of the objects that an instruction's steps refer to, in order and without duplicates."""
    names: dict[str, None] = {}
    for step in condition.instruction.subgoals:
        found = [o.name for o in condition.objects if step.reference.kind in (None, o.kind)]
        slot = step.reference.slot
        if slot is not None:
            found = [name for name in found if condition.layout.get(name) == slot]
        items = [name for name in found if condition.object(name).role in ("item", "distractor")]
        names.update(dict.fromkeys(items))
    return tuple(names)


def extreme_jitters(camera: str = "front") -> Iterator[ViewJitter]:
    """Yield all extreme jitters of a camera, in which every shift and every rotation is at one end of its range."""
    for signs in itertools.product((-1.0, 1.0), repeat=6):
        x, y, z, rx, ry, rz = signs
        shift, turn = CAMERA_SHIFT_M, CAMERA_TURN_RAD
        offset = CameraOffset((shift * x, shift * y, shift * z), (turn * rx, turn * ry, turn * rz))
        yield ViewJitter({camera: offset})


def least_margin_m(scene: Scene, *, camera: str = "front") -> float:
    """Return the smallest distance of the slots and target regions from the image edge, over all extreme jitters [m].

    The distance is measured at the depth of the point, and is negative for points outside the image.

    A slot is represented by the corners of the area of possible start positions. A target region is represented by its
    corners, for all start positions of the object that it belongs to and with open drawers. If the order of the steps
    is given, targets that an earlier step moves are ignored.
    """
    points = np.array([*_slot_corners(scene), *_target_corners(scene)])
    data, least = copy.copy(scene.data), math.inf
    for jitter in extreme_jitters(camera):
        ViewPlacement(scene.model, jitter).apply(data)
        view = camera_matrices(scene.model, data, camera, width=SIZE_PX, height=SIZE_PX)
        pixels, depths = view.project(points)
        edge = np.minimum(pixels + 0.5, SIZE_PX - 0.5 - pixels).min(axis=1)
        least = min(least, float((edge * depths / view.K[0, 0]).min()))
    return least


def _slot_corners(scene: Scene) -> Iterator[Vector]:
    for slot in scene.task.slots:
        for sx, sy in itertools.product((-slot.jitter_m, slot.jitter_m), repeat=2):
            yield (slot.x + sx, slot.y + sy, 0.0)


def _target_corners(scene: Scene) -> Iterator[Vector]:
    placed = {p.spec.name: p for p in scene.placements}
    moved = set[str]()
    instruction = scene.condition.instruction
    for step in instruction.subgoals:
        stays = step.target not in moved
        if instruction.ordered:
            moved.update(scene.condition.resolve(step.reference))
        # A step that closes a drawer is skipped: the region in the drawer is the target of another step.
        if step.region in MOUNTS or not stays:
            continue
        target = placed[step.target]
        pose = target.pose
        if target.spec.mount is not None and target.shut is not None:
            pose = target.shut @ Pose((rail_of(target.asset).travel_m, 0.0, 0.0))
        regions = {r.name: r for r in target.asset.regions}
        name = next((n for n in (step.region, *_REGIONS) if n in regions), None)
        if name is None:
            continue
        half_x, half_y, _ = regions[name].half_size
        slot = scene.task.slot(_slot_below(scene.condition, step.target))
        position, yaw = slot_pose(scene.task, scene.seed, slot.name)
        in_slot = Pose(position, from_yaw(yaw)).inverse() @ pose @ regions[name].pose
        for dx, dy, turn in itertools.product((-1.0, 1.0), repeat=3):
            at = (slot.x + slot.jitter_m * dx, slot.y + slot.jitter_m * dy, 0.0)
            there = Pose(at, from_yaw(slot.yaw + slot.yaw_jitter * turn)) @ in_slot
            for sx, sy in itertools.product((-half_x, half_x), (-half_y, half_y)):
                yield there.apply((sx, sy, 0.0))


def _slot_below(condition: Condition, name: str) -> str:
    """Return the slot of an object. If it is mounted in or pre-placed on another object, return that object's slot."""
    while name not in condition.layout:
        mount = condition.object(name).mount
        name = condition.preplaced[name].target if mount is None else mount.target
    return condition.layout[name]
