"""Visible objects in a camera image: visible fraction and image position, computed from a record and the model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose

GRIPPER = "gripper"
"""Name of the gripper (hand and fingers) in the list of objects."""

Box = tuple[int, int, int, int]
"""Left, top, right and bottom edge of an image region [pixel]; the last column is ``right - 1``."""


@dataclass(frozen=True, slots=True)
class SeenObject:
    """Visible part of one object in one image.

    Attributes:
        box: The smallest box around all its visible pixels.
        fraction: Visible pixels divided by the pixels that the object would have if nothing occluded it and the image
            had no border, in [0, 1].
        pixels: Number of visible pixels.
        centroid: Mean column and row of the object's visible pixels [pixel]. This point may be outside the object.
        runs: Run-length encoding of the object's visible pixels, row by row: alternating lengths, beginning with pixels
            outside the object.
    """

    box: Box
    fraction: float
    pixels: int
    centroid: tuple[float, float]
    runs: tuple[int, ...]

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the object has no visible pixels."""
        if self.pixels <= 0:
            raise InvalidInputError(
                "pixels", f"must be at least 1, got {self.pixels}", "List only objects with visible pixels"
            )

    @property
    def side(self) -> int:
        """The shorter side of its box [pixel]."""
        left, top, right, bottom = self.box
        return min(right - left, bottom - top)


@dataclass(frozen=True, slots=True)
class FrameView:
    """Image of a state, with its camera and visible objects.

    Attributes:
        camera: Camera name.
        width: Columns of the image [pixel].
        height: Rows of the image [pixel].
        T_world_camera: Camera pose in the OpenCV convention: x right in the image, y down, z forward.
        focal: Focal length [pixel]; the optical axis goes through the center of the image.
        objects: Visible objects by name in the scene; the gripper is :data:`GRIPPER`. Objects without visible pixels
            are not listed.
    """

    camera: str
    width: int
    height: int
    T_world_camera: Pose
    focal: float
    objects: Mapping[str, SeenObject]

    def depth_m(self, point: tuple[float, float, float]) -> float:
        """Return the distance of a world point [m] from the camera along its optical axis [m]."""
        return self.T_world_camera.inverse().apply(point)[2]


def in_runs(runs: tuple[int, ...], width: int, x: int, y: int) -> bool:
    """Return whether runs (see :class:`SeenObject`) cover the pixel at a column and row."""
    if not 0 <= x < width or y < 0:
        return False
    at, end = y * width + x, 0
    for number, length in enumerate(runs):
        end += length
        if at < end:
            return number % 2 == 1
    return False


def inner_pixel(seen: SeenObject, width: int) -> tuple[int, int]:
    """Return the visible pixel nearest to the centroid. The centroid may be outside the object, as for a ring."""
    cx, cy = seen.centroid
    best: tuple[float, int, int] | None = None
    start = 0
    for number, length in enumerate(seen.runs):
        if number % 2:
            row, first = divmod(start, width)
            for y, left, right in _rows(row, first, length, width):
                x = min(max(round(cx), left), right)
                found = ((x - cx) ** 2 + (y - cy) ** 2, x, y)
                best = found if best is None else min(best, found)
        start += length
    if best is None:
        raise InvalidInputError("runs", "the run-length encoding has no visible pixel", "Give at least two runs")
    return best[1], best[2]


def _rows(row: int, first: int, length: int, width: int) -> list[tuple[int, int, int]]:
    """Split a run that may span several rows into triples of row, first and last column."""
    parts = []
    while length > 0:
        here = min(length, width - first)
        parts.append((row, first, first + here - 1))
        row, first, length = row + 1, 0, length - here
    return parts
