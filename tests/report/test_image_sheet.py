"""Sheets of images: every image is in its place with its own pixels, and long titles stay in their cells."""

from __future__ import annotations

import numpy as np


def test_images_keep_their_pixels_and_texts_their_cells():
    from betterbench.report.figures.image_sheet import PAPER, SheetCell, image_sheet

    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (3, 2, 40, 60, 3), dtype=np.uint8)
    title = "a title of $many$ words that is far too long for its narrow cell"
    first, second, third = (SheetCell(title, tuple(pair), "a → b") for pair in images)
    sheet = image_sheet([[first, second], [third]])
    for pair, (x, y) in zip(images, ((10, 48), (144, 48), (10, 136)), strict=True):
        for k, image in enumerate(pair):
            assert np.array_equal(sheet[y : y + 40, x + 64 * k : x + 64 * k + 60], image)
    paper = np.array([int(PAPER[i : i + 2], 16) for i in (1, 3, 5)])
    assert (sheet[:, 134:144] == paper).all(), "no text crosses into the next cell"
    assert (sheet[136:176, 144:] == paper).all()
    assert (sheet[10:48, 10:134] < 100).any()
