"""Statistical power of a number of trials, and the smallest difference that this number can detect.

The smallest detectable difference is the smallest true difference that the two-sided test at level ``alpha`` detects
with a probability of at least ``power``. It is computed in steps of 0.1 percentage points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.statistics import special
from betterbench.statistics.interval import check_fraction
from betterbench.statistics.unpaired import barnard_p_values, binomial_probabilities

DEFAULT_ALPHA = 0.05
"""Two-sided level of the test."""

DEFAULT_POWER = 0.8
"""Required probability of detecting a true difference. 80 % is the usual value for planning."""

EXACT_ARM_LIMIT = 300
"""Maximum number of trials per arm for which the power is summed over all outcomes of Barnard's test (0.2 s and 0.7
MB). For more trials, the normal approximation is used. At the limit, the two methods give the same smallest difference
to 0.1 points.
"""

_NEGLIGIBLE = 1e-20
"""Probability below which a number of discordant pairs is left out of a sum (which has up to 1e8 terms)."""

_STEPS = 1000
"""Number of steps of 0.1 percentage points in the search for the smallest difference."""


@dataclass(frozen=True, slots=True)
class DetectableDifference:
    """Smallest true difference that a number of trials can detect.

    Attributes:
        value: The difference as a fraction, or None if even the largest possible difference is not detected.
        n: Number of trials or pairs.
        alpha: Two-sided level of the test.
        power: Required probability of detecting the difference.
        assumption: Test and assumption on which the value is based, as a phrase for a caption.
    """

    value: float | None
    n: int
    alpha: float
    power: float
    assumption: str


def paired_power(n: int, difference: float, *, opposite: float = 0.0, alpha: float = DEFAULT_ALPHA) -> float:
    """Return the power of the exact McNemar test.

    Args:
        n: Number of pairs.
        difference: True difference between the two rates, from 0 to 1.
        opposite: True fraction of pairs that differ in the opposite direction. ``difference + 2 opposite`` is at most
            1.
        alpha: Two-sided level of the test.

    Returns:
        The probability of a p-value of at most ``alpha``. Outcomes with a total probability below 1e-12 are left out of
        the sum.
    """
    _check_plan(n, alpha)
    discordant_share = difference + 2.0 * opposite
    if difference < 0.0 or opposite < 0.0 or discordant_share > 1.0 + 1e-12:
        problem = f"a difference of {difference:g} with {opposite:g} in the opposite direction is impossible"
        raise InvalidInputError("difference, opposite", problem, "Choose both ≥ 0, with difference + 2 opposite ≤ 1")
    if discordant_share == 0.0:
        return 0.0
    mass = binomial_probabilities(n, min(1.0, discordant_share))
    m = np.flatnonzero(mass > _NEGLIGIBLE)
    m = m[m > 0]
    # For m discordant pairs, find the largest value of the smaller count that is still significant, or -1 if there is
    # none. The rounded inverse of the distribution function is either exact, or too high by one or two.
    critical = np.floor(special.bdtrik(alpha / 2.0, m, 0.5)) + 1.0
    for _ in range(2):
        critical = np.where(2.0 * special.bdtr(critical, m, 0.5) <= alpha, critical, critical - 1.0)
    share = (difference + opposite) / discordant_share
    found = special.bdtr(critical, m, share) + special.bdtrc(m - critical - 1.0, m, share)
    found = np.where(critical >= 0, found, 0.0)
    return min(1.0, float(mass[m] @ found))


def unpaired_power(n: int, first: float, second: float, *, alpha: float = DEFAULT_ALPHA) -> float:
    """Return the power of Barnard's test for two independent arms of equal size.

    Up to :data:`EXACT_ARM_LIMIT` trials per arm, the power is summed over all outcomes. For more trials, the normal
    approximation to the pooled score test is used.
    """
    _check_plan(n, alpha)
    for where, rate in (("first", first), ("second", second)):
        if not 0.0 <= rate <= 1.0:
            raise InvalidInputError(where, f"{rate!r} is not a rate", "Use a fraction from 0 to 1")
    if n > EXACT_ARM_LIMIT:
        return _normal_power(n, first, second, alpha)
    rejected = _p_value_bytes(n)
    p_values = np.frombuffer(rejected, dtype=np.float64).reshape(n + 1, n + 1)
    arms = binomial_probabilities(n, first), binomial_probabilities(n, second)
    return min(1.0, float(arms[0] @ (p_values <= alpha) @ arms[1]))


def smallest_paired_difference(
    n: int, *, opposite: float = 0.0, alpha: float = DEFAULT_ALPHA, power: float = DEFAULT_POWER
) -> DetectableDifference:
    """Return the smallest difference that ``n`` pairs can detect with the exact McNemar test.

    ``opposite`` is the true fraction of pairs that differ in the opposite direction. If it is 0, all discordant pairs
    favor the same member. This is the most favorable case, so ``n`` pairs cannot detect a smaller difference.
    """
    _check_plan(n, alpha)
    check_fraction("power", power)
    if not 0.0 <= opposite < 0.5:
        raise InvalidInputError("opposite", f"{opposite!r} is out of range", "Use a fraction from 0 to less than 0.5")
    value = _smallest(lambda d: paired_power(n, d, opposite=opposite, alpha=alpha), 1.0 - 2.0 * opposite, power)
    other = f"if {100 * opposite:.0f} % of the pairs differ" if opposite else "if no pair differs"
    assumption = f"exact McNemar test, {other} the other way"
    return DetectableDifference(value, n, alpha, power, assumption)


def smallest_unpaired_difference(
    n: int, *, reference: float = 0.5, alpha: float = DEFAULT_ALPHA, power: float = DEFAULT_POWER
) -> DetectableDifference:
    """Return the smallest difference that two independent arms of ``n`` trials each can detect with Barnard's test.

    One arm has the rate ``reference``. The rate of the other arm is below it, or above it if the reference is below
    1/2.
    """
    _check_plan(n, alpha)
    check_fraction("power", power)
    if not 0.0 <= reference <= 1.0:
        raise InvalidInputError("reference", f"{reference!r} is not a rate", "Use a fraction from 0 to 1")
    sign = -1.0 if reference >= 0.5 else 1.0
    room = max(reference, 1.0 - reference)
    value = _smallest(
        lambda d: unpaired_power(n, reference, min(1.0, max(0.0, reference + sign * d)), alpha=alpha), room, power
    )
    how = "exact" if n <= EXACT_ARM_LIMIT else "normal approximation"
    assumption = f"Barnard's test ({how}), {'down' if sign < 0 else 'up'} from a rate of {100 * reference:.0f} %"
    return DetectableDifference(value, n, alpha, power, assumption)


def _smallest(power_at: Callable[[float], float], room: float, power: float) -> float | None:
    """Return the smallest difference, up to ``room``, with sufficient power, or None if there is none.

    It is found by bisection, because the power grows with the difference.
    """
    low, high = 0, int(np.floor(room * _STEPS + 1e-9))
    if power_at(high / _STEPS) < power:
        return None
    while high - low > 1:
        middle = (low + high) // 2
        if power_at(middle / _STEPS) >= power:
            high = middle
        else:
            low = middle
    return high / _STEPS


def _normal_power(n: int, first: float, second: float, alpha: float) -> float:
    """Return the power of the pooled score test for two arms of ``n`` trials, by the normal approximation."""
    gap = abs(first - second)
    mean = (first + second) / 2.0
    null = float(np.sqrt(2.0 * mean * (1.0 - mean) / n))
    true = float(np.sqrt((first * (1.0 - first) + second * (1.0 - second)) / n))
    critical = float(special.ndtri(1.0 - alpha / 2.0)) * null
    if true == 0.0:
        return float(gap > critical)
    return float(special.ndtr((gap - critical) / true) + special.ndtr((-gap - critical) / true))


@lru_cache(maxsize=8)
def _p_value_bytes(n: int) -> bytes:
    """Return Barnard's p-values of all outcomes as immutable bytes. They do not depend on the true rates."""
    return barnard_p_values(n).tobytes()


def _check_plan(n: int, alpha: float) -> None:
    """Raise InvalidInputError if there are no trials or the level is out of range."""
    if n < 1:
        raise InvalidInputError("n", f"{n} trials cannot detect a difference", "Use at least one trial")
    check_fraction("alpha", alpha)
