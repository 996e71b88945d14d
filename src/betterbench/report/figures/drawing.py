"""Charts as SVG in two versions: a wide one for screens and paper, and a narrow one for phones."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from betterbench.quoting import markup_text
from betterbench.report.wording import Figure
from betterbench.statistics import round_half_up
from betterbench.statistics.wording import minus, p_text

GRID = 0.25
"""Distance between the grid lines of a chart, as a fraction of 1 (100 %)."""

WIDE_PX = 660
NARROW_PX = 340
"""Widths of the two versions [px]. The narrow version fits on a phone with a width of 390 px, including margins."""

_CHARACTER_PX = 6.3
"""Width of a character in a 12 px sans serif font [px]. It is rounded up, so that fitted texts never overflow."""

_LEAST_NAME_PX, _MOST_NAME_PX, _LEAST_BAR_PX = 80.0, 210.0, 150.0
"""Minimum and maximum width of the row names, and minimum length of the scale, in the wide version [px]."""

PATTERNS: dict[str, str] = {
    "right": "",
    "reasoning": "",
    "execution": '<path d="M-1 1 1 -1M0 6 6 0M5 7 7 5" class="hatch"/>',
    "system": '<circle cx="2" cy="2" r="0.9" class="dots"/>',
    "unfinished": "",
}
"""SVG pattern that is drawn over the color of each outcome family, for grayscale prints and color-blind readers."""


@dataclass(frozen=True, slots=True)
class Scale:
    """Horizontal scale of a chart, from ``low`` to ``high``. Both are fractions, not percentages."""

    low: float
    high: float

    def share(self, value: float) -> float:
        """Return the position of a value along the scale, as a fraction from 0 to 1.

        Values outside of the scale are clipped.
        """
        return (min(max(value, self.low), self.high) - self.low) / (self.high - self.low)

    @property
    def values(self) -> tuple[float, ...]:
        """Values of the grid lines."""
        count = round((self.high - self.low) / GRID)
        return tuple(self.low + GRID * i for i in range(count + 1))


UNIT = Scale(0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Bar:
    """One row of a bar chart.

    Attributes:
        name: Text on the left, such as "training" or the name of a policy.
        figure: The number to show. If it has no value, a note is shown instead of a bar.
        style: Style of the bar: "training", "variation", "reasoning", "execution" or "system". The style "dot" draws a
            point instead of a bar.
    """

    name: str
    figure: Figure
    style: str


@dataclass(frozen=True, slots=True)
class BarGroup:
    """Rows of a bar chart under one title, which may be empty."""

    title: str
    rows: tuple[Bar, ...]


@dataclass(frozen=True, slots=True)
class Stack:
    """One row of a stacked bar chart: the number of trials that ended in each outcome family."""

    name: str
    counts: tuple[tuple[str, int], ...]

    @property
    def n(self) -> int:
        """Number of trials."""
        return sum(count for _, count in self.counts)


@dataclass(frozen=True, slots=True)
class StackGroup:
    """Rows of a stacked bar chart under one title, which may be empty."""

    title: str
    rows: tuple[Stack, ...]


@dataclass(frozen=True, slots=True)
class Chart:
    """Chart that is shown on the page and also written to a separate file.

    Attributes:
        name: File name without extension.
        title: Title of the chart.
        caption: Text below the title.
        groups: Rows of the chart in groups.
        scale: Horizontal scale of bars. Stacked bars always fill their width.
        key: CSS class and name of every style in the legend.
    """

    name: str
    title: str
    caption: str
    groups: tuple[BarGroup, ...] | tuple[StackGroup, ...]
    scale: Scale = UNIT
    key: tuple[tuple[str, str], ...] = ()


def draw(chart: Chart, *, narrow: bool = False, style: str | None = None) -> str:
    """Draw a chart as one SVG element, in which all texts are escaped.

    Args:
        chart: The chart.
        narrow: Whether to draw the version for phones, with labels above the bars.
        style: Style sheet to include, with a white background, for a separate file. None for a page, which has its own
            style sheet.
    """
    width = NARROW_PX if narrow else WIDE_PX
    name = f"{chart.name}-{'narrow' if narrow else 'wide'}{'' if style is None else '-file'}"
    pen = _Pen(name, width, narrow=narrow)
    if not narrow:
        pen.left, pen.right = _margins(chart)
    if style is not None:
        pen.text(0, 15, chart.title, "title")
        pen.y = 26.0
    pen.key(chart.key)
    pen.chart(chart)
    height = math.ceil(pen.y + 4)
    ground = "" if style is None else f'<style>{style}</style><rect width="{width}" height="{height}" class="ground"/>'
    title = markup_text(chart.title)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="drawing" viewBox="0 0 {width} {height}" width="{width}" '
        f'height="{height}" role="img" aria-label="{title}"><title>{title}</title>'
        f"{ground}{_patterns(name)}{''.join(pen.marks)}</svg>"
    )


def file_style(figure_css: str, page_css: str) -> str:
    """Return the style sheet for a chart in a separate file: the light colors of the page, without CSS variables."""
    light = dict(re.findall(r"--([\w-]+): light-dark\(([^,]+),", page_css))
    plain = re.sub(r"var\(--([\w-]+)\)", lambda found: light.get(found[1], "#000"), figure_css)
    return plain + "text{font-family:Helvetica,Arial,sans-serif}.ground{fill:#fff}"


def reading(figure: Figure) -> str:
    """Format a rate with its counts and interval, for the margin of a chart, e.g. "62 % · 149/240 · 56 to 68"."""
    if figure.missing:
        return figure.count() or "not measured"
    number = figure.number() if figure.difference else figure.with_unit()
    p = p_text(figure.p_value) if figure.difference else ""
    return " · ".join(part for part in (number, figure.count(), figure.interval(), p) if part)


def fitted(text: str, width_px: float) -> str:
    """Shorten a text to a width. If it is cut, an ellipsis is appended."""
    most = max(1, int(width_px / _CHARACTER_PX))
    return text if len(text) <= most else text[: most - 1].rstrip() + "…"


def _tick(value: float) -> str:
    return minus(round_half_up(100 * value, 0))


def _patterns(name: str) -> str:
    """Return the SVG definitions of the fill patterns.

    Their ids include the name of the drawing, since a page has several drawings.
    """
    made = (
        f'<pattern id="{name}-{family}" width="6" height="6" patternUnits="userSpaceOnUse">{marks}</pattern>'
        for family, marks in PATTERNS.items()
        if marks
    )
    return f"<defs>{''.join(made)}</defs>"


def _margins(chart: Chart) -> tuple[float, float]:
    """Return the x positions at which bars begin and end in the wide version.

    Names and numbers need the rest of the width.
    """
    rows = [row for group in chart.groups for row in group.rows]
    name = max((len(row.name) for row in rows), default=0) * _CHARACTER_PX + 10
    words = max((len(reading(row.figure)) for row in rows if isinstance(row, Bar)), default=0) * _CHARACTER_PX + 14
    left = min(max(name, _LEAST_NAME_PX), _MOST_NAME_PX)
    return left, max(left + _LEAST_BAR_PX, WIDE_PX - words)


class _Pen:
    """Pen that draws the parts of a chart from top to bottom."""

    def __init__(self, name: str, width: int, *, narrow: bool) -> None:
        self.name = name
        self.narrow = narrow
        self.width = width
        self.left = 2.0 if narrow else 132.0
        self.right = width - 8.0 if narrow else width - 212.0
        self.y = 2.0
        self.marks: list[str] = []

    def text(self, x: float, y: float, text: str, style: str = "", full: str = "") -> None:
        """Write a text. If it was shortened, ``full`` is shown as a tooltip."""
        hint = f"<title>{markup_text(full)}</title>" if full and full != text else ""
        self.marks.append(f'<text x="{x:.1f}" y="{y:.1f}" class="{style}">{markup_text(text)}{hint}</text>')

    def box(self, x: float, width: float, height: float, style: str) -> None:
        """Draw a bar at the current vertical position, with the fill pattern of its outcome family."""
        at = f'x="{x:.1f}" y="{self.y:.1f}" width="{max(width, 0.0):.1f}" height="{height:.1f}"'
        self.marks.append(f'<rect {at} class="box {style}"/>')
        if PATTERNS.get(style):
            self.marks.append(f'<rect {at} fill="url(#{self.name}-{style})"/>')

    def key(self, entries: Sequence[tuple[str, str]]) -> None:
        """Draw the legend, on as many lines as needed."""
        if not entries:
            return
        x = self.left
        for style, name in entries:
            room = 24 + len(name) * _CHARACTER_PX + 14
            if x + room > self.width and x > self.left:
                x, self.y = self.left, self.y + 18
            if style == "dot":
                self.marks.append(f'<circle cx="{x + 6:.1f}" cy="{self.y + 6:.1f}" r="4" class="point"/>')
            else:
                self.box(x, 12, 11, style)
            self.text(x + 18, self.y + 10, name, "soft")
            x += room
        self.y += 26

    def chart(self, chart: Chart) -> None:
        """Draw the scale and all rows of a chart."""
        bars = any(isinstance(group, BarGroup) for group in chart.groups)
        if bars:
            for value in chart.scale.values:
                self._tick(chart.scale, value)
            self.y += 16
        for group in chart.groups:
            if group.title:
                self.y += 4
                self.text(0, self.y + 13, fitted(group.title, self.width), "head")
                self.y += 19
            for row in group.rows:
                if isinstance(row, Bar):
                    self._bar(chart.scale, row)
                else:
                    self._stack(row)
            self.y += 5

    def _tick(self, scale: Scale, value: float) -> None:
        """Write a value below its grid line. Text at the border of the drawing is aligned with the border."""
        x, text = self._x(scale, value), _tick(value)
        half = len(text) * _CHARACTER_PX / 2
        side = " begin" if x < half else " end" if x + half > self.width else ""
        self.text({" begin": 0.0, " end": self.width}.get(side, x), self.y + 10, text, f"tick{side}")

    def _x(self, scale: Scale, value: float) -> float:
        return self.left + scale.share(value) * (self.right - self.left)

    def _bar(self, scale: Scale, row: Bar) -> None:
        figure, words = row.figure, reading(row.figure)
        if self.narrow:
            self.text(0, self.y + 12, fitted(row.name, self.width), "soft", row.name)
            if (len(row.name) + len(words)) * _CHARACTER_PX + 14 > self.width:
                self.y += 15
            self.text(self.width, self.y + 12, words, "reading end")
            self.y += 17
        else:
            self.text(0, self.y + 11, fitted(row.name, self.left - 8), "soft", row.name)
            self.text(self.right + 12, self.y + 11, words, "reading")
        for value in scale.values:
            x = self._x(scale, value)
            kind = "zero" if abs(value) < 1e-9 else "line"
            self.marks.append(
                f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{self.y - 1:.1f}" y2="{self.y + 15:.1f}" class="{kind}"/>'
            )
        if figure.value is not None:
            middle = self.y + 7
            x = self._x(scale, figure.value)
            if row.style == "dot":
                self.marks.append(f'<circle cx="{x:.1f}" cy="{middle:.1f}" r="4.5" class="point"/>')
            else:
                zero = self._x(scale, 0.0)
                self.y += 1
                self.box(min(zero, x), abs(x - zero), 12, row.style)
                self.y -= 1
            if figure.low is not None and figure.high is not None:
                low, high = self._x(scale, figure.low), self._x(scale, figure.high)
                for style in ("halo", "whisker"):
                    self.marks.append(
                        f'<path d="M{low:.1f} {middle:.1f}H{high:.1f}M{low:.1f} {middle - 3.5:.1f}v7'
                        f'M{high:.1f} {middle - 3.5:.1f}v7" class="{style}"/>'
                    )
        self.y += 20 if self.narrow else 18

    def _stack(self, row: Stack) -> None:
        total = f"n = {row.n}"
        if self.narrow:
            self.text(0, self.y + 12, fitted(row.name, self.width - 80), "soft", row.name)
            self.text(self.width, self.y + 12, total, "soft end")
            self.y += 17
            left, right = 0.0, float(self.width)
        else:
            self.text(0, self.y + 14, fitted(row.name, self.left - 8), "soft", row.name)
            left, right = self.left, self.width - 76.0
            self.text(right + 10, self.y + 14, total, "soft")
        for family, x, width, count in _segments(row, left, right):
            self.box(x, width - 1, 19, family)
            words = next((w for w in (f"{count}/{row.n}", str(count)) if len(w) * 6.8 + 8 <= width), None)
            if words is not None:
                if PATTERNS[family]:
                    plate = len(words) * 6.8 + 4
                    middle = x + (width - 1) / 2
                    self.marks.append(
                        f'<rect x="{middle - plate / 2:.1f}" y="{self.y + 3:.1f}" width="{plate:.1f}" height="13" '
                        f'rx="2" class="box {family}"/>'
                    )
                self.text(x + (width - 1) / 2, self.y + 14, words, f"in {family}")
        self.y += 25


def _segments(row: Stack, left: float, right: float) -> Iterator[tuple[str, float, float, int]]:
    x = left
    for family, count in row.counts:
        if count:
            width = (right - left) * count / row.n
            yield family, x, width, count
            x += width
