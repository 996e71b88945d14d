"""Whether a rate differs from guessing."""

from __future__ import annotations

from betterbench.statistics.interval import check_fraction
from betterbench.statistics.rate import Rate


def chance_p(rate: Rate, *, chance: float) -> float:
    """Return the two-sided p-value of the exact binomial test against a chance level.

    The p-value is the probability, under the chance level, of all outcomes that are no more likely than the one seen.

    Args:
        rate: The measured rate.
        chance: Rate of guessing, strictly between 0 and 1 (0.5 for a choice of two).

    Returns:
        The p-value, 1.0 without trials.
    """
    from scipy import stats  # noqa: PLC0415 - takes 0.5 s, which the workers of a run do not need

    check_fraction("chance", chance)
    return float(stats.binomtest(rate.k, rate.n, chance).pvalue) if rate.n else 1.0
