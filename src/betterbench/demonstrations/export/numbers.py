"""Column statistics as in LeRobot data sets, per episode and over all episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
"""Names and levels of the quantiles stored by LeRobot 0.4 and later."""

MOST_SAMPLED = 32
"""Maximum number of evenly spaced images per episode used to compute image statistics."""

_LEVELS = 256

Stats = dict[str, Any]
"""Values by name of the statistic. ``count`` is the number of frames."""


def vector_stats(values: np.ndarray) -> Stats:
    """Return the statistics of a column, (N, size): mean, population standard deviation, quantiles and so on.

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
    """Return the rows of an episode whose images are used for the statistics."""
    return {round(row) for row in np.linspace(0, rows - 1, min(rows, MOST_SAMPLED))}


def color_counts(picture: np.ndarray) -> np.ndarray:
    """Return the histogram of each channel in an image: (3, 256) int64."""
    return np.stack([np.bincount(picture[:, :, c].reshape(-1), minlength=_LEVELS) for c in range(3)])


def image_stats(levels: np.ndarray, pictures: int) -> Stats:
    """Return image statistics from histograms of the levels, (3, 256), in [0, 1], each of shape (3, 1, 1)."""
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
    """Return statistics with fewer quantiles, as in version 2.1 of the format."""
    return {
        column: {name: value for name, value in found.items() if name not in QUANTILES or name in kept}
        for column, found in stats.items()
    }
