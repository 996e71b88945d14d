"""What cameras show of recorded states, with the image: computed by drawing the stored scene again.

This is one source of :class:`~betterbench.state.FrameView`; materialized masks can be another.
"""

from __future__ import annotations

import io
import itertools
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np
from PIL import Image

from betterbench.recording import Record, RunFolder
from betterbench.scenes.cameras import CameraMatrices
from betterbench.scenes.limited import LimitedView
from betterbench.state import GRIPPER, FrameView, ObjectInfo, SeenObject

GRIPPER_GROUP = ("robot/hand", "robot/left_finger", "robot/right_finger")
"""Bodies of the gripper in a stored scene."""

JPEG_QUALITY = 92
"""Quality of the images; colors are stored at full resolution, since many objects are a few pixels wide."""

_ACROSS, _UP = (-0.5, -0.25, 0.0, 0.25, 0.5), (0.0, 0.25, 0.5, 0.75, 1.0)
_GRID = np.array(list(itertools.product(_ACROSS, _ACROSS, _UP)))
"""Points of a bounding box as shares of its size, from the middle of its bottom face."""


class CameraPhoto(NamedTuple):
    """One image (JPEG) and what it shows."""

    jpeg: bytes
    view: FrameView


class ViewRenderer:
    """Draws recorded states of one run with what they show. A context manager, which ends the drawing process."""

    def __init__(self, run: RunFolder, *, size: int = 256, quality: str = "standard") -> None:
        """Start the process; ``size`` is the side of the images [pixel]."""
        self._run, self._view, self._scene = run, LimitedView(quality=quality, size=size), ""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._view.close()

    def photo(self, record: Record, row: int, camera: str) -> CameraPhoto:
        """Return the image of a camera at a row of a record of the run, and what it shows.

        Raises:
            RecordError: If the stored scene is missing, damaged or another one, or has no such camera.
            MissingDependencyError: If no off-screen OpenGL works here.
        """
        scene, info = record.metadata.scene_hash, record.metadata.scene
        if scene != self._scene:
            self._view.open(self._run.load_scene(scene))
            self._scene = scene
        names = [o.name for o in info.objects]
        groups = [*((f"object{i}_{o.category}",) for i, o in enumerate(info.objects)), GRIPPER_GROUP]
        sight = self._view.see(record.qpos[row], camera, groups, jitter=record.metadata.view_jitter)
        objects = {}
        for number, (name, alone) in enumerate(zip([*names, GRIPPER], sight.alone, strict=True)):
            mask = sight.groups == number
            if alone and mask.any():
                whole = 1.0 if name == GRIPPER else _share_inside(record, row, info.objects[number], sight.camera)
                objects[name] = seen_object(mask, min(1.0, float(mask.sum()) / alone) * whole)
        camera_at = sight.camera
        size = camera_at.width, camera_at.height
        view = FrameView(camera, *size, camera_at.T_world_camera, float(camera_at.K[0, 0]), objects)
        return CameraPhoto(_jpeg(sight.rgb), view)


def seen_object(mask: np.ndarray, fraction: float) -> SeenObject:
    """Return what a (height, width) bool mask with at least one pixel says about an object."""
    rows, columns = np.nonzero(mask)
    box = int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1
    flat = np.concatenate(([False], mask.ravel(), [False]))
    edges = np.flatnonzero(flat[1:] != flat[:-1])
    runs = np.diff(np.concatenate(([0], edges)))
    return SeenObject(
        box, fraction, len(rows), (float(columns.mean()), float(rows.mean())), tuple(int(length) for length in runs)
    )


def _share_inside(record: Record, row: int, info: ObjectInfo, camera: CameraMatrices) -> float:
    """Return the share of an object's bounding box that the image does not cut off, from a grid of points in it."""
    number = record.metadata.scene.index(info.name)
    local = _GRID * np.asarray(info.size_m)
    w, axis = record.object_quaternions[row, number, 0], record.object_quaternions[row, number, 1:]
    twice = 2.0 * np.cross(axis, local)
    points = record.object_positions[row, number] + local + w * twice + np.cross(axis, twice)
    pixels, depth = camera.project(points)
    inside = (depth > 0.0) & (pixels[:, 0] >= -0.5) & (pixels[:, 0] <= camera.width - 0.5)
    inside &= (pixels[:, 1] >= -0.5) & (pixels[:, 1] <= camera.height - 0.5)
    return float(inside.mean())


def _jpeg(rgb: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    return buffer.getvalue()
