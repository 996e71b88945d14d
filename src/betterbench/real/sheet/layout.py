"""Layout of the marker sheet in the arm's base frame: x ahead, y to the left, in millimeters.

The slots are taken from the task, and the outline of the base from the simulated arm. Markers are at positions where
the front camera sees them beside the arm, away from the slots, the basket and the tile edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from betterbench.tasks import get_task

TASK, STAND = "fruit_basket", "stand"
"""Task for which the sheet is made, and the slot of the basket in this task."""
DICTIONARY = "DICT_4X4_50"
"""OpenCV dictionary of the markers, which have four by four cells.

With fewer, larger cells, there would be too few distinct markers.
"""
MARKER_MM = 60.0
"""Side length of a marker with its black border [mm].

Markers are at least 18 pixels high in a simulated image of 640 x 480 pixels.
"""
QUIET_MM = 10.0
"""Width of the white margin around a marker [mm], which is one cell of the marker."""
RULER_MM = 100.0
BASKET_MM = 208.0
"""Diameter of the widest basket in simulation [mm]."""

CELLS = (
    *(0xB532, 0x0F9A, 0x332D, 0x9946, 0x549E, 0x79CD, 0x9E2E, 0xC4F2, 0xFEDA, 0xCF56, 0xF991, 0x11A7, 0x0EB7),
)  # fmt: skip
"""Cells of each marker, by marker number.

The cells are listed row by row from the top left, with the first cell in the highest bit. A bit of 1 is white.
"""

MARKERS_MM = (
    *((285.0, 325.0), (285.0, 225.0), (185.0, 325.0), (285.0, 60.0), (285.0, -70.0), (285.0, -340.0), (185.0, -340.0)),
    *((75.0, 325.0), (-10.0, 240.0), (60.0, -100.0), (-10.0, -250.0), (80.0, -340.0), (190.0, 60.0)),
)
"""Center of each marker, by marker number [mm]."""

BASE_MM = (-22.4, 64.8, 55.5)
"""Foot of the arm's base: its rear end and front end along x, and half of its width [mm]."""
CLEARANCE_MM = 0.5
"""Gap between the foot and the edge of the cutout on each side [mm]."""


@dataclass(frozen=True, slots=True)
class Area:
    """Rectangle on the table [mm], given by its rear right corner and its front left corner."""

    x_low: float
    x_high: float
    y_low: float
    y_high: float

    @property
    def width(self) -> float:
        """Extent of the rectangle along y [mm]."""
        return self.y_high - self.y_low

    @property
    def depth(self) -> float:
        """Extent of the rectangle along x [mm]."""
        return self.x_high - self.x_low


@dataclass(frozen=True, slots=True)
class Spot:
    """Position of an object on the sheet, given by its slot.

    Attributes:
        name: Name of the slot.
        x: x coordinate of the slot's center [mm].
        y: y coordinate of the slot's center [mm].
        radius: Radius of the circle around the slot's center in which the position of the object varies [mm].
    """

    name: str
    x: float
    y: float
    radius: float


TILE_MM = (255.0, 190.0)
"""Width and depth of a tile [mm]. A tile fits on both A4 and Letter paper in landscape, with the printer's margins."""
TILES = tuple(Area(x, x + TILE_MM[1], y, y + TILE_MM[0]) for x in (138.0, -52.0) for y in (114.0, -141.0, -396.0))
"""Tiles of the sheet in the order of the pages: seen from behind the arm, the far row from left to right, then the near
row.
"""
SHEET = Area(
    min(t.x_low for t in TILES), max(t.x_high for t in TILES), min(t.y_low for t in TILES), max(t.y_high for t in TILES)
)
"""Area of the whole sheet."""


def page_of(point: tuple[float, float]) -> int:
    """Return the number of the page that contains a point on the table, counted from 1."""
    x, y = point
    return next(k for k, t in enumerate(TILES, 1) if t.x_low <= x <= t.x_high and t.y_low <= y <= t.y_high)


def spots() -> tuple[Spot, ...]:
    """Return the slots of the task as positions on the sheet."""
    return tuple(Spot(s.name, 1000.0 * s.x, 1000.0 * s.y, 1000.0 * s.jitter_m) for s in get_task(TASK).slots)


def cells_of(marker: int) -> np.ndarray:
    """Return the (4, 4) cells of a marker. White cells are True."""
    bits = [bool(CELLS[marker] >> (15 - k) & 1) for k in range(16)]
    return np.array(bits).reshape(4, 4)


def corners_mm(marker: int) -> np.ndarray:
    """Return the (4, 2) positions of a marker's corners [mm] in the order of OpenCV: clockwise from the top left.

    The top of a marker is the side that is farthest from the arm.
    """
    x, y = MARKERS_MM[marker]
    half = 0.5 * MARKER_MM
    return np.array([[x + half, y + half], [x + half, y - half], [x - half, y - half], [x - half, y + half]])
