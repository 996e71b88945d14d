"""Images of recorded states, rendered from the stored scene, and descriptions of the objects visible in the images.

The visible objects are described by a :class:`~betterbench.interface.state.FrameView`.
"""

from __future__ import annotations

import itertools
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np

from betterbench.errors import RecordError
from betterbench.geometry import Pose
from betterbench.interface.state import GRIPPER, FrameView, ObjectInfo, SeenObject
from betterbench.records import Record, RunFolder
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.scenes.cameras import CameraMatrices
from betterbench.sim.scenes.image_files import jpeg_bytes
from betterbench.sim.scenes.limited import LimitedView
from betterbench.sim.scenes.sights import GRIPPER_INSTANCES, ModelFacts

JPEG_QUALITY = 92
"""Quality setting for JPEG. Chroma is stored at full resolution, because many objects are only a few pixels wide."""

_ACROSS, _UP = (-0.5, -0.25, 0.0, 0.25, 0.5), (0.0, 0.25, 0.5, 0.75, 1.0)
_GRID = np.array(list(itertools.product(_ACROSS, _ACROSS, _UP)))
"""Grid of points (n, 3) in a bounding box, relative to the center of its bottom face, as fractions of the box size."""


class CameraPhoto(NamedTuple):
    """Camera image (JPEG), and a description of the objects visible in it."""

    jpeg: bytes
    view: FrameView


class ViewRenderer:
    """Renderer of recorded states, which also finds the visible objects.

    The rendering runs in a separate process, which ends at the end of a ``with`` block.
    """

    def __init__(self, run: RunFolder, *, size: int = 256, quality: str = "standard") -> None:
        """Start the rendering process. ``size`` is the side length of the images [pixel]."""
        self._run, self._limited, self._size = run, LimitedView(quality=quality), size
        self._cameras: tuple[str, ...] = ()
        self._row: tuple[Record, int] | None = None
        self._photos: dict[str, CameraPhoto] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._limited.close()

    def stop(self) -> None:
        """End the rendering process from another thread. The thread that is rendering gets a RecordError."""
        self._limited.stop()

    def photo(self, record: Record, row: int, camera: str) -> CameraPhoto:
        """Return the image of a camera at one row of a record, with a description of the objects visible in it.

        Raises:
            RecordError: If the stored scene is missing or damaged, belongs to another record, or does not have the
                camera.
            MissingDependencyError: If off-screen OpenGL does not work on this machine.
        """
        if self._row is None or self._row[0] is not record or self._row[1] != row or camera not in self._photos:
            self._draw(record, row, camera)
        return self._photos[camera]

    def _draw(self, record: Record, row: int, camera: str) -> None:
        """Render a row of the record from all cameras requested so far, because callers often need all of them."""
        self._row = None
        self._cameras = tuple(dict.fromkeys((*self._cameras, camera)))
        views = [ViewSpec(name, self._size, self._size) for name in self._cameras]
        self._limited.open_of(self._run, record)
        facts, _ = self._limited.prepare(views, ("rgb", "boxes"), gripper=True)
        if len(facts.object_bodies) != len(record.metadata.scene.objects):
            raise RecordError(
                "The stored scene contains other objects than the record, so the scene and the record "
                "belong to different trials."
            )
        ((*sights,),) = self._limited.sights(record.qpos[row : row + 1], jitter=record.metadata.view_jitter)
        photos = {}
        for name, sight, focal_px in zip(self._cameras, sights, facts.focal_px, strict=True):
            matrices = _matrices(sight["camera"], focal_px, self._size)
            seen = _seen_objects(record, row, facts, sight, matrices)
            view = FrameView(name, self._size, self._size, matrices.T_world_camera, focal_px, seen)
            photos[name] = CameraPhoto(jpeg_bytes(sight["rgb"], quality=JPEG_QUALITY, whole_colors=True), view)
        self._row, self._photos = (record, row), photos


def _matrices(placed: np.ndarray, focal_px: float, size: int) -> CameraMatrices:
    """Return the camera matrices for a view, given the position and quaternion of the camera."""
    x, y, z, qw, qx, qy, qz = placed.tolist()
    half = 0.5 * (size - 1)
    K = np.array([[focal_px, 0.0, half], [0.0, focal_px, half], [0.0, 0.0, 1.0]])
    return CameraMatrices(K, Pose((x, y, z), (qw, qx, qy, qz)), size, size)


def _seen_objects(
    record: Record, row: int, facts: ModelFacts, sight: np.ndarray, camera: CameraMatrices
) -> dict[str, SeenObject]:
    """Return a description of the visible part of each object and of the gripper, by name.

    Objects that are not visible are left out.
    """
    numbers = np.full(int(np.iinfo(np.uint16).max) + 1, -1, np.int16)  # index of each object, by MuJoCo body id + 1
    numbers[facts.object_bodies + 1] = np.arange(len(facts.object_bodies))
    numbers[1 + np.flatnonzero(np.isin(facts.instances, GRIPPER_INSTANCES))] = len(facts.object_bodies)
    shown, seen = numbers[sight["bodies"]], dict[str, SeenObject]()
    full = [*sight["full_pixels"].tolist(), int(sight["gripper_pixels"][1])]
    for i, (info, alone) in enumerate(zip([*record.metadata.scene.objects, None], full, strict=True)):
        mask = shown == i
        if alone > 0 and mask.any():
            whole = 1.0 if info is None else _share_inside(record, row, info, camera)
            seen[GRIPPER if info is None else info.name] = seen_object(
                mask, min(1.0, float(mask.sum()) / alone) * whole
            )
    return seen


def seen_object(mask: np.ndarray, fraction: float) -> SeenObject:
    """Describe the visible part of an object, given its mask (height, width) with at least one pixel set."""
    rows, columns = np.nonzero(mask)
    box = int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1
    flat = np.concatenate(([False], mask.ravel(), [False]))
    edges = np.flatnonzero(flat[1:] != flat[:-1])
    runs = np.diff(np.concatenate(([0], edges)))
    return SeenObject(
        box, fraction, len(rows), (float(columns.mean()), float(rows.mean())), tuple(int(length) for length in runs)
    )


def _share_inside(record: Record, row: int, info: ObjectInfo, camera: CameraMatrices) -> float:
    """Return the fraction of an object's bounding box that is inside the image, estimated from a grid of points."""
    number = record.metadata.scene.index(info.name)
    local = _GRID * np.asarray(info.size_m)
    w, axis = record.object_quaternions[row, number, 0], record.object_quaternions[row, number, 1:]
    twice = 2.0 * np.cross(axis, local)
    points = record.object_positions[row, number] + local + w * twice + np.cross(axis, twice)
    pixels, depth = camera.project(points)
    inside = (depth > 0.0) & (pixels[:, 0] >= -0.5) & (pixels[:, 0] <= camera.width - 0.5)
    inside &= (pixels[:, 1] >= -0.5) & (pixels[:, 1] <= camera.height - 0.5)
    return float(inside.mean())
