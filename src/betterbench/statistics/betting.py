"""Bets on a bounded mean: evidence and intervals that stay valid however often one looks, and whenever one stops.

A bet against "the mean is at most m" starts with 1 and is multiplied by ``1 + c (x - m) / (m - low)`` at every value
``x``. Its stake ``c`` lies between 0 and 1, so it never loses more than everything, and if the mean is at most m it is
expected not to grow. By Ville's inequality it then ever reaches ``1 / alpha`` with a probability of at most ``alpha``.
The evidence is the mean over many stakes, and an interval holds every mean that it does not refute (Waudby-Smith and
Ramdas, Journal of the Royal Statistical Society B 86, 2024, 1-27).
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
"""Smallest and largest value that can occur."""

UNIT: Span = (0.0, 1.0)
SIGNED: Span = (-1.0, 1.0)


def evidence_above(values: Iterable[float], mean: float, *, span: Span = UNIT) -> float:
    """Return the evidence that values within a span have a mean above the given one, against "at most that"."""
    return _wealth(_counted(values, mean, span), lambda x: (x - mean) / (mean - span[0]))


def evidence_below(values: Iterable[float], mean: float, *, span: Span = UNIT) -> float:
    """Return the evidence that values within a span have a mean below the given one, against "at least that"."""
    return _wealth(_counted(values, mean, span), lambda x: (mean - x) / (span[1] - mean))


def anytime_interval(values: Iterable[float], *, span: Span = UNIT, confidence: float = DEFAULT_CONFIDENCE) -> Interval:
    """Return an interval that holds the mean with the confidence level at any stopping time, for any reason to stop.

    Args:
        values: Observed values, each within the span; their order does not matter.
        span: Smallest and largest value that can occur. Without values, the interval is the span.
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
    """Return how often each value occurs; refuse values outside the span and a mean that is not inside it."""
    counts = Counter(values)
    outside = [value for value in counts if not span[0] <= value <= span[1]]
    if outside:
        problem = f"{outside[0]!r} does not lie between {span[0]:g} and {span[1]:g}"
        raise InvalidInputError("values", problem, "Give values within the span")
    if not span[0] < mean < span[1]:
        problem = f"{mean!r} is not strictly between {span[0]:g} and {span[1]:g}"
        raise InvalidInputError("mean", problem, "Give a mean inside the span")
    return counts


def _wealth(counts: Counter[float], gain: Callable[[float], float]) -> float:
    """Return the mean wealth over all stakes; ``gain`` is the win of a value per unit of stake."""
    logs = np.zeros(_STAKES)
    for value, count in sorted(counts.items()):
        logs += count * np.log1p(_stakes() * gain(value))
    return float(np.exp(np.minimum(logs, 700.0)).mean())


@cache
def _stakes() -> npt.NDArray[np.float64]:
    """Return the stakes: a coin's probabilities above one half under the prior of Turner and Grünwald, from 0 to 1."""
    shares = 0.5 + (np.arange(_STAKES) + 0.5) / (2.0 * _STAKES)
    stakes = 2.0 * special.betaincinv(PRIOR_COUNT, PRIOR_COUNT, shares) - 1.0
    return np.minimum(np.asarray(stakes, dtype=np.float64), _LARGEST_STAKE)
