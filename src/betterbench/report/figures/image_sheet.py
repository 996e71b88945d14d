"""Sheets of labeled images for documents, such as pairs of scenes by task, or variants of objects by category."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

PAPER, INK, SOFT = "#fafaf8", "#1c1c1e", "#6e6e74"
"""Colors of the background, the titles and the subtitles."""

_DPI = 100
_GAP_PX, _PAD_PX, _LINE_PX = 4, 10, 19


@dataclass(frozen=True, slots=True)
class SheetCell:
    """Cell of a sheet: images side by side, (height, width, 3) uint8, under a title and a gray subtitle."""

    title: str
    images: Sequence[np.ndarray]
    subtitle: str = ""


def image_sheet(rows: Sequence[Sequence[SheetCell]]) -> np.ndarray:
    """Draw a sheet from rows of cells, as (height, width, 3) uint8 pixels. Images are not resized.

    All cells have the same number of images, and all images have the same width. A row is as tall as its tallest image.
    A text that is wider than its cell is cut after a word.
    """
    cells = [cell for row in rows for cell in row]
    wide = cells[0].images[0].shape[1]
    count = max(len(cell.images) for cell in cells)
    head = _LINE_PX * (2 if any(cell.subtitle for cell in cells) else 1)
    room = count * (wide + _GAP_PX) - _GAP_PX
    tops = [_PAD_PX]
    for row in rows:
        tall = max((image.shape[0] for cell in row for image in cell.images), default=0)
        tops.append(tops[-1] + head + tall + _PAD_PX)
    height, width = tops[-1], max(map(len, rows)) * (room + _PAD_PX) + _PAD_PX
    figure = Figure((width / _DPI, height / _DPI), _DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)

    def write(text: str, x: int, y: int, size_px: float, color: str) -> None:
        drawn = figure.text(
            x / width, 1 - y / height, text, fontsize=size_px * 72 / _DPI, color=color, va="top", parse_math=False
        )
        while drawn.get_window_extent().width > room and " " in text:
            text = text.rpartition(" ")[0]
            drawn.set_text(f"{text} …")

    for i, row in enumerate(rows):
        for j, cell in enumerate(row):
            x, y = _PAD_PX + j * (room + _PAD_PX), tops[i]
            write(cell.title, x, y, 14, INK)
            write(cell.subtitle, x, y + _LINE_PX, 12, SOFT)
            for k, image in enumerate(cell.images):
                figure.figimage(image, x + k * (wide + _GAP_PX), height - y - head - image.shape[0], origin="upper")
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()  # type: ignore[no-untyped-call]
