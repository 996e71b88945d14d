"""Sights: rendered views of a scene state, with their ground truth (body masks, camera pose and boxes of objects).

The same class renders live scenes and recorded states, so both give the same numbers.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np

from betterbench.interface.state import ViewJitter
from betterbench.interface.state.seen import Box
from betterbench.interface.state.world import GRIPPER_BODIES
from betterbench.records.modalities.labels import STAGE
from betterbench.records.modalities.spec import PlacedCamera, ViewSpec
from betterbench.sim.scenes.cameras import CameraMatrices, camera_matrices, camera_number, focal_length_px
from betterbench.sim.scenes.instances import instances_of_bodies, object_bodies, visible_boxes
from betterbench.sim.scenes.rendering import Renderer
from betterbench.sim.scenes.stage import Quality
from betterbench.sim.scenes.stored import StoredState

_NEAR_M = 0.01
_SUNK_M = 0.002
"""Maximum depth by which an object may sink into the table and still be considered above it [m]."""
_LAST_FURNITURE = 1 + STAGE.index("pedestal")
_CORNERS = np.stack(np.meshgrid((-1, 1), (-1, 1), (-1, 1), indexing="ij"), axis=-1).reshape(8, 3).astype(np.float64)
_NO_BOX = (-1, -1, -1, -1)

GRIPPER_INSTANCES = tuple(1 + STAGE.index(name) for name in sorted(GRIPPER_BODIES))
"""Instance ids of the parts of the gripper."""


def sight_type(
    view: ViewSpec, modalities: Collection[str], *, bodies: int, objects: int, gripper: bool = False
) -> np.dtype[np.void]:
    """Return the NumPy structured type of one rendered view. Its byte layout is the same in every process.

    Images that none of the modalities needs are omitted. The fields are:

    - ``rgb`` (height, width, 3), ``depth`` (height, width) [m];
    - ``bodies`` (height, width): the body id plus one, or 0 for the sky;
    - ``camera`` (7,): the pose ``T_world_camera``, as position [m] and quaternion (w, x, y, z);
    - ``poses`` (bodies, 7): the poses ``T_world_body``;
    - ``visible_box`` and ``full_box`` (objects, 4): the boxes (:data:`betterbench.interface.state.seen.Box`) around the
      visible part of each object and around its unoccluded outline, or -1 if there is no such pixel;
    - ``visible_pixels`` and ``full_pixels`` (objects,): the numbers of pixels in the visible part and in the unoccluded
      outline;
    - ``gripper_pixels`` (2,), only with ``gripper``: the numbers of visible and of unoccluded pixels of the gripper.
    """
    shape = view.height, view.width
    images = {"rgb": ("u1", (*shape, 3)), "depth": ("<f4", shape), "bodies": ("<u2", shape)}
    needed = {"rgb": {"rgb"}, "depth": {"depth", "flow"}, "bodies": {"instances", "semantics", "boxes", "flow"}}
    fields = [(name, *kind) for name, kind in images.items() if needed[name] & set(modalities)]
    boxes = [
        ("visible_box", "<i2", (objects, 4)),
        ("full_box", "<i2", (objects, 4)),
        ("visible_pixels", "<i4", (objects,)),
        ("full_pixels", "<i4", (objects,)),
    ]
    rest = [("camera", "<f8", (7,)), ("poses", "<f8", (bodies, 7)), *(boxes if "boxes" in modalities else ())]
    rest += [("gripper_pixels", "<i4", (2,))] if gripper else []
    return np.dtype([*fields, *rest])


@dataclass(frozen=True, slots=True, eq=False)
class ModelFacts:
    """Properties of a model that are the same in all its rendered views.

    Attributes:
        instances: Instance id of each body (bodies,).
        object_bodies: Body id of each object (objects,).
        boxes: Center and half extents of each object's visible shape in its own frame (objects, 2, 3) [m].
        focal_px: Focal length of each view [pixel].
    """

    instances: np.ndarray
    object_bodies: np.ndarray
    boxes: np.ndarray
    focal_px: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """Rendered view: its index, its camera in the model, and the masks and the depth of its image."""

    number: int
    camera: str
    matrices: CameraMatrices
    masks: np.ndarray
    depth: np.ndarray


@dataclass(frozen=True, slots=True)
class _Part:
    """Image region around an object, with the height of the object's lowest point and its largest depth [m]."""

    rect: Box
    low_m: float
    far_m: float


