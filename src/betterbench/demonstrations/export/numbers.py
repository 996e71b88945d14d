"""Column statistics as LeRobot stores them, per episode and over all episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
"""Names and levels of the quantiles that LeRobot 0.4 and later versions store."""

MOST_SAMPLED = 32
"""Maximum number of images per episode from which image statistics are computed. The images are evenly spaced."""

_LEVELS = 256

Stats = dict[str, Any]
"""Value of each statistic, by name. ``count`` is the number of frames."""


def vector_stats(values: np.ndarray) -> Stats:
    """Return the statistics of a column (N, size): minimum, maximum, mean, population standard deviation and quantiles.

    They are computed in float64. Quantiles are interpolated linearly.
    """
    numbers = np.asarray(values, dtype=np.float64).reshape(len(values), -1)
    found: Stats = {
        "min": numbers.min(axis=0).tolist(),
        "max": numbers.max(axis=0).tolist(),
        "mean": numbers.mean(axis=0).tolist(),
        "std": numbers.std(axis=0).tolist(),
        "count": [len(numbers)],
    }
    levels = np.quantile(numbers, list(QUANTILES.values()), axis=0)
    return found | {name: level.tolist() for name, level in zip(QUANTILES, levels, strict=True)}


def sampled_rows(rows: int) -> set[int]:
    """Return the rows of an episode that are used for the image statistics."""
    return {round(row) for row in np.linspace(0, rows - 1, min(rows, MOST_SAMPLED))}


def color_counts(picture: np.ndarray) -> np.ndarray:
    """Return the histogram of each color channel in an image, as a (3, 256) int64 array."""
    return np.stack([np.bincount(picture[:, :, c].reshape(-1), minlength=_LEVELS) for c in range(3)])


def image_stats(levels: np.ndarray, pictures: int) -> Stats:
    """Return image statistics in [0, 1], each of shape (3, 1, 1), from histograms of the color channels.

    Args:
        levels: (3, 256) histogram of each color channel over all images.
        pictures: Number of images.
    """
    counts = np.asarray(levels, dtype=np.float64)
    values = np.arange(_LEVELS) / (_LEVELS - 1)
    total = counts.sum(axis=1)
    mean = counts @ values / total
    std = np.sqrt(np.maximum(counts @ values**2 / total - mean**2, 0.0))
    share = np.cumsum(counts, axis=1) / total[:, None]
    there = counts > 0
    found: dict[str, np.ndarray] = {
        "min": values[there.argmax(axis=1)],
        "max": values[_LEVELS - 1 - there[:, ::-1].argmax(axis=1)],
        "mean": mean,
        "std": std,
    }
    found |= {name: values[(share >= level).argmax(axis=1)] for name, level in QUANTILES.items()}
    return {name: [[[v]] for v in value.tolist()] for name, value in found.items()} | {"count": [pictures]}


def without_quantiles(stats: Mapping[str, Stats], *, kept: Sequence[str] = ()) -> dict[str, Stats]:
    """Remove quantiles from the statistics, except those in ``kept``. Version 2.1 of the format has no quantiles."""
    return {
        column: {name: value for name, value in found.items() if name not in QUANTILES or name in kept}
        for column, found in stats.items()
    }
