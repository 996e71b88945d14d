"""Pages of the marker sheet: an overview with instructions and one page per tile, or one page for the whole sheet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from betterbench.errors import UnknownNameError
from betterbench.jobs.durable import write_durably
from betterbench.real.sheet.drawing import Circle, Line, Page, Rect, Shape, Text, pdf, svg
from betterbench.real.sheet.layout import (
    BASE_MM,
    BASKET_MM,
    CLEARANCE_MM,
    MARKER_MM,
    MARKERS_MM,
    QUIET_MM,
    RULER_MM,
    SHEET,
    STAND,
    TILES,
    Area,
    cells_of,
    spots,
)

PAPERS_MM = {"a4": (297.0, 210.0), "letter": (279.4, 215.9)}
"""Paper sizes in landscape: width and height [mm]."""
WHOLE = "whole"
"""Name of the paper size for the whole sheet on one page, for a print shop."""
_MARGIN = 15.0
_OVERLAP = 0.2
_GRID_MM = 50.0
_PALE, _SOFT = 0.82, 0.45


@dataclass(frozen=True, slots=True)
class _Frame:
    """Placement of an area of the table on a page.

    The placement is given by the position of the area's far left corner on the page, and a scale.
    """

    area: Area
    left: float
    top: float
    scale: float = 1.0

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return the position on the page of a given point on the table."""
        return self.left + self.scale * (self.area.y_high - y), self.top + self.scale * (self.area.x_high - x)


def sheet_pages(paper: str) -> list[Page]:
    """Return the pages for a paper size ("a4", "letter", "whole"). Raise UnknownNameError for another paper size."""
    if paper == WHOLE:
        width, height = SHEET.width + 2.0 * _MARGIN, SHEET.depth + 2.0 * _MARGIN
        return [_tile(SHEET, "the whole sheet", width, height)]
    if paper not in PAPERS_MM:
        raise UnknownNameError("paper", paper, (*PAPERS_MM, WHOLE))
    width, height = PAPERS_MM[paper]
    tiles = [_tile(a, f"page {k} of {len(TILES)}", width, height) for k, a in enumerate(TILES, start=1)]
    return [_overview(width, height), *tiles]


def write_sheet(folder: Path, paper: str) -> list[Path]:
    """Write the sheet as one PDF and as one SVG per page. Return the paths of the files, with the PDF first."""
    pages = sheet_pages(paper)
    files = {f"sheet_{paper}.pdf": pdf(pages)}
    for number, page in enumerate(pages):
        name = f"sheet_{paper}.svg" if len(pages) == 1 else f"sheet_{paper}_{number}.svg"
        files[name] = svg(page).encode()
    for name, data in files.items():
        write_durably(folder / name, data)
    return [folder / name for name in files]


def _tile(area: Area, name: str, width: float, height: float) -> Page:
    """Return a page that shows a part of the sheet at true scale in its center, with rulers in two margins."""
    left, top = 0.5 * (width - area.width), 0.5 * (height - area.depth)
    page = Page(f"betterbench marker sheet, {name}", width, height, clip=(left, top, area.width, area.depth))
    page.within.extend(_content(_Frame(area, left, top)))
    page.shapes.append(Rect(left, top, area.width, area.depth, gray=_SOFT, line=0.2))
    page.shapes.extend(_rulers(left, top + area.depth, top))
    note = f"betterbench marker sheet, {name}. Print at 100 %, without fitting to the page. Cut along the frame."
    page.shapes.append(Text(left + RULER_MM + 12.0, top + area.depth + 4.5, note, 2.6))
    return page


def _rulers(left: float, below: float, top: float) -> Iterator[Shape]:
    """Yield rulers below and to the left of a tile.

    There are two rulers because a printer may scale the two directions differently.
    """
    y, x = below + 1.5, left - 1.5
    yield Line(left, y, left + RULER_MM, y)
    yield Line(x, top, x, top + RULER_MM)
    for tick in range(11):
        long = 3.0 if tick in (0, 5, 10) else 1.8
        yield Line(left + 10.0 * tick, y, left + 10.0 * tick, y + long)
        yield Line(x, top + 10.0 * tick, x - long, top + 10.0 * tick)
    yield Text(left + RULER_MM + 1.5, y + 3.0, f"{RULER_MM:.0f} mm", 2.6)


def _content(frame: _Frame) -> Iterator[Shape]:
    """Yield the content of the sheet: grid, base, slots and basket, with the markers on top."""
    yield from _grid(frame)
    yield from _base(frame)
    s = frame.scale
    for spot in spots():
        x, y = frame.at(spot.x, spot.y)
        yield Circle(x, y, s * spot.radius)
        yield Line(x - 4.0 * s, y, x + 4.0 * s, y)
        yield Line(x, y - 4.0 * s, x, y + 4.0 * s)
        is_stand = spot.name == STAND
        yield Text(x - 8.0 * s, y + s * (spot.radius + 4.5), "basket" if is_stand else spot.name, 3.5 * s)
        if is_stand:
            yield Circle(x, y, 0.5 * s * BASKET_MM, gray=_SOFT)
    for marker in range(len(MARKERS_MM)):
        yield from _marker(frame, marker)