class Sights:
    """Renderer of the states of a model, one after another, in the same views."""

    def __init__(
        self,
        model: mujoco.MjModel,
        quality: Quality,
        views: Sequence[ViewSpec],
        modalities: Collection[str],
        *,
        gripper: bool = False,
    ) -> None:
        """Upload the model. Raises the same errors as :class:`~betterbench.sim.scenes.rendering.Renderer`.

        If ``gripper`` is True, the pixels of the gripper are counted too.
        """
        self.model, self.views = model, tuple(views)
        self._bodies = object_bodies(model)
        self._boxes = visible_boxes(model, self._bodies)
        self._corners = self._boxes[:, None, 0] + _CORNERS * self._boxes[:, None, 1]
        sizes = {"bodies": int(model.nbody), "objects": len(self._bodies)}
        self.types = [sight_type(view, modalities, **sizes, gripper=gripper) for view in self.views]
        self._with_boxes = "boxes" in modalities
        self._outlines: list[dict[int, tuple[bytes, tuple[int, Box]]]] = [{} for _ in self.views]
        instances = instances_of_bodies(model)
        self._gripper = np.flatnonzero(np.isin(instances, GRIPPER_INSTANCES)).tolist() if gripper else []
        self._solid = np.concatenate([[False], np.ones(model.nbody, bool)])  # index: body id plus one
        self._movable = np.concatenate([[False], instances > _LAST_FURNITURE])
        self._slot = int(np.argmin(model.cam_bodyid))  # a camera of the world
        self._renderer = Renderer(
            model, width=max(v.width for v in self.views), height=max(v.height for v in self.views), quality=quality
        )

    def facts(self) -> ModelFacts:
        """Return the properties that all views share. Raises UnknownNameError if the model does not have a camera."""
        focal = tuple(focal_length_px(self._fovy_deg(view), view.height) for view in self.views)
        return ModelFacts(instances_of_bodies(self.model), self._bodies, self._boxes, focal)

    def draw(self, data: mujoco.MjData) -> Iterator[np.ndarray]:
        """Yield the rendered views in order, each as a scalar of its type in :attr:`types`.

        The poses of bodies, cameras and lights in ``data`` must be up to date. Raises the same errors as
        ``Renderer.render``.
        """
        for number, view in enumerate(self.views):
            yield self._sight(data, number, view)

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()

    def _fovy_deg(self, view: ViewSpec) -> float:
        if view.placed is not None:
            return view.placed.fovy_deg
        return float(self.model.cam_fovy[camera_number(self.model, view.camera)])

    @contextmanager
    def _camera_of(self, data: mujoco.MjData, view: ViewSpec) -> Iterator[str]:
        """Yield the name of the model's camera for a view.

        For a camera that the user has placed freely, a camera of the model is temporarily moved to the same pose.
        """
        placed, slot = view.placed, self._slot
        if placed is None:
            yield view.camera
            return
        kept = data.cam_xpos[slot].copy(), data.cam_xmat[slot].copy(), float(self.model.cam_fovy[slot])
        try:
            data.cam_xpos[slot], data.cam_xmat[slot] = placed.position, _looking(placed).ravel()
            self.model.cam_fovy[slot] = placed.fovy_deg
            yield self.model.camera(slot).name
        finally:
            data.cam_xpos[slot], data.cam_xmat[slot], self.model.cam_fovy[slot] = kept

    def _sight(self, data: mujoco.MjData, number: int, view: ViewSpec) -> np.ndarray:
        sight = np.zeros((), self.types[number])
        names, size = sight.dtype.names or (), {"width": view.width, "height": view.height}
        with self._camera_of(data, view) as camera:
            matrices = camera_matrices(self.model, data, camera, **size)
            depth = self._with_boxes or "depth" in names
            wanted = {"rgb": "rgb" in names, "depth": depth, "masks": "bodies" in names}
            (images,) = self._renderer.render_views(data, [(camera, view.width, view.height)], **wanted)
            if self._with_boxes and images.masks is not None and images.depth is not None:
                self._add_boxes(sight, data, _Drawn(number, camera, matrices, images.masks, images.depth))
            if self._gripper and images.masks is not None:
                alone = self._renderer.draw_alone(data, camera, self._gripper, **size)
                sight["gripper_pixels"] = [np.isin(mask, self._gripper).sum() for mask in (images.masks, alone)]
        for name, image in (("rgb", images.rgb), ("depth", images.depth)):
            if image is not None and name in names:
                sight[name] = image
        if images.masks is not None:
            np.add(images.masks, 1, out=sight["bodies"], casting="unsafe")
        pose = matrices.T_world_camera
        sight["camera"] = (*pose.position, *pose.quaternion)
        sight["poses"][:, :3], sight["poses"][:, 3:] = data.xpos, data.xquat
        return sight

    def _add_boxes(self, sight: np.ndarray, data: mujoco.MjData, drawn: _Drawn) -> None:
        parts = self._parts(data, drawn.matrices)
        behind: list[tuple[int, Box]] = []
        for i, (body, part) in enumerate(zip(self._bodies.tolist(), parts, strict=True)):
            outline = (0, _NO_BOX) if part is None else _outline(drawn.masks, body, part.rect)
            sight["visible_pixels"][i], sight["visible_box"][i] = outline
            if part is not None and self._may_be_hidden(drawn, body, part):
                behind.append((i, part.rect))
            else:
                sight["full_pixels"][i], sight["full_box"][i] = outline
        for i, outline in self._full_outlines(data, drawn, behind):
            sight["full_pixels"][i], sight["full_box"][i] = outline

    def _parts(self, data: mujoco.MjData, matrices: CameraMatrices) -> list[_Part | None]:
        """Return for each object a region of the image that contains the whole object.

        The region is None if the object is outside the image.
        """
        rotations = data.xmat.take(self._bodies, 0).reshape(-1, 1, 3, 3)
        points = np.matmul(rotations, self._corners[..., None])[..., 0] + data.xpos.take(self._bodies, 0)[:, None]
        pixels, depth = matrices.project(points.reshape(-1, 3))
        pixels, depth = pixels.reshape(-1, 8, 2), depth.reshape(-1, 8)
        low_m, near_m, far_m = (a.tolist() for a in (points[:, :, 2].min(1), depth.min(1), depth.max(1)))
        first, last = (np.floor(pixels.min(axis=1)) - 1).tolist(), (np.ceil(pixels.max(axis=1)) + 2).tolist()
        parts: list[_Part | None] = []
        for i in range(len(low_m)):
            rect = 0, 0, matrices.width, matrices.height
            if far_m[i] <= _NEAR_M:
                parts.append(None)
                continue
            if near_m[i] > _NEAR_M:
                (left, top), (right, bottom) = first[i], last[i]
                rect = max(int(left), 0), max(int(top), 0), min(int(right), rect[2]), min(int(bottom), rect[3])
            shown = rect[0] < rect[2] and rect[1] < rect[3]
            parts.append(_Part(rect, low_m[i], far_m[i]) if shown else None)
        return parts

    def _may_be_hidden(self, drawn: _Drawn, body: int, part: _Part) -> bool:
        """Return whether another body may occlude an object, judged by the pixels in the object's region of the image.

        If the camera and the object are above the table, neither the table nor the floor can occlude the object.
        """
        left, top, right, bottom = part.rect
        masks, depth = drawn.masks[top:bottom, left:right], drawn.depth[top:bottom, left:right]
        above = part.low_m > -_SUNK_M and drawn.matrices.T_world_camera.position[2] > 0.0
        hides = self._movable if above else self._solid
        return bool((hides.take(masks + 1) & (masks != body) & (depth < part.far_m)).any())

    def _full_outlines(
        self, data: mujoco.MjData, drawn: _Drawn, wanted: Sequence[tuple[int, Box]]
    ) -> list[tuple[int, tuple[int, Box]]]:
        """Return the index of each given object, with the number of pixels and the box of its unoccluded outline.

        Objects are rendered together if their regions of the image do not overlap. An outline is reused as long as
        neither the object nor the camera moves.
        """
        matrices, known = drawn.matrices, self._outlines[drawn.number]
        where = np.array([*matrices.T_world_camera.position, *matrices.T_world_camera.quaternion]).tobytes()
        found: list[tuple[int, tuple[int, Box]]] = []
        passes: list[list[tuple[int, Box]]] = []
        keys: dict[int, bytes] = {}
        for i, rect in wanted:
            body = int(self._bodies[i])
            keys[i] = where + data.xpos[body].tobytes() + data.xquat[body].tobytes()
            if i in known and known[i][0] == keys[i]:
                found.append((i, known[i][1]))
                continue
            for together in passes:
                if all(_apart(rect, other) for _, other in together):
                    together.append((i, rect))
                    break
            else:
                passes.append([(i, rect)])
        for together in passes:
            bodies = [int(self._bodies[i]) for i, _ in together]
            size = {"width": matrices.width, "height": matrices.height}
            mask = self._renderer.draw_alone(data, drawn.camera, bodies, **size)
            for (i, rect), body in zip(together, bodies, strict=True):
                outline = _outline(mask, body, rect)
                known[i] = keys[i], outline
                found.append((i, outline))
        return found


