"""Visible objects in a camera image: the visible fraction of each object and its position in the image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose

GRIPPER = "gripper"
"""Name of the gripper (hand and fingers) in the list of visible objects."""

Box = tuple[int, int, int, int]
"""Left, top, right and bottom edge of an image region [pixel]. The last column of the region is ``right - 1``."""


@dataclass(frozen=True, slots=True)
class SeenObject:
    """Visible part of one object in one image.

    Attributes:
        box: Smallest box around all visible pixels of the object.
        fraction: Visible fraction of the object, in [0, 1]: the number of visible pixels, divided by the number that
            would be visible without occlusion and image borders.
        pixels: Number of visible pixels.
        centroid: Mean column and row of the visible pixels [pixel]. This point may be outside the object.
        runs: Run-length encoding of the visible pixels, row by row. The numbers alternate between pixels outside the
            object and visible pixels of the object, starting with pixels outside.
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
        """Length of the shorter side of the object's box [pixel]."""
        left, top, right, bottom = self.box
        return min(right - left, bottom - top)


@dataclass(frozen=True, slots=True)
class FrameView:
    """Camera parameters of an image, and the objects that are visible in the image.

    Attributes:
        camera: Camera name.
        width: Number of columns of the image [pixel].
        height: Number of rows of the image [pixel].
        T_world_camera: Camera pose in the OpenCV convention: x right in the image, y down, z forward.
        focal: Focal length [pixel]. The optical axis goes through the center of the image.
        objects: Visible objects by their name in the scene. The gripper is listed as :data:`GRIPPER`. Objects without
            visible pixels are not listed.
    """

    camera: str
    width: int
    height: int
    T_world_camera: Pose
    focal: float
    objects: Mapping[str, SeenObject]

    def depth_m(self, point: tuple[float, float, float]) -> float:
        """Return the distance [m] from the camera to a point in the world frame [m], along the optical axis."""
        return self.T_world_camera.inverse().apply(point)[2]


def in_runs(runs: tuple[int, ...], width: int, x: int, y: int) -> bool:
    """Return whether a run-length encoding (see :class:`SeenObject`) covers the pixel in column ``x`` and row ``y``."""
    if not 0 <= x < width or y < 0:
        return False
    at, end = y * width + x, 0
    for number, length in enumerate(runs):
        end += length
        if at < end:
            return number % 2 == 1
    return False


def inner_pixel(seen: SeenObject, width: int) -> tuple[int, int]:
    """Return the visible pixel of an object that is nearest to its centroid.

    The centroid itself may be outside the object, for example if the object is a ring.
    """
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
        raise InvalidInputError("runs", "the run-length encoding has no visible pixel", "Pass at least two runs")
    return best[1], best[2]


def _rows(row: int, first: int, length: int, width: int) -> list[tuple[int, int, int]]:
    """Split a run that may extend over several rows into triples of row, first column and last column."""
    parts = []
    while length > 0:
        here = min(length, width - first)
        parts.append((row, first, first + here - 1))
        row, first, length = row + 1, 0, length - here
    return parts
