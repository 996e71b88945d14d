"""Preflight sheet: a PNG that shows the inputs of a policy and the effect of its first answer."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patheffects import withStroke
from matplotlib.textpath import TextToPath

from betterbench.jobs import write_durably
from betterbench.jobs.outputs import mark_of

OUTLINE = "#ff40a0"
"""Color of the arrow and the dots. No object of the suite has this color."""

_PAPER, _INK, _GRAY, _LINE = "#fafaf8", "#1c1c1e", "#6e6e74", "#d6d6d2"
_TITLE, _HEAD, _TEXT, _SMALL = 30, 22, 20, 16  # font sizes [px]
_WIDTH, _PAD = 1400, 36
_LARGEST_IMAGE = 512
_LEAST_COLUMN = 300
_VIEW = 640
_DPI = 100
_LETTERS = TextToPath()

CLEAR_PX = 70.0
"""Minimum length of the drawn arrow of the first action [px].

A shorter arrow is enlarged by the smallest of :data:`FACTORS` that is sufficient, or else by the largest.
"""
FACTORS = (1, 2, 5, 10, 20, 50)


class _Shown(Protocol):
    """Image with its labels, see :class:`betterbench.evaluation.preflight.check.ShownImage`."""

    @property
    def key(self) -> str: ...

    @property
    def image(self) -> np.ndarray: ...

    @property
    def note(self) -> str: ...


class _Content(Protocol):
    """Content of the sheet, as provided by :class:`betterbench.evaluation.preflight.view.PreflightView`."""

    @property
    def title(self) -> str: ...

    @property
    def trial(self) -> str: ...

    @property
    def prompt(self) -> str: ...

    @property
    def shown(self) -> Sequence[_Shown]: ...

    @property
    def no_images(self) -> str: ...

    @property
    def state(self) -> Sequence[tuple[str, str]]: ...

    @property
    def facts(self) -> Sequence[tuple[str, str]]: ...

    @property
    def latency(self) -> str: ...

    @property
    def scene(self) -> np.ndarray: ...

    @property
    def path(self) -> np.ndarray: ...

    @property
    def aim(self) -> np.ndarray: ...

    @property
    def turn(self) -> str: ...


def write_preflight_sheet(content: _Content, path: Path) -> Path:
    """Write the preflight sheet as a PNG with a width of 1400 pixels, and return its path."""
    page = _Page()
    page.write(content.title, _TITLE)
    page.write(content.trial, _SMALL, _GRAY)
    page.rule()
    page.write("Input of the policy", _HEAD)
    page.write(f"“{content.prompt}”", _TEXT)
    page.y += 8
    if content.shown:
        _add_images(page, content.shown)
    else:
        page.write(content.no_images, _TEXT, _GRAY)
    page.y += 14
    page.rows(content.state, name_width=330)
    page.rule()
    page.write("Effect of the first answer", _HEAD)
    page.y += 8
    top = page.y
    height, width = content.scene.shape[:2]
    page.image(content.scene, (page.x, top), (width, height), content)
    page.column(2 * _PAD + width, _WIDTH - _PAD)
    page.rows(content.facts, name_width=150)
    page.y += 10
    page.write(content.latency, _SMALL, _GRAY)
    page.y = max(page.y, top + height)
    buffer = io.BytesIO()
    page.figure().savefig(buffer, format="png", dpi=_DPI, metadata={"Software": mark_of("doctor")})
    write_durably(path, buffer.getvalue())
    return path


class _Page:
    """Canvas on which texts and images are placed from top to bottom.

    Positions are in pixels from the upper left corner.

    The canvas is drawn when it is complete.
    """

    def __init__(self) -> None:
        self.x, self.y, self.width = _PAD, float(_PAD), _WIDTH - 2 * _PAD
        self._items: list[Callable[[Figure, float], None]] = []

    def column(self, left: int, right: int) -> None:
        """Continue in a column between two x coordinates [px]. The column begins at the top of the last image."""
        self.x, self.width = left, right - left
        self.y = self._image_top

    def write(self, text: str, size: int, color: str = _INK) -> None:
        """Write a text, wrapped to the width of the column."""
        font = FontProperties(size=_points(size))
        for line in _broken(text, font, self.width):
            self._items.append(_text(self.x, self.y, line, font, color))
            self.y += 1.4 * size

    def rows(self, rows: Sequence[tuple[str, str]], *, name_width: int) -> None:
        """Write names and values in two columns."""
        left, width = self.x, self.width
        for name, value in rows:
            top = self.y
            self.width = name_width - 14
            self.write(name, _SMALL, _GRAY)
            bottom, self.y = self.y, top
            self.x, self.width = left + name_width, width - name_width
            self.write(value, _SMALL)
            self.x, self.width, self.y = left, width, max(bottom, self.y) + 5

    def rule(self) -> None:
        """Draw a horizontal line with space above and below it."""
        y = self.y + 18

        def draw(figure: Figure, height: float) -> None:
            axes = figure.add_axes(_box(_PAD, y, _WIDTH - 2 * _PAD, 2, height))
            axes.set_facecolor(_LINE)
            axes.set(xticks=[], yticks=[])
            axes.spines[:].set_visible(False)

        self._items.append(draw)
        self.y += 38

    def image(
        self, image: np.ndarray, at: tuple[int, float], size: tuple[int, int], action: _Content | None = None
    ) -> None:
        """Draw an image at a position. If ``action`` is given, draw the action of this sheet on the image."""
        (x, y), (width, height) = (at[0], math.floor(at[1])), size
        self._image_top = y

        def draw(figure: Figure, page: float) -> None:
            axes = figure.add_axes(_box(x, y, width, height, page))
            exact = width % image.shape[1] == 0 and height % image.shape[0] == 0
            extent = (0.0, image.shape[1], image.shape[0], 0.0)
            axes.imshow(image, interpolation="nearest" if exact else "antialiased", aspect="auto", extent=extent)
            axes.set(xticks=[], yticks=[])
            axes.spines[:].set_visible(False)
            if action is not None:
                _draw_action(axes, action)

        self._items.append(draw)

    def figure(self) -> Figure:
        """Return the canvas as a figure that is as tall as its content."""
        height = math.ceil(self.y + _PAD)
        figure = Figure(figsize=(_WIDTH / _DPI, height / _DPI), dpi=_DPI, facecolor=_PAPER)
        for draw in self._items:
            draw(figure, height)
        return figure


def _add_images(page: _Page, shown: Sequence[_Shown]) -> None:
    """Draw the images side by side. Small images are enlarged by an integer factor."""
    left, right, bottom, top = page.x, page.x + page.width, page.y, page.y
    x = left
    for item in shown:
        height, width = item.image.shape[:2]
        factor = _LARGEST_IMAGE / max(width, height)
        factor = float(int(factor)) if factor >= 1.0 else factor
        drawn = (max(1, round(width * factor)), max(1, round(height * factor)))
        column = max(drawn[0], _LEAST_COLUMN)
        if x > left and x + column > right:
            x, top = left, bottom + 18
        page.image(item.image, (x, top), drawn)
        page.x, page.y, page.width = x, math.floor(top) + drawn[1] + 8, column
        page.write(item.key, _SMALL)
        page.write(item.note, _SMALL, _GRAY)
        bottom = max(bottom, page.y)
        x += column + _PAD
    page.x, page.width, page.y = left, right - left, bottom


def _draw_action(axes: Axes, content: _Content) -> None:
    start, factor = content.path[0], arrow_factor(content.path[0], content.aim)
    halo = [withStroke(linewidth=3.0, foreground="white")]
    if factor:
        tip = start + factor * (content.aim - start)
        style = {"arrowstyle": "-|>,head_length=0.7,head_width=0.35", "mutation_scale": 18, "shrinkA": 0, "shrinkB": 0}
        style |= {"color": OUTLINE, "linewidth": 3.2, "path_effects": [withStroke(linewidth=6.5, foreground="white")]}
        axes.annotate("", tip, start, arrowprops=style, annotation_clip=False)
    seen = content.path[np.isfinite(content.path).all(axis=1)]
    axes.plot(*seen[1:].T, "o", color=OUTLINE, markersize=3.4, path_effects=halo, zorder=5)
    if np.isfinite(start).all():
        axes.plot(*start, "o", color=OUTLINE, markersize=9.0, path_effects=halo, zorder=4)
    note = "arrow: the first action" if factor else "the first action does not move the gripper"
    note += f", drawn {factor} times as long" if factor > 1 else ""
    note += "; dots: the whole answer" if len(content.path) > 2 else ""
    width = content.scene.shape[1]
    font = FontProperties(size=_points(17))
    lines = "\n".join(line for text in (note, content.turn) for line in _broken(text, font, width - 32))
    box = {"facecolor": "#141418", "alpha": 0.8, "edgecolor": "none", "pad": 8.0}
    at = (16, content.scene.shape[0] - 14)
    axes.text(*at, lines, color="white", fontproperties=font, va="bottom", bbox=box, parse_math=False)
    axes.set(xlim=(0, width), ylim=(content.scene.shape[0], 0))


def arrow_factor(start: np.ndarray, aim: np.ndarray) -> int:
    """Return the enlargement factor of the arrow between two pixels. Return 0 if there is nothing to draw."""
    length = float(np.hypot(*(aim - start)))
    if not math.isfinite(length) or length < 0.2:
        return 0
    return next((f for f in FACTORS if f * length >= CLEAR_PX), FACTORS[-1])


def _text(x: float, y: float, line: str, font: FontProperties, color: str) -> Callable[[Figure, float], None]:
    def draw(figure: Figure, height: float) -> None:
        figure.text(x / _WIDTH, 1.0 - y / height, line, fontproperties=font, color=color, va="top", parse_math=False)

    return draw


def _box(x: float, y: float, width: float, height: float, page: float) -> tuple[float, float, float, float]:
    """Convert a rectangle from pixels (with the origin at the upper left) to fractions of the figure size."""
    return x / _WIDTH, 1.0 - (y + height) / page, width / _WIDTH, height / page


def _points(pixels: float) -> float:
    return 72.0 * pixels / _DPI


def _broken(text: str, font: FontProperties, width: float) -> list[str]:
    """Wrap a text to a width [px]. A word that is longer than a line is cut."""

    def length(line: str) -> float:
        return float(_LETTERS.get_text_width_height_descent(line, font, ismath=False)[0]) * _DPI / 72.0

    lines = [""]
    for word in text.split():
        candidate = f"{lines[-1]} {word}".strip()
        if length(candidate) <= width:
            lines[-1] = candidate
            continue
        rest = word
        while rest:
            fitting = max((n for n in range(1, len(rest) + 1) if length(rest[:n]) <= width), default=1)
            lines.append(rest[:fitting])
            rest = rest[fitting:]
    return [line for line in lines if line]
