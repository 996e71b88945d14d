"""Drawings of pages in millimeters, written as SVG and PDF at true scale.

Coordinates start at the top left corner of the page, with x to the right and y downward. Both writers create one object
per shape and do not compress the file, so that tests can measure the printed output.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.sax.saxutils import escape

POINTS_PER_MM = 72.0 / 25.4
_CURVE = 4.0 / 3.0 * (math.sqrt(2.0) - 1.0)
"""Length of the control handles with which four Bezier curves approximate a unit circle."""


@dataclass(frozen=True, slots=True)
class Rect:
    """Rectangle, given by its top left corner and size [mm].

    The rectangle is filled with a gray tone from 0 (black) to 1 (white). If ``line`` is above 0, it is not filled, but
    outlined with this line width [mm].
    """

    x: float
    y: float
    width: float
    height: float
    gray: float = 0.0
    line: float = 0.0


@dataclass(frozen=True, slots=True)
class Line:
    """Straight line between two points [mm]."""

    x1: float
    y1: float
    x2: float
    y2: float
    gray: float = 0.0
    line: float = 0.2


@dataclass(frozen=True, slots=True)
class Circle:
    """Outlined circle, given by its center and radius [mm]."""

    x: float
    y: float
    radius: float
    gray: float = 0.0
    line: float = 0.25


@dataclass(frozen=True, slots=True)
class Text:
    """ASCII text, given by the left end of its baseline and its font size [mm]."""

    x: float
    y: float
    text: str
    size: float = 3.0
    gray: float = 0.0


Shape = Rect | Line | Circle | Text


@dataclass(slots=True)
class Page:
    """Page with shapes in drawing order.

    Attributes:
        title: Title of the document.
        width: Width of the page [mm].
        height: Height of the page [mm].
        shapes: Shapes that are drawn completely.
        within: Shapes that are drawn first, and only inside the rectangle ``clip``.
        clip: Rectangle (left, top, width, height) [mm].
    """

    title: str
    width: float
    height: float
    shapes: list[Shape] = field(default_factory=list)
    within: list[Shape] = field(default_factory=list)
    clip: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


def svg(page: Page) -> str:
    """Return a page as an SVG document."""
    left, top, wide, high = page.clip
    size = f'width="{_n(page.width)}mm" height="{_n(page.height)}mm"'
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {_n(page.width)} {_n(page.height)}">',
        f"<title>{escape(page.title)}</title>",
        f'<clipPath id="tile"><rect x="{_n(left)}" y="{_n(top)}" width="{_n(wide)}" height="{_n(high)}"/></clipPath>',
        f'<rect width="{_n(page.width)}" height="{_n(page.height)}" fill="#fff"/>',
        '<g clip-path="url(#tile)">',
        *map(_svg, page.within),
        "</g>",
        *map(_svg, page.shapes),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def pdf(pages: Sequence[Page]) -> bytes:
    """Return pages as one PDF document, which asks the viewer to print without scaling."""
    objects = [
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        "",  # placeholder for the list of pages, whose object numbers are known at the end
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    kids = []
    for page in pages:
        content = _content(page)
        objects.append(f"<< /Length {len(content)} >>\nstream\n{content}endstream")
        box = f"[0 0 {_n(page.width * POINTS_PER_MM)} {_n(page.height * POINTS_PER_MM)}]"
        used = f"/Resources << /Font << /F 3 0 R >> >> /Contents {len(objects)} 0 R"
        objects.append(f"<< /Type /Page /Parent 2 0 R /MediaBox {box} {used} >>")
        kids.append(f"{len(objects)} 0 R")
    objects[1] = f"<< /Type /Pages /Count {len(kids)} /Kids [{' '.join(kids)}] >>"
    body, places = "%PDF-1.4\n", []
    for number, text in enumerate(objects, start=1):
        places.append(len(body))
        body += f"{number} 0 obj\n{text}\nendobj\n"
    start = len(body)
    body += f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n" + "".join(f"{p:010d} 00000 n \n" for p in places)
    body += f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF\n"
    return body.encode("ascii")


def _n(value: float) -> str:
    """Format a number with at most four decimals."""
    return f"{value:.4f}".rstrip("0").rstrip(".") or "0"


def _hex(gray: float) -> str:
    return "#" + f"{round(255 * gray):02x}" * 3


def _svg(shape: Shape) -> str:
    color = _hex(shape.gray)
    match shape:
        case Rect(line=0.0):
            paint = f'fill="{color}"'
        case Text():
            paint = f'fill="{color}"'
        case _:
            paint = f'fill="none" stroke="{color}" stroke-width="{_n(shape.line)}"'
    match shape:
        case Rect(x, y, width, height):
            return f'<rect x="{_n(x)}" y="{_n(y)}" width="{_n(width)}" height="{_n(height)}" {paint}/>'
        case Line(x1, y1, x2, y2):
            return f'<line x1="{_n(x1)}" y1="{_n(y1)}" x2="{_n(x2)}" y2="{_n(y2)}" {paint}/>'
        case Circle(x, y, radius):
            return f'<circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(radius)}" {paint}/>'
        case Text(x, y, text, size):
            where = f'x="{_n(x)}" y="{_n(y)}" font-size="{_n(size)}" font-family="Helvetica, Arial, sans-serif"'
            return f"<text {where} {paint}>{escape(text)}</text>"


def _content(page: Page) -> str:
    """Return the PDF operators that draw a page.

    The first operator sets the unit to millimeters and lets y point downward.
    """
    scale = _n_exact(POINTS_PER_MM)
    left, top, wide, high = page.clip
    lines = [f"{scale} 0 0 -{scale} 0 {_n(page.height * POINTS_PER_MM)} cm"]
    if page.within:
        lines += ["q", f"{_n(left)} {_n(top)} {_n(wide)} {_n(high)} re W n", *map(_pdf, page.within), "Q"]
    return "\n".join([*lines, *map(_pdf, page.shapes)]) + "\n"


def _n_exact(value: float) -> str:
    return f"{value:.9f}"


def _pdf(shape: Shape) -> str:
    gray = _n(shape.gray)
    match shape:
        case Rect(x, y, width, height, _, line):
            box = f"{_n(x)} {_n(y)} {_n(width)} {_n(height)} re"
            return f"{gray} g {box} f" if not line else f"{gray} G {_n(line)} w {box} S"
        case Line(x1, y1, x2, y2, _, line):
            return f"{gray} G {_n(line)} w {_n(x1)} {_n(y1)} m {_n(x2)} {_n(y2)} l S"
        case Circle(x, y, radius, _, line):
            h = radius * _CURVE
            curves = (
                (x + radius, y + h, x + h, y + radius, x, y + radius),
                (x - h, y + radius, x - radius, y + h, x - radius, y),
                (x - radius, y - h, x - h, y - radius, x, y - radius),
                (x + h, y - radius, x + radius, y - h, x + radius, y),
            )
            path = " ".join(" ".join(map(_n, curve)) + " c" for curve in curves)
            return f"{gray} G {_n(line)} w {_n(x + radius)} {_n(y)} m {path} s"
        case Text(x, y, text, size):
            safe = text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
            return f"{gray} g BT /F {_n(size)} Tf 1 0 0 -1 {_n(x)} {_n(y)} Tm ({safe}) Tj ET"