class StoredSights:
    """Renderer of recorded states of a stored scene."""

    def __init__(
        self,
        model: mujoco.MjModel,
        quality: Quality,
        views: Sequence[ViewSpec],
        modalities: Collection[str],
        *,
        gripper: bool = False,
    ) -> None:
        """Upload the model. Raises the same errors as :class:`Sights`."""
        self._sights = Sights(model, quality, views, modalities, gripper=gripper)
        self._state = StoredState(model)

    def facts(self) -> ModelFacts:
        """Return the properties that all views share, as :meth:`Sights.facts` does."""
        return self._sights.facts()

    def draw(self, qpos: np.ndarray, *, jitter: ViewJitter) -> Iterator[np.ndarray]:
        """Yield the rendered views of a recorded state (nq,), as :meth:`Sights.draw` does.

        ``jitter`` is the jitter of the cameras and the light in the record. Raises RecordError if the record belongs to
        a different model.
        """
        self._state.take(qpos, jitter)
        return self._sights.draw(self._state.data)

    def close(self) -> None:
        """Free the renderer."""
        self._sights.close()


def _apart(a: Box, b: Box) -> bool:
    return a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]


def _outline(masks: np.ndarray, body: int, rect: Box) -> tuple[int, Box]:
    """Return the number of pixels of a body in a region of a mask, and the tight box around these pixels."""
    left, top, right, bottom = rect
    hit = masks[top:bottom, left:right] == body
    rows = np.flatnonzero(hit.any(axis=1))
    if not len(rows):
        return 0, _NO_BOX
    columns = np.flatnonzero(hit.any(axis=0))
    box = left + int(columns[0]), top + int(rows[0]), left + int(columns[-1]) + 1, top + int(rows[-1]) + 1
    return int(np.count_nonzero(hit)), box


def _looking(camera: PlacedCamera) -> np.ndarray:
    """Return the rotation (3, 3) of a camera in MuJoCo's convention: x right, y up, z toward the viewer."""
    back = np.subtract(camera.position, camera.target)
    back = back / np.linalg.norm(back)
    up = np.array([1.0, 0.0, 0.0] if abs(back[2]) > 0.999 else [0.0, 0.0, 1.0])
    right = np.cross(up, back)
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back], axis=1)
