"""Ranking quality: area under the ROC curve of a score, and rank correlation of two quantities."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import permutations
from typing import Any

import numpy as np
import numpy.typing as npt

from betterbench.errors import InvalidInputError
from betterbench.statistics.bisection import last_held
from betterbench.statistics.interval import DEFAULT_CONFIDENCE, normal_quantile


@dataclass(frozen=True, slots=True)
class RankingArea:
    """Probability that a positive case has a higher score than a negative case (area under the ROC curve).

    Attributes:
        value: The area, which is 0.5 for a score without information. None if all cases are positive or all are
            negative.
        low: Lower end of the interval, in [0, 1].
        high: Upper end of the interval, in [0, 1].
        positives: Number of positive cases.
        negatives: Number of negative cases.
    """

    value: float | None
    low: float
    high: float
    positives: int
    negatives: int


def ranking_area(
    scores: Sequence[float], happened: Sequence[bool], *, confidence: float = DEFAULT_CONFIDENCE
) -> RankingArea:
    """Return the area under the receiver operating characteristic (AUROC). Ties count half.

    The interval is Newcombe's score interval (Statistics in Medicine 25, 2006, 559-573, method 5). It contains each
    area that differs from the estimate by at most the normal quantile times the standard error. The standard error is
    Hanley and McNeil's, computed for that area. The width of the interval is positive even if the ranking is perfect,
    and large if there are few positive or few negative cases.
    """
    if len(scores) != len(happened):
        problem = f"{len(scores)} scores for {len(happened)} outcomes"
        raise InvalidInputError("scores, happened", problem, "Pass one score and one outcome per case")
    quantile = normal_quantile(confidence)
    values, truth = np.asarray(scores, dtype=np.float64), np.asarray(happened, dtype=bool)
    yes, no = values[truth], values[~truth]
    if not len(yes) or not len(no):
        return RankingArea(None, 0.0, 1.0, len(yes), len(no))
    apart = yes[:, None] - no[None, :]
    area = float((apart > 0.0).mean() + 0.5 * (apart == 0.0).mean())
    low, high = (_end(area, end, quantile, len(yes), len(no)) for end in (0.0, 1.0))
    return RankingArea(area, low, high, len(yes), len(no))


def _end(area: float, end: float, quantile: float, m: int, n: int) -> float:
    """Return an end of the confidence interval: the lower end if ``end`` is 0, the upper end if ``end`` is 1."""
    more = 0.5 * (m + n) - 1.0

    def near(other: float) -> bool:
        spread = other * (1.0 - other) * (1.0 + more * ((1.0 - other) / (2.0 - other) + other / (1.0 + other)))
        return abs(area - other) <= quantile * math.sqrt(spread / (m * n))

    return last_held(near, area, end)


EXACT_RANKS_UP_TO = 8
"""Maximum number of cases for which all orders are enumerated."""
_DRAWN_ORDERS = 99_999
_RESAMPLES = 10_000
_MOST_COMPARED = 1 << 20
"""Maximum number of pairs of values that are compared at once. It limits the memory."""
_SLACK = 1e-9


@dataclass(frozen=True, slots=True)
class RankCorrelation:
    """Spearman's rank correlation between two quantities over the same cases.

    Attributes:
        value: The correlation, between -1 and 1. None if one of the quantities is constant.
        low: Lower end of the interval.
        high: Upper end of the interval.
        p: Two-sided p-value of the permutation test, or 1.0 if there is no correlation value.
        n: Number of cases.
    """

    value: float | None
    low: float
    high: float
    p: float
    n: int

    def to_json(self) -> dict[str, Any]:
        """Return the correlation in JSON form."""
        return asdict(self)


def rank_correlation(
    first: Sequence[float],
    second: Sequence[float],
    *,
    generator: np.random.Generator,
    confidence: float = DEFAULT_CONFIDENCE,
) -> RankCorrelation:
    """Return Spearman's rank correlation with a permutation test. Equal values share their mean rank.

    The test compares the observed correlation with the correlations for all orders of the second quantity. It is exact
    for up to :data:`EXACT_RANKS_UP_TO` cases and uses random orders for more. The smallest possible p-value of n cases
    without ties is 2 / n!, which is 0.083 for four and 0.017 for five cases.

    The interval is the wider one of two: the percentile bootstrap over cases, and Fisher's transformation with the
    variance of Bonett and Wright (Psychometrika 65, 2000, 23-28). Before Fisher's transformation, the correlation is
    limited to that of a ranking with two exchanged neighbors, so that the interval of a perfect ranking has a positive
    width. With three or fewer cases, the interval is [-1, 1].

    Args:
        first: Values of the first quantity (n,).
        second: Values of the second quantity (n,).
        generator: Source of randomness.
        confidence: Two-sided confidence level.

    Raises:
        InvalidInputError: If the lengths differ or a value is not finite.
    """
    if len(first) != len(second):
        problem = f"{len(first)} values and {len(second)} values cannot be paired"
        raise InvalidInputError("first, second", problem, "Pass one value of each quantity per case")
    x, y = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise InvalidInputError("first, second", "a value is not finite", "Use only finite numbers")
    quantile, n = normal_quantile(confidence), len(x)
    value = _spearman(x, y)
    if value is None:
        return RankCorrelation(None, -1.0, 1.0, 1.0, n)
    low, high = -1.0, 1.0
    if n > 3:
        ends = _transformed(value, n, quantile), _resampled(x, y, generator, confidence)
        low, high = min(value, *(end[0] for end in ends)), max(value, *(end[1] for end in ends))
    return RankCorrelation(value, low, high, _order_p(x, y, value, generator), n)


def _spearman(x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> float | None:
    a, b = _centered_ranks(x), _centered_ranks(y)
    size = math.sqrt(float(a @ a) * float(b @ b))
    return None if size == 0.0 else max(-1.0, min(1.0, float(a @ b) / size))


def _centered_ranks(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the ranks of the values minus the mean rank. Equal values share their mean rank."""
    below = (values[..., None, :] < values[..., :, None]).sum(axis=-1)
    equal = (values[..., None, :] == values[..., :, None]).sum(axis=-1)
    ranks: npt.NDArray[np.float64] = below + 0.5 * (equal - 1) - 0.5 * (values.shape[-1] - 1)
    return ranks


