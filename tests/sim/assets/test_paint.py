"""Canvases: masks, weights and factors of rows or columns alone give the same pixels as arrays of the full size."""

import numpy as np
import pytest
from tests.looping import each

from betterbench.sim.assets.authoring import Canvas

INK = (0.9, 0.2, 0.1)


def blank() -> Canvas:
    return Canvas(2.0, 1.0, (24, 16), (0.3, 0.5, 0.8))


def full(canvas: Canvas, values: np.ndarray) -> np.ndarray:
    return np.broadcast_to(values, (canvas.y.size, canvas.x.size)).copy()


@each("strength", [1.0, 0.4])
@each(
    "mask",
    [
        lambda c: c.y > 0.6,
        lambda c: c.x < 0.7,
        lambda c: c.y > 5.0,
        lambda c: c.x > 5.0,
        lambda c: np.clip(c.y - 0.3, 0.0, 1.0),
        lambda c: np.clip(1.0 - c.x, 0.0, 1.0),
        lambda c: np.zeros_like(c.x),
        lambda c: np.ones_like(c.y),
    ],
)
def test_a_mask_of_rows_or_columns_stands_for_the_whole_texture(mask, strength):
    short, whole = blank(), blank()
    short.paint(mask(short), INK, strength=strength)
    whole.paint(full(whole, mask(whole)), INK, strength=strength)
    assert (short.pixels() == whole.pixels()).all()


def test_a_factor_of_rows_or_columns_stands_for_the_whole_texture():
    short, whole = blank(), blank()
    for factor in (0.5 + 0.5 * short.y, 1.0 - 0.3 * short.x):
        short.shade(factor)
        whole.shade(full(whole, factor))
    assert (short.pixels() == whole.pixels()).all()


def test_a_mask_paints_its_samples_and_no_others():
    canvas = blank()
    before = canvas.pixels()
    canvas.paint((canvas.x < 1.0) & (canvas.y > 0.5), (1.0, 1.0, 1.0))
    after = canvas.pixels()
    assert after.shape == (16, 24, 3)
    assert (after[:8, :12] == 255).all(), "the upper left quarter"
    changed = (after != before).any(axis=2)
    assert not changed[8:].any()
    assert not changed[:, 12:].any()


def test_radius_and_angle_are_measured_from_the_center():
    canvas = blank()
    x, y = full(canvas, canvas.x) - 1.0, full(canvas, canvas.y) - 0.5
    assert canvas.radius == pytest.approx(np.hypot(x, y))
    assert canvas.angle == pytest.approx(np.arctan2(y, x))