def _grid(frame: _Frame) -> Iterator[Shape]:
    """Yield grid lines every 5 cm. Their coordinates in centimeters are printed on each tile."""
    s, area = frame.scale, SHEET
    for k in range(round(area.x_low / _GRID_MM), round(area.x_high / _GRID_MM) + 1):
        x = k * _GRID_MM
        (x1, y1), (x2, y2) = frame.at(x, area.y_high), frame.at(x, area.y_low)
        yield Line(x1, y1, x2, y2, gray=_PALE, line=0.15)
        told = f"{abs(x) / 10.0:.0f} {'ahead' if x >= 0.0 else 'behind'}"
        for y in (350.0, 100.0, -150.0):
            u, v = frame.at(x, y)
            yield Text(u + 1.0 * s, v - 1.0 * s, told, 2.4 * s, gray=_SOFT)
    for k in range(round(area.y_low / _GRID_MM), round(area.y_high / _GRID_MM) + 1):
        y = k * _GRID_MM
        (x1, y1), (x2, y2) = frame.at(area.x_high, y), frame.at(area.x_low, y)
        yield Line(x1, y1, x2, y2, gray=_PALE, line=0.15)
        side = "middle" if not k else f"{abs(y) / 10.0:.0f} {'left' if y > 0.0 else 'right'}"
        for x in (315.0, 125.0):
            u, v = frame.at(x, y)
            yield Text(u + 1.0 * s, v, side, 2.4 * s, gray=_SOFT)


def _base(frame: _Frame) -> Iterator[Shape]:
    """Yield the outline of the arm's base. It is open to the rear, so that the sheet can slide around the base."""
    s, front, half = frame.scale, BASE_MM[1], BASE_MM[2] + CLEARANCE_MM
    x, y = frame.at(front, half)
    width, depth = 2.0 * half * s, (front - SHEET.x_low) * s
    yield Rect(x, y, width, depth, gray=0.93)
    yield Rect(x, y, width, depth, line=0.3)
    u, v = frame.at(0.0, 0.0)
    yield Line(u - 6.0 * s, v, u + 6.0 * s, v)
    yield Line(u, v - 6.0 * s, u, v + 6.0 * s)
    yield Text(x + 3.0 * s, y + 6.0 * s, "The arm's base stands here: cut this field out.", 3.5 * s)
    yield Text(x + 3.0 * s, y + 11.0 * s, "Cross: origin of all coordinates.", 3.5 * s)


def _marker(frame: _Frame, marker: int) -> Iterator[Shape]:
    """Yield the white margin, the black square, the white cells and the number of a marker."""
    s, (x, y) = frame.scale, MARKERS_MM[marker]
    half = 0.5 * MARKER_MM
    left, top = frame.at(x + half, y + half)
    cells = cells_of(marker)
    cell = s * MARKER_MM / (len(cells) + 2)
    margin = s * QUIET_MM
    yield Rect(left - margin, top - margin, s * MARKER_MM + 2 * margin, s * MARKER_MM + 2 * margin, gray=1.0)
    yield Rect(left, top, s * MARKER_MM, s * MARKER_MM)
    framed = np.pad(cells, 1)
    for row, column in np.argwhere(framed).tolist():
        # overlap white neighbors slightly, because viewers show a dark hairline between adjacent shapes
        wide, high = (cell + _OVERLAP * s * bool(framed[there]) for there in ((row, column + 1), (row + 1, column)))
        yield Rect(left + column * cell, top + row * cell, wide, high, gray=1.0)
    yield Text(left, top + s * (MARKER_MM + 5.0), f"marker {marker}", 3.0 * s, gray=_SOFT)


_ACROSS_MM = MARKERS_MM[2][1] - MARKERS_MM[6][1]
_SAYS = (
    "1. Print pages 1 to 6 at 100 %, without fitting to the page. Both rulers of each page must be 100 mm long.",
    "2. Cut each page along its frame. Lay them edge to edge as above, seen from behind the arm. Tape them from below.",
    f"3. Check that the distance from the left edge of marker 2 to the left edge of marker 6 is {_ACROSS_MM:.0f} mm.",
    "4. Cut the gray field out and slide the sheet around the base, until the front of its foot touches the edge.",
    "    The sheet lies flat, and square to the arm.",
    "5. better real check-cameras measures the camera. Take the sheet away before demonstrations and trials.",
)


def _overview(width: float, height: float) -> Page:
    """Return the overview page: a small drawing of the whole sheet with page numbers, and instructions."""
    scale = 250.0 / SHEET.width
    left, top = 0.5 * (width - 250.0), 16.0
    frame = _Frame(SHEET, left, top, scale)
    page = Page("betterbench marker sheet", width, height, clip=(left, top, 250.0, scale * SHEET.depth))
    page.within.extend(_content(frame))
    title = "betterbench marker sheet for the SO-101 and the fruit basket (this page is not to scale)"
    page.shapes.append(Text(left, 11.0, title, 5.0))
    for number, tile in enumerate(TILES, start=1):
        x, y = frame.at(tile.x_high, tile.y_high)
        page.shapes.append(Rect(x, y, scale * tile.width, scale * tile.depth, line=0.3))
        aside = 0.5 if number <= 3 else 0.76  # keep the number clear of the markers
        where = x + aside * scale * tile.width, y + scale * tile.depth - 3.0
        page.shapes.append(Text(*where, str(number), 8.0, gray=_SOFT))
    for row, says in enumerate(_SAYS):
        page.shapes.append(Text(left, top + scale * SHEET.depth + 9.0 + 6.5 * row, says, 3.9))
    return page
