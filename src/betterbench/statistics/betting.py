"""Tests and intervals for the mean of bounded values, based on betting. They are valid at any stopping time.

A bet against "the mean is at most m" starts with a wealth of 1. For every value ``x``, the wealth is multiplied by ``1
+ c (x - m) / (m - low)``. The stake ``c`` is between 0 and 1, so the wealth never becomes negative. If the mean is at
most m, the expected wealth does not grow. By Ville's inequality, the probability that the wealth ever reaches ``1 /
alpha`` is then at most ``alpha``. The evidence is the mean wealth over many stakes. The interval contains every mean
that the evidence does not refute (Waudby-Smith and Ramdas, Journal of the Royal Statistical Society B 86, 2024, 1-27).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from functools import cache, lru_cache

import numpy as np
import numpy.typing as npt

from betterbench.errors import InvalidInputError
from betterbench.statistics import special
from betterbench.statistics.interval import DEFAULT_CONFIDENCE, Interval, check_fraction
from betterbench.statistics.sequential import PRIOR_COUNT

_STAKES = 200
_LARGEST_STAKE = 1.0 - 1e-9
_HALVINGS = 40

Span = tuple[float, float]
"""Smallest and largest possible value."""

UNIT: Span = (0.0, 1.0)
SIGNED: Span = (-1.0, 1.0)


def evidence_above(values: Iterable[float], mean: float, *, span: Span = UNIT) -> float:
    """Return the evidence (e-value) that the mean of bounded values is greater than ``mean``."""
    return _wealth(_counted(values, mean, span), lambda x: (x - mean) / (mean - span[0]))


def evidence_below(values: Iterable[float], mean: float, *, span: Span = UNIT) -> float:
    """Return the evidence (e-value) that the mean of bounded values is less than ``mean``."""
    return _wealth(_counted(values, mean, span), lambda x: (mean - x) / (span[1] - mean))


def anytime_interval(values: Iterable[float], *, span: Span = UNIT, confidence: float = DEFAULT_CONFIDENCE) -> Interval:
    """Return a confidence interval of the mean that is valid at any stopping time.

    Args:
        values: Observed values, each within the span. Their order does not matter.
        span: Smallest and largest possible value. If there are no values, the interval is the span.
        confidence: Two-sided confidence level.
    """
    check_fraction("confidence", confidence)
    return _interval(tuple(sorted(values)), span, confidence)


@lru_cache(maxsize=4096)
def _interval(seen: tuple[float, ...], span: Span, confidence: float) -> Interval:
    if not seen:
        return Interval(*span)
    bound = 2.0 / (1.0 - confidence)
    mean = min(max(math.fsum(seen) / len(seen), span[0]), span[1])

    def end(evidence: Callable[..., float], outer: float) -> float:
        inner = mean
        if inner == outer:
            return outer
        for _ in range(_HALVINGS):
            middle = (inner + outer) / 2.0
            if evidence(seen, middle, span=span) >= bound:
                outer = middle
            else:
                inner = middle
        return outer

    return Interval(end(evidence_above, span[0]), end(evidence_below, span[1]))


def _counted(values: Iterable[float], mean: float, span: Span) -> Counter[float]:
    """Count the occurrences of each value. Raises InvalidInputError if a value or the mean is outside the span."""
    counts = Counter(values)
    outside = [value for value in counts if not span[0] <= value <= span[1]]
    if outside:
        problem = f"{outside[0]!r} is not between {span[0]:g} and {span[1]:g}"
        raise InvalidInputError("values", problem, "Use only values within the span")
    if not span[0] < mean < span[1]:
        problem = f"{mean!r} is not strictly between {span[0]:g} and {span[1]:g}"
        raise InvalidInputError("mean", problem, "Use a mean inside the span")
    return counts


def _wealth(counts: Counter[float], gain: Callable[[float], float]) -> float:
    """Return the mean wealth over all stakes. ``gain`` returns the gain or loss per unit of stake at a value."""
    logs = np.zeros(_STAKES)
    for value, count in sorted(counts.items()):
        logs += count * np.log1p(_stakes() * gain(value))
    return float(np.exp(np.minimum(logs, 700.0)).mean())


@cache
def _stakes() -> npt.NDArray[np.float64]:
    """Return the stakes from 0 to 1.

    A stake ``c`` stands for the success probability ``(1 + c) / 2``. The stakes are quantiles of Turner and Grünwald's
    prior for this probability, in its half above 1/2.
    """
    shares = 0.5 + (np.arange(_STAKES) + 0.5) / (2.0 * _STAKES)
    stakes = 2.0 * special.betaincinv(PRIOR_COUNT, PRIOR_COUNT, shares) - 1.0
    return np.minimum(np.asarray(stakes, dtype=np.float64), _LARGEST_STAKE)
