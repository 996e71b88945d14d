"""Textures of table tops. The materials differ in their pattern, not only in their color.

Strong patterns are coarse and fine patterns are faint. In an image of 256 pixels, each pixel of the front camera shows
about 2.7 mm of the table. High-contrast stripes or grains of that size would cause moire.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

Painter = Callable[[np.ndarray, int], np.ndarray]
"""Function from a mean color (3,) in [0, 1] and a side length [pixel] to pixels (side, side, 3) uint8."""


def _smooth_noise(rng: np.random.Generator, size: int, cells: tuple[int, int]) -> np.ndarray:
    """Return smooth periodic noise in [-1, 1] of shape (size, size), interpolated from a coarse random grid.

    The grid values are blended with cosine weights. ``cells`` is the number of grid cells along the rows and the
    columns.
    """
    grid = rng.uniform(-1.0, 1.0, size=cells)
    for axis, count in enumerate(cells):
        place = np.arange(size) * (count / size)
        low = place.astype(int)
        weight = 0.5 - 0.5 * np.cos(math.pi * (place - low))
        shape = (-1, 1) if axis == 0 else (1, -1)
        weight = weight.reshape(shape)
        grid = np.take(grid, low % count, axis) * (1.0 - weight) + np.take(grid, (low + 1) % count, axis) * weight
    return np.asarray(grid)


def _to_pixels(color: np.ndarray, brightness: np.ndarray) -> np.ndarray:
    """Multiply a color (3,) in [0, 1] by a brightness (n, n) or (n, n, 3), and return (n, n, 3) uint8 pixels."""
    factor = brightness if brightness.ndim == 3 else brightness[:, :, None]
    pixels: np.ndarray = np.clip(np.rint(255.0 * color * factor), 0, 255).astype(np.uint8)
    return pixels


def _staves(color: np.ndarray, size: int, staves: int, contrast: float, seed: int) -> np.ndarray:
    """Paint glued wooden staves along the columns of the texture. The tones of the staves differ by ``contrast``."""
    rng = np.random.default_rng(seed)
    stave = np.arange(size) * staves // size
    tone = (contrast * rng.uniform(-1.0, 1.0, staves))[stave]
    shift = rng.integers(0, size, size=staves)[stave]
    grain = 0.6 * _smooth_noise(rng, size, (64, 4)) + 0.4 * _smooth_noise(rng, size, (256, 6))
    cloud = _smooth_noise(rng, size, (16, 2))
    columns = (np.arange(size)[None, :] + shift[:, None]) % size
    grain = np.take_along_axis(grain, columns, axis=1)
    seam = np.where(np.arange(size) % (size // staves) < 2, 0.07, 0.0)
    return _to_pixels(color, 1.0 + tone[:, None] + 0.03 * grain + 0.02 * cloud - seam[:, None])


def _wood(color: np.ndarray, size: int) -> np.ndarray:
    """Paint broad wooden staves with low contrast."""
    return _staves(color, size, 8, 0.045, 20_011)


def _planks(color: np.ndarray, size: int) -> np.ndarray:
    """Paint five weathered planks with clearly different tones."""
    return _staves(color, size, 5, 0.11, 20_014)


def _laminate(color: np.ndarray, size: int) -> np.ndarray:
    """Paint a plain laminate with fine speckles."""
    rng = np.random.default_rng(20_012)
    speckle = 0.6 * _smooth_noise(rng, size, (128, 128)) + 0.4 * _smooth_noise(rng, size, (24, 24))
    return _to_pixels(color, 1.0 + 0.035 * speckle)


def _cloth(color: np.ndarray, size: int) -> np.ndarray:
    """Paint a woven cloth of two crossed threads."""
    rng = np.random.default_rng(20_013)
    place = np.arange(size) * (2.0 * math.pi * 64 / size)
    weave = np.sin(place)[:, None] * np.sin(place)[None, :]
    return _to_pixels(color, 1.0 + 0.05 * weave + 0.03 * _smooth_noise(rng, size, (48, 48)))


def _stone(color: np.ndarray, size: int) -> np.ndarray:
    """Paint polished concrete with clouds of several sizes."""
    rng = np.random.default_rng(20_015)
    clouds = sum(
        weight * _smooth_noise(rng, size, (cells, cells)) for weight, cells in ((0.45, 6), (0.35, 14), (0.2, 40))
    )
    return _to_pixels(color, 1.0 + 0.10 * np.asarray(clouds))


def _terrazzo(color: np.ndarray, size: int) -> np.ndarray:
    """Paint terrazzo: chips of lighter and darker stone, one to three centimeters wide, on an even ground."""
    rng = np.random.default_rng(20_016)
    brightness = 1.0 + 0.02 * _smooth_noise(rng, size, (96, 96))
    for cells, level, tone in ((70, 0.66, 0.09), (90, 0.70, -0.14), (80, 0.70, -0.07)):
        brightness = np.where(_smooth_noise(rng, size, (cells, cells)) > level, 1.0 + tone, brightness)
    return _to_pixels(color, brightness)


def _stripes(color: np.ndarray, size: int) -> np.ndarray:
    """Paint a tablecloth with soft stripes, ten centimeters wide, along the columns of the texture."""
    rng = np.random.default_rng(20_017)
    wave = np.sin(np.arange(size) * (2.0 * math.pi * 6 / size))
    band = np.tanh(6.0 * wave)[:, None] * np.ones((1, size))
    return _to_pixels(color, 1.0 + 0.09 * band + 0.02 * _smooth_noise(rng, size, (96, 96)))


def _tiles(color: np.ndarray, size: int) -> np.ndarray:
    """Paint glazed tiles, fifteen centimeters wide, with darker joints. The tones of the tiles differ slightly."""
    rng = np.random.default_rng(20_018)
    number = np.arange(size) * 8 // size
    tone = 0.06 * rng.uniform(-1.0, 1.0, (8, 8))[number][:, number]
    place = np.arange(size) % (size // 8)
    joint = np.minimum(place, size // 8 - place) < 2
    grid = joint[:, None] | joint[None, :]
    return _to_pixels(color, np.where(grid, 0.80, 1.0 + tone + 0.02 * _smooth_noise(rng, size, (32, 32))))


def _checks(color: np.ndarray, size: int) -> np.ndarray:
    """Paint a tablecloth with checks, twelve centimeters wide, woven from two tones of one color."""
    rng = np.random.default_rng(20_019)
    wave = np.tanh(6.0 * np.sin(np.arange(size) * (2.0 * math.pi * 5 / size)))
    return _to_pixels(color, 1.0 + 0.05 * (wave[:, None] + wave[None, :]) + 0.02 * _smooth_noise(rng, size, (96, 96)))


SURFACES: Mapping[str, Painter] = {
    "wood": _wood,
    "planks": _planks,
    "laminate": _laminate,
    "cloth": _cloth,
    "stone": _stone,
    "terrazzo": _terrazzo,
    "stripes": _stripes,
    "tiles": _tiles,
    "checks": _checks,
}
"""Painters of the surfaces, by the name of the surface."""
