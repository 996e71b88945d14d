"""Confidence intervals for a single binomial rate."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from betterbench.errors import InvalidInputError
from betterbench.statistics import special

IntervalMethod = Literal["wilson", "clopper_pearson"]
"""Name of the method for the interval of a rate."""

DEFAULT_CONFIDENCE = 0.95
"""Two-sided confidence level that all intervals have by default."""


class Interval(NamedTuple):
    """Closed interval of rates, or of differences between rates."""

    low: float
    high: float


def wilson_interval(k: int, n: int, *, confidence: float = DEFAULT_CONFIDENCE) -> Interval:
    """Return the score interval of Wilson (1927), without continuity correction.

    It contains all rates ``p`` with ``|k/n - p| <= z sqrt(p (1 - p) / n)``. Averaged over ``p``, its coverage is close
    to the confidence level even for few trials. For single values of ``p``, it may be lower.

    Returns:
        The interval, which is inside [0, 1].
    """
    check_counts(k, n)
    z = normal_quantile(confidence)
    if n == 0:
        return Interval(0.0, 1.0)
    p = k / n
    center = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low = 0.0 if k == 0 else max(0.0, center - half)
    high = 1.0 if k == n else min(1.0, center + half)
    return Interval(low, high)


def clopper_pearson_interval(k: int, n: int, *, confidence: float = DEFAULT_CONFIDENCE) -> Interval:
    """Return the exact interval of Clopper and Pearson (1934).

    It contains all rates that neither of the one-sided exact binomial tests rejects at the level ``(1 - confidence) /
    2``. Its coverage is at least the confidence level for every true rate, so it is wider than Wilson's interval.
    """
    check_counts(k, n)
    check_fraction("confidence", confidence)
    if n == 0:
        return Interval(0.0, 1.0)
    tail = (1.0 - confidence) / 2.0
    low = 0.0 if k == 0 else float(special.betaincinv(k, n - k + 1, tail))
    high = 1.0 if k == n else float(special.betaincinv(k + 1, n - k, 1.0 - tail))
    return Interval(low, high)


def normal_quantile(confidence: float) -> float:
    """Return z such that a standard normal variable lies in [-z, z] with the given probability."""
    check_fraction("confidence", confidence)
    return float(special.ndtri(0.5 + confidence / 2.0))


def check_counts(k: int, n: int, *, where: str = "rate") -> None:
    """Raise InvalidInputError if the numbers of successes and trials are impossible."""
    if n < 0 or k < 0 or k > n:
        raise InvalidInputError(where, f"{k} successes in {n} trials are impossible", "Use counts with 0 <= k <= n")


def check_fraction(where: str, value: float) -> None:
    """Raise InvalidInputError if a level or probability is not strictly between 0 and 1."""
    if not 0.0 < value < 1.0:
        raise InvalidInputError(where, f"{value!r} is not strictly between 0 and 1", "Use a fraction such as 0.95")
