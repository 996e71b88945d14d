"""Differences between rates with intervals, for example between a novel condition and the mean of seen conditions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.errors import InvalidInputError
from betterbench.statistics.interval import DEFAULT_CONFIDENCE, Interval, check_fraction, wilson_interval
from betterbench.statistics.paired import PairedTable
from betterbench.statistics.rate import Rate

POINTS = 100.0
"""Number of percentage points in a difference of 1."""


@dataclass(frozen=True, slots=True)
class Difference:
    """Difference between rates, with its interval.

    Attributes:
        value: First rate minus second rate, as a fraction. None if one of the rates has no trials.
        low: Lower end of the interval.
        high: Upper end of the interval.
        method: Name of the method that was used to compute the interval.
    """

    value: float | None
    low: float
    high: float
    method: str
    confidence: float = DEFAULT_CONFIDENCE

    @property
    def value_pp(self) -> float | None:
        """Difference in percentage points, or None if there is no difference."""
        return None if self.value is None else self.value * POINTS

    @property
    def low_pp(self) -> float:
        """Lower end of the interval in percentage points."""
        return self.low * POINTS

    @property
    def high_pp(self) -> float:
        """Upper end of the interval in percentage points."""
        return self.high * POINTS

    @property
    def excludes_zero(self) -> bool:
        """Whether the interval does not contain zero, so that "no difference" is excluded."""
        return self.low > 0.0 or self.high < 0.0

    def to_json(self) -> dict[str, Any]:
        """Return the difference in JSON form. The value and the ends of the interval are fractions."""
        return asdict(self)


def newcombe_difference(first: Rate, second: Rate, *, confidence: float = DEFAULT_CONFIDENCE) -> Difference:
    """Return the difference between two independent rates with Newcombe's interval.

    This is the hybrid score interval (method 10 of Newcombe, Statistics in Medicine 17, 1998, 873-890). It adds the
    distances from each rate to the ends of its Wilson interval in quadrature.

    Returns:
        ``first - second``. If one of the rates has no trials, the value is None and the interval is [-1, 1].
    """
    return _contrast(((1.0, first), (-1.0, second)), confidence, "newcombe")


def delta_success_rate(novel: Rate, seen: Sequence[Rate], *, confidence: float = DEFAULT_CONFIDENCE) -> Difference:
    """Return the success rate of a novel composition minus the mean success rate of seen compositions.

    The seen conditions have equal weights, however many trials they have. The interval adds the distances to the ends
    of the Wilson intervals in quadrature, with the weights of the contrast (Zou and Donner, Statistics in Medicine 27,
    2008, 1693-1702). With one seen condition, it is Newcombe's interval.

    Returns:
        The difference (:attr:`Difference.value_pp` gives it in percentage points). If a condition has no trials, the
        value is None and the interval is [-1, 1].
    """
    if not seen:
        raise InvalidInputError(
            "seen", "expected the rate of at least one seen composition, got none", "Pass at least one success rate"
        )
    weight = -1.0 / len(seen)
    return _contrast(((1.0, novel), *((weight, rate) for rate in seen)), confidence, "wilson in quadrature")


def mean_of_rates(rates: Sequence[Rate], *, confidence: float = DEFAULT_CONFIDENCE) -> Difference:
    """Return the unweighted mean of independent rates, which is the usual average over the suites of a benchmark.

    The interval adds the distances to the ends of the Wilson intervals in quadrature, as in :func:`delta_success_rate`.

    Returns:
        The mean. If a rate has no trials, the value is None and the interval is [-1, 1].
    """
    if not rates:
        raise InvalidInputError("rates", "the list is empty", "Pass at least one success rate")
    return _contrast([(1.0 / len(rates), rate) for rate in rates], confidence, "wilson in quadrature")


def newcombe_paired_difference(table: PairedTable, *, confidence: float = DEFAULT_CONFIDENCE) -> Difference:
    """Return the difference between two rates measured on the same trials, with Newcombe's interval for pairs.

    This is method 10 of Newcombe, Statistics in Medicine 17, 1998, 2635-2650. It adds the distances to the ends of the
    two Wilson intervals in quadrature, and reduces the sum according to the correlation of the pairs. Unlike the
    bootstrap interval, it has a positive width even if all pairs agree or all pairs differ in the same direction.

    Returns:
        ``first - second``. If there are no pairs, the value is None and the interval is [-1, 1].
    """
    method = "newcombe paired"
    check_fraction("confidence", confidence)
    n = table.n
    if n == 0:
        return Difference(None, -1.0, 1.0, method, confidence)
    a, b, c, d = table.both, table.only_first, table.only_second, table.neither
    p1, p2 = (a + b) / n, (a + c) / n
    l1, u1 = wilson_interval(a + b, n, confidence=confidence)
    l2, u2 = wilson_interval(a + c, n, confidence=confidence)
    product = float((a + b) * (c + d) * (a + c) * (b + d))
    association = float(a * d - b * c)
    if association > 0.0:  # Newcombe's continuity correction of a positive correlation
        association = max(0.0, association - n / 2.0)
    phi = association / math.sqrt(product) if product else 0.0
    down = _correlated_length(p1 - l1, u2 - p2, phi)
    up = _correlated_length(u1 - p1, p2 - l2, phi)
    value = (b - c) / n
    return Difference(value, max(-1.0, value - down), min(1.0, value + up), method, confidence)


def _correlated_length(x: float, y: float, phi: float) -> float:
    """Return the length of the difference between two deviations with the correlation ``phi`` (law of cosines)."""
    return math.sqrt(max(0.0, x * x - 2.0 * phi * x * y + y * y))


def _contrast(terms: Sequence[tuple[float, Rate]], confidence: float, method: str) -> Difference:
    """Return a weighted sum of independent rates. Its interval adds their Wilson intervals in quadrature."""
    check_fraction("confidence", confidence)
    value = down = up = 0.0
    for weight, rate in terms:
        p = rate.value
        if p is None:
            return Difference(None, -1.0, 1.0, method, confidence)
        ends = wilson_interval(rate.k, rate.n, confidence=confidence)
        ends = ends if weight > 0.0 else Interval(ends.high, ends.low)
        value += weight * p
        down += (weight * (p - ends.low)) ** 2
        up += (weight * (ends.high - p)) ** 2
    low, high = value - math.sqrt(down), value + math.sqrt(up)
    return Difference(value, max(-1.0, low), min(1.0, high), method, confidence)
