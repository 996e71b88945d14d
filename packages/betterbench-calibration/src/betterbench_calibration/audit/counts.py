"""Computation of the counts (successes out of trials) that round to a printed percentage, with exact integers."""

from __future__ import annotations

from decimal import Decimal
from typing import NamedTuple

from betterbench.statistics import percent
from betterbench_calibration.audit.table import decimals

MOST_DROPPED = 12
"""Largest number of missing trials that is tried as an explanation of a percentage.

If more missing trials were tried, some count would fit almost any percentage. For example, 400 trials give one in 25
percentages with two decimals, so twelve sizes already fit about half of all misprints.
"""

MOST_MULTIPLES = 20
"""Largest multiple of the stated number of trials that is tried."""


class CountBehind(NamedTuple):
    """Count of ``k`` successes in ``n`` trials from which a percentage was computed."""

    k: int
    n: int

    def __str__(self) -> str:
        """Return the count as text, such as ``13/20``."""
        return f"{self.k}/{self.n}"


def count_behind(printed: Decimal, n: int) -> CountBehind | None:
    """Return the count out of ``n`` that rounds (half up) to a printed percentage, or None."""
    digits = decimals(printed)
    units = int(printed.scaleb(digits))
    whole = 100 * 10**digits
    # Rounding half up: the printed value is the floor of k * whole / n + 1/2, so only one k can fit unless n > whole.
    k = (units * n + whole // 2) // whole
    for candidate in (k, k - 1, k + 1):
        if 0 <= candidate <= n and (2 * candidate * whole + n) // (2 * n) == units:
            return CountBehind(candidate, n)
    return None


def nearest_count(printed: Decimal, n: int) -> CountBehind:
    """Return the count out of ``n`` whose percentage is nearest to a printed percentage."""
    return CountBehind(max(0, min(n, round(printed * n / 100))), n)


def with_percentage(count: CountBehind, digits: int) -> str:
    """Return a count with its percentage ("155/404 = 38.37")."""
    return f"{count} = {percent(count.k, count.n, digits=digits)}"


def with_dropped(printed: Decimal, n: int) -> CountBehind | None:
    """Return the count that rounds to a percentage with the fewest missing trials, or None."""
    for dropped in range(1, min(MOST_DROPPED, n - 1) + 1):
        count = count_behind(printed, n - dropped)
        if count is not None:
            return count
    return None


def all_with_dropped(printed: Decimal, n: int) -> tuple[CountBehind, ...]:
    """Return all counts that round to a printed percentage, with 1 to :data:`MOST_DROPPED` missing trials."""
    tried = (count_behind(printed, n - dropped) for dropped in range(1, min(MOST_DROPPED, n - 1) + 1))
    return tuple(count for count in tried if count is not None)


def smallest_multiple(printed: Decimal, n: int) -> int | None:
    """Return the smallest multiple of ``n`` trials with which a percentage is exact, or None if there is none."""
    for times in range(2, MOST_MULTIPLES + 1):
        if printed * n * times % 100 == 0:
            return n * times
    return None