def _order_p(
    x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], value: float, generator: np.random.Generator
) -> float:
    a, b, n = _centered_ranks(x), _centered_ranks(y), len(x)
    least = abs(value) * math.sqrt(float(a @ a) * float(b @ b)) - _SLACK
    if n <= EXACT_RANKS_UP_TO:
        orders = np.array(list(permutations(range(n))))
        return float((np.abs(b[orders] @ a) >= least).mean())
    drawn = sum(abs(float(b[generator.permutation(n)] @ a)) >= least for _ in range(_DRAWN_ORDERS))
    return (1 + drawn) / (1 + _DRAWN_ORDERS)


def _transformed(value: float, n: int, quantile: float) -> tuple[float, float]:
    """Return the interval that results from Fisher's transformation."""
    largest = 1.0 - 12.0 / (n * (n * n - 1.0))  # correlation of a ranking in which two neighbors are exchanged
    inner = max(-largest, min(largest, value))
    half = quantile * math.sqrt((1.0 + inner * inner / 2.0) / (n - 3.0))
    return math.tanh(math.atanh(inner) - half), math.tanh(math.atanh(inner) + half)


def _resampled(
    x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], generator: np.random.Generator, confidence: float
) -> tuple[float, float]:
    """Return the percentile bootstrap interval. Resamples in which a quantity is constant are left out."""
    drawn = generator.integers(0, len(x), size=(_RESAMPLES, len(x)))
    found: list[float] = []
    for rows in np.array_split(drawn, math.ceil(_RESAMPLES * len(x) ** 2 / _MOST_COMPARED)):
        # Ranks are multiples of 0.5, so sums are exact in any order and equal those of :func:`_spearman`.
        a, b = _centered_ranks(x[rows]), _centered_ranks(y[rows])
        size = np.sqrt((a * a).sum(axis=-1) * (b * b).sum(axis=-1))
        vary = size > 0.0
        found += np.clip((a * b).sum(axis=-1)[vary] / size[vary], -1.0, 1.0).tolist()
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(found, (tail, 1.0 - tail)) if found else (-1.0, 1.0)
    return float(low), float(high)
