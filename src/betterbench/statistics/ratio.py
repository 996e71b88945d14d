"""Ratio and difference of two independent differences, for example to compute how much of a gap remains."""

from __future__ import annotations

import math

from betterbench.statistics.bisection import last_held
from betterbench.statistics.difference import Difference

_FARTHEST = 1e6


def ratio_of(first: Difference, second: Difference) -> Difference | None:
    """Return ``first / second`` for two independent differences.

    The result is None unless the whole interval of the second difference is above zero.

    The interval contains each ratio ``r`` for which the interval of ``first - r * second`` contains zero. That interval
    adds the distances to the ends of both intervals in quadrature, as in Donner and Zou (Statistical Methods in Medical
    Research 21, 2012, 347-359).
    """
    if first.value is None or second.value is None or second.low <= 0.0:
        return None
    a, b = first.value, second.value
    ratio = a / b

    def held_above(r: float) -> bool:
        up = b - second.low if r > 0.0 else second.high - b
        return a - r * b + math.hypot(first.high - a, r * up) >= 0.0

    def held_below(r: float) -> bool:
        down = second.high - b if r > 0.0 else b - second.low
        return a - r * b - math.hypot(a - first.low, r * down) <= 0.0

    low, high = last_held(held_below, ratio, -_FARTHEST), last_held(held_above, ratio, _FARTHEST)
    return Difference(ratio, low, high, "ratio, wilson in quadrature", first.confidence)


def difference_of(first: Difference, second: Difference) -> Difference:
    """Return ``first - second`` for two independent differences. Their intervals are added in quadrature.

    Returns:
        The difference, in [-2, 2]. If one of the two has no value, the result has the value None and the interval [-2,
        2].
    """
    method = "wilson in quadrature"
    if first.value is None or second.value is None:
        return Difference(None, -2.0, 2.0, method, first.confidence)
    value = first.value - second.value
    down = math.hypot(first.value - first.low, second.high - second.value)
    up = math.hypot(first.high - first.value, second.value - second.low)
    return Difference(value, max(-2.0, value - down), min(2.0, value + up), method, first.confidence)
