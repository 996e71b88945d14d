"""Sensor noise of LIBERO-Plus: five kinds of noise at ten strengths each, applied to images of the front camera.

The kinds are those of ImageNet-C (Hendrycks and Dietterich 2019) with the strengths chosen by LIBERO-Plus. They are
reproduced bit for bit (tests/sim/worlds/test_libero_plus.py). LIBERO-Plus draws from NumPy's global generator at every
step, so :meth:`Noise.draw` has to be called even for images that are not used. This module is imported in LIBERO's
environment, so it uses only NumPy and SciPy.

Sources: sylvestf/LIBERO-plus@4976dc3 ``envs/env_wrapper.py``; for the motion blur, ImageMagick 6 ``MotionBlurImage``
(16 bits per channel), which LIBERO-Plus calls; for the Gaussian filter, scikit-image ``filters.gaussian``.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np

_FILTERS: Any = importlib.import_module("scipy.ndimage")
"""SciPy's image filters, as installed in LIBERO's environment."""

STRENGTHS = 10
"""Number of strengths of each kind of noise."""

_MOTION = ((5, 2), (8, 3), (10, 4), (12, 5), (15, 6), (18, 8), (20, 10), (25, 12), (30, 15), (35, 20))
"""Radius and standard deviation of the motion blur [pixel], for each strength."""
_ANGLE_DEG = 45.0
_ZOOMS = (
    (1.11, 0.01), (1.16, 0.01), (1.21, 0.02), (1.26, 0.02), (1.31, 0.03),
    (1.36, 0.01), (1.41, 0.01), (1.46, 0.02), (1.51, 0.02), (1.56, 0.03),
)  # fmt: skip
"""Largest magnification of the zoom blur, and the step between magnifications, for each strength."""
_FOGS = (
    (0.5, 3.0), (1.0, 2.8), (1.5, 2.5), (2.0, 2.2), (2.5, 2.0), (3.0, 1.8), (3.5, 1.6), (4.0, 1.5), (4.5, 1.4),
    (5.0, 1.3),
)  # fmt: skip
"""Density of the fog, and the factor by which each finer level of its pattern is attenuated, for each strength."""
_FOG_SIDE = 256
_FOG_ROUGHNESS = 100.0
_GLASS = (
    (0.5, 1, 3), (0.7, 1, 3), (0.9, 2, 3), (1.0, 2, 2), (1.1, 3, 2), (1.3, 3, 2), (1.5, 4, 2), (1.8, 4, 2), (2.2, 5, 1),
    (2.5, 5, 1),
)  # fmt: skip
"""Glass blur: standard deviation [pixel], largest shift [pixel] and number of rounds, for each strength."""


class Noise:
    """One of the 50 noise settings of LIBERO-Plus: motion, Gaussian, zoom, fog and glass blur, ten strengths each."""

    def __init__(self, number: int) -> None:
        """Select the noise with the given index, from 1 to 50."""
        self._kind, self._strength = divmod(number - 1, STRENGTHS)

    def draw(self, height: int, width: int) -> Any:  # noqa: ANN401 - what the kind needs
        """Draw the random numbers for one image of the given size [pixel]."""
        if self._kind == 0:
            return float(np.random.uniform(-_ANGLE_DEG, _ANGLE_DEG))  # noqa: NPY002 - LIBERO-Plus draws from the global generator
        if self._kind == 3:
            return _draw_fog(_FOGS[self._strength][1])
        if self._kind == 4:
            _, reach, rounds = _GLASS[self._strength]
            count = (height - 2 * reach) * (width - 2 * reach)
            return [np.random.randint(-reach, reach, size=(count, 2)) for _ in range(rounds)]  # noqa: NPY002
        return None

    def apply(self, image: np.ndarray, drawn: Any) -> np.ndarray:  # noqa: ANN401
        """Return the image (h, w, 3) with noise, as uint8. ``drawn`` is the result of :meth:`draw` for this image."""
        s = self._strength
        if self._kind == 0:
            return _motion(image, *_MOTION[s], drawn)
        if self._kind == 1:
            return _bytes(_gaussian(image / 255.0, s + 1))
        if self._kind == 2:
            return _zoom(image, *_ZOOMS[s])
        if self._kind == 3:
            return _fog(image, _FOGS[s][0], drawn)
        return _glass(image, _GLASS[s], drawn)


def _bytes(share: np.ndarray) -> np.ndarray:
    """Convert fractions of full brightness to uint8, after clipping them to [0, 1]."""
    return np.asarray(np.clip(share, 0, 1) * 255).astype(np.uint8)


def _gaussian(image: np.ndarray, sigma: float) -> np.ndarray:
    """Return a blurred image. The result equals that of SciPy's ``gaussian_filter`` with ``truncate=4``.

    The kernel is computed with Python's own ``exp``. NumPy's ``exp`` uses AVX-512 on machines that support it, which
    changes the last bit of the kernel and therefore some pixels.
    """
    radius = int(4.0 * sigma + 0.5)
    kernel = np.array([math.exp(-0.5 / (sigma * sigma) * x**2) for x in range(-radius, radius + 1)])
    kernel /= kernel.sum()
    for axis in (0, 1):
        image = _FILTERS.correlate1d(image, kernel, axis=axis, mode="nearest")
    return np.asarray(image)


def _motion(image: np.ndarray, radius: float, sigma: float, angle_deg: float) -> np.ndarray:
    """Blur an image by replacing each pixel with the weighted mean along a line that begins at the pixel."""
    taps = 2 * math.ceil(radius) + 1
    weights = [math.exp(-(i * i) / (2.0 * sigma * sigma)) / (math.sqrt(2.0 * math.pi) * sigma) for i in range(taps)]
    total = sum(weights)
    angle = math.radians(angle_deg)
    x, y = taps * math.sin(angle), taps * math.cos(angle)
    length = math.hypot(x, y)
    shifts = [(math.ceil(i * x / length - 0.5), math.ceil(i * y / length - 0.5)) for i in range(taps)]
    reach = max(max(abs(down), abs(right)) for down, right in shifts)
    height, width = image.shape[:2]
    wide = np.pad(image * 257.0, ((reach, reach), (reach, reach), (0, 0)), mode="edge")
    sums, part = np.zeros(image.shape), np.empty(image.shape)
    for weight, (down, right) in zip(weights, shifts, strict=True):
        there = wide[reach + down : reach + down + height, reach + right : reach + right + width]
        sums += np.multiply(there, weight / total, out=part)
    # ImageMagick rounds to sixteen bits and then down to eight.
    return (np.clip(sums + 0.5, 0, 65535).astype(np.int64) // 257).astype(np.uint8)


def _zoom(image: np.ndarray, end: float, step: float) -> np.ndarray:
    """Blur an image by averaging it with several magnifications of itself."""
    shares = (image / 255.0).astype(np.float32)
    sums = np.zeros_like(shares)
    factors = np.arange(1, end, step)
    for factor in factors:
        sums += _magnified(shares, float(factor))
    return _bytes((shares + sums) / (len(factors) + 1))


def _magnified(image: np.ndarray, factor: float) -> np.ndarray:
    side = image.shape[0]
    part = math.ceil(side / factor)
    first = (side - part) // 2
    piece = image[first : first + part, first : first + part]
    # Each channel alone gives the same bits in half the time of a magnification of three axes.
    large = np.stack([_FILTERS.zoom(channel, factor, order=1) for channel in np.moveaxis(piece, -1, 0)], axis=-1)
    cut = (large.shape[0] - side) // 2
    return np.asarray(large[cut : cut + side, cut : cut + side])


def _draw_fog(decay: float) -> np.ndarray:
    """Return a cloudy pattern (256, 256) with values from 0 to 1, drawn with the diamond-square algorithm."""
    heights = np.zeros((_FOG_SIDE, _FOG_SIDE))
    step, rough = _FOG_SIDE, _FOG_ROUGHNESS

    def mean_of(four: np.ndarray) -> np.ndarray:
        return np.asarray(four / 4 + rough * np.random.uniform(-rough, rough, four.shape))  # noqa: NPY002

    while step >= 2:
        half = step // 2
        corners = heights[::step, ::step]
        square = corners + np.roll(corners, -1, axis=0)
        square += np.roll(square, -1, axis=1)
        heights[half::step, half::step] = mean_of(square)
        centers = heights[half::step, half::step]
        across = corners + np.roll(corners, -1, axis=1) + (centers + np.roll(centers, 1, axis=0))
        down = corners + np.roll(corners, -1, axis=0) + (centers + np.roll(centers, 1, axis=1))
        heights[::step, half::step] = mean_of(across)
        heights[half::step, ::step] = mean_of(down)
        step, rough = half, rough / decay
    heights -= heights.min()
    return np.asarray(heights / heights.max())


def _fog(image: np.ndarray, density: float, pattern: np.ndarray) -> np.ndarray:
    shares = image / 255.0
    brightest = shares.max()
    height, width = image.shape[:2]
    foggy = shares + density * pattern[:height, :width, None]
    return _bytes(foggy * brightest / (brightest + density))


def _glass(image: np.ndarray, setting: tuple[float, int, int], drawn: list[np.ndarray]) -> np.ndarray:
    """Blur an image, replace each pixel by a nearby one, and blur the result again.

    LIBERO-Plus intends to exchange the two pixels. Because of NumPy's views, however, only one of them changes and the
    other one keeps its color.
    """
    sigma, reach, _ = setting
    height, width = image.shape[:2]
    first = np.uint8(_gaussian(image / 255.0, sigma) * 255)
    rows = np.arange(height - reach, reach, -1)
    columns = np.arange(width - reach, reach, -1)
    at = (rows[:, None] * width + columns[None, :]).ravel()
    shown = list(range(height * width))
    targets = at.tolist()
    for shift in drawn:
        sources = (at + shift[:, 1] * width + shift[:, 0]).tolist()
        for target, source in zip(targets, sources, strict=True):
            shown[target] = shown[source]
    moved = first.reshape(-1, 3)[shown].reshape(image.shape)
    return _bytes(_gaussian(moved / 255.0, sigma))
