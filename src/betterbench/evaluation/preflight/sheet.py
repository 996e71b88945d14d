"""One sheet that shows what a policy is shown, and what it does about it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from betterbench.evaluation.figures.show import OUTLINE

_PAPER, _INK, _SOFT, _LINE = (250, 250, 248), (28, 28, 30), (110, 110, 116), (214, 214, 210)
_TITLE, _HEAD, _TEXT, _SMALL = 34, 26, 23, 18
_WIDTH, _HEIGHT, _PAD = 1400, 6000, 36
_LARGEST_PICTURE = 512
_CLEAR_PX = 70.0
_FACTORS = (1, 2, 5, 10, 20, 50)

Font = ImageFont.FreeTypeFont | ImageFont.ImageFont


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """One image as the policy gets it.

    Attributes:
        key: Name under which it travels.
        image: (height, width, 3) uint8.
        note: Where it comes from and what was done to it.
    """

    key: str
    image: np.ndarray
    note: str


@dataclass(frozen=True, slots=True)
class Sheet:
    """Everything that is drawn.

    Attributes:
        title: Head of the sheet.
        trial: The trial, for people.
        prompt: The sentence as the policy gets it.
        shown: The images; none for a policy that never looks.
        blind: What is said instead of images.
        state: Numbers that the policy gets: key, then text of its values.
        facts: Lines about the action: name and value.
        latency: Line about the time it took.
    """

    title: str
    trial: str
    prompt: str
    shown: tuple[Shown, ...]
    blind: str
    state: tuple[tuple[str, str], ...]
    facts: tuple[tuple[str, str], ...]
    latency: str


def draw_sheet(sheet: Sheet, view: Image.Image) -> Image.Image:
    """Return the sheet.

    Args:
        sheet: What to write.
        view: The scene with the action drawn into it, some 640 pixels wide.
    """
    page = Image.new("RGB", (_WIDTH, _HEIGHT), _PAPER)
    column = _Column(page, _PAD, _PAD, _WIDTH - 2 * _PAD)
    column.write(sheet.title, _TITLE)
    column.write(sheet.trial, _SMALL, _SOFT)
    column.rule()
    column.write("What the policy is shown", _HEAD)
    column.write(f"“{sheet.prompt}”", _TEXT)
    column.y += 8
    if sheet.shown:
        _draw_images(column, sheet.shown)
    else:
        column.write(sheet.blind, _TEXT, _SOFT)
    column.y += 14
    column.rows(sheet.state, name_width=330)
    column.rule()
    column.write("What it does", _HEAD)
    column.y += 8
    page.paste(view, (_PAD, column.y))
    left = 2 * _PAD + view.width
    beside = _Column(page, left, column.y, _WIDTH - left - _PAD)
    beside.rows(sheet.facts, name_width=170)
    beside.y += 10
    beside.write(sheet.latency, _SMALL, _SOFT)
    return page.crop((0, 0, _WIDTH, min(_HEIGHT, max(column.y + view.height, beside.y) + _PAD)))


def _draw_images(column: _Column, shown: Sequence[Shown]) -> None:
    """Draw the images pixel by pixel, small ones enlarged by a whole factor."""
    x, y, bottom = column.x, column.y, column.y
    for item in shown:
        image = _enlarged(Image.fromarray(item.image))
        width = max(image.width, 300)
        if x > column.x and x + width > column.x + column.width:
            x, y = column.x, bottom + 18
        column.page.paste(image, (x, y))
        frame = [x - 1, y - 1, x + image.width, y + image.height]
        ImageDraw.Draw(column.page).rectangle(frame, outline=_LINE)
        label = _Column(column.page, x, y + image.height + 8, width)
        label.write(item.key, _SMALL)
        label.write(item.note, _SMALL, _SOFT)
        bottom = max(bottom, label.y)
        x += width + _PAD
    column.y = bottom


def _enlarged(image: Image.Image) -> Image.Image:
    side = max(image.size)
    factor = _LARGEST_PICTURE / side
    if factor >= 1.0:
        factor = float(int(factor))
    size = (max(1, round(image.width * factor)), max(1, round(image.height * factor)))
    return image.resize(size, Image.Resampling.NEAREST if factor >= 1.0 else Image.Resampling.LANCZOS)


class _Column:
    """Writes text from top to bottom.

    Attributes:
        page: The sheet.
        x: Left edge [pixel].
        y: Where the next line goes [pixel].
        width: Width [pixel].
    """

    def __init__(self, page: Image.Image, x: int, y: int, width: int) -> None:
        self.page, self.x, self.y, self.width = page, x, y, width
        self._draw = ImageDraw.Draw(page)

    def write(self, text: str, size: int, color: tuple[int, int, int] = _INK) -> None:
        """Write text, broken where it does not fit."""
        font = ImageFont.load_default(size)
        for line in _broken(text, font, self.width):
            self._draw.text((self.x, self.y), line, fill=color, font=font)
            self.y += round(1.36 * size)

    def rows(self, rows: Sequence[tuple[str, str]], *, name_width: int) -> None:
        """Write names and values beside each other."""
        for name, value in rows:
            left = _Column(self.page, self.x, self.y, name_width - 14)
            left.write(name, _SMALL, _SOFT)
            right = _Column(self.page, self.x + name_width, self.y, self.width - name_width)
            right.write(value, _SMALL)
            self.y = max(left.y, right.y) + 5

    def rule(self) -> None:
        """Draw a line across, with air above and below."""
        self.y += 18
        self._draw.line([(self.x, self.y), (self.x + self.width, self.y)], fill=_LINE, width=2)
        self.y += 20


def _broken(text: str, font: Font, width: int) -> list[str]:
    """Return text in lines of a width; a word that is longer than a line is cut."""
    lines = [""]
    for word in text.split():
        candidate = f"{lines[-1]} {word}".strip()
        if font.getlength(candidate) <= width:
            lines[-1] = candidate
            continue
        rest = word
        while rest:
            fitting = max((n for n in range(1, len(rest) + 1) if font.getlength(rest[:n]) <= width), default=1)
            lines.append(rest[:fitting])
            rest = rest[fitting:]
    return [line for line in lines if line]


def draw_action(view: np.ndarray, path: np.ndarray, aim: np.ndarray, note: str) -> Image.Image:
    """Return a image of the scene with the action drawn into it.

    Args:
        view: (height, width, 3) uint8.
        path: (n, 2) pixels that the end effector passes while the whole answer is executed, the first one now.
        aim: (2,) pixel that the first action leads to.
        note: Rotation and gripper in words.
    """
    image = Image.fromarray(view)
    lines = _Lines(image.size)
    start = path[0]
    factor = _factor(float(np.hypot(*(aim - start))))
    strokes = ((3.0, (255, 255, 255, 255)), (0.0, (*OUTLINE, 255)))
    for halo, color in strokes:
        lines.arrow(start, start + factor * (aim - start), halo, color)
        lines.dot(start, 6.0 + 0.6 * halo, color)
    for halo, color in strokes:
        for point in path[1:]:
            lines.dot(point, 2.2 + 0.5 * halo, color)
    drawn = lines.smooth()
    image.paste(drawn, (0, 0), drawn)
    words = "arrow: the first action" if factor else "the first action moves the hand nowhere"
    if factor > 1:
        words += f", drawn {factor} times as long"
    return _captioned(image, [words + ("; dots: the whole answer" if len(path) > 2 else ""), note])


class _Lines:
    """Lines on a clear image, drawn four times as large as they are shown: Pillow does not smooth them."""

    _FINE = 4

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size
        self._overlay = Image.new("RGBA", (size[0] * self._FINE, size[1] * self._FINE), (0, 0, 0, 0))
        self._draw = ImageDraw.Draw(self._overlay)

    def smooth(self) -> Image.Image:
        """Return the lines at their own size."""
        return self._overlay.resize(self._size, Image.Resampling.BOX)

    def dot(self, at: np.ndarray, radius: float, color: tuple[int, int, int, int]) -> None:
        """Draw a disc."""
        if np.isfinite(at).all():
            corners = np.concatenate([at - radius, at + radius]) * self._FINE
            self._draw.ellipse(corners.tolist(), fill=color)

    def arrow(self, start: np.ndarray, tip: np.ndarray, halo: float, color: tuple[int, int, int, int]) -> None:
        """Draw an arrow, wider by a halo on all sides."""
        along = tip - start
        length = float(np.hypot(*along))
        if not math.isfinite(length) or length < 1.0:
            return
        along = along / length
        across = np.array([-along[1], along[0]])
        head = min(20.0, 0.5 * length)
        neck = tip - head * along
        sides = (0.5 * head + halo) * across
        corners = [tip + 1.2 * halo * along, neck + sides - 0.7 * halo * along, neck - sides - 0.7 * halo * along]
        shaft = [tuple(self._FINE * start), tuple(self._FINE * neck)]
        self._draw.line(shaft, fill=color, width=round(self._FINE * (4.0 + halo)))
        self._draw.polygon([tuple(self._FINE * c) for c in corners], fill=color)


def _captioned(image: Image.Image, lines: Sequence[str]) -> Image.Image:
    """Write lines into the lower edge of a image, on a dark band."""
    font = ImageFont.load_default(image.width / 34)
    row, pad = round(image.width / 24), round(image.width / 40)
    wrapped = [line for text in lines for line in _broken(text, font, image.width - 2 * pad)]
    height = row * len(wrapped) + pad
    band = Image.new("RGBA", (image.width, height), (20, 20, 24, 190))
    image.paste(band, (0, image.height - height), band)
    draw = ImageDraw.Draw(image)
    for i, line in enumerate(wrapped):
        draw.text((pad, image.height - height + pad // 2 + i * row), line, fill=(255, 255, 255), font=font)
    return image


def _factor(length_px: float) -> int:
    """Return how many times as long an arrow is drawn; 0 if there is nothing to draw."""
    if not math.isfinite(length_px) or length_px < 0.2:
        return 0
    return next((f for f in _FACTORS if f * length_px >= _CLEAR_PX), _FACTORS[-1])
