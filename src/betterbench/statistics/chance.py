"""Test of a rate against guessing."""

from __future__ import annotations

from betterbench.statistics.interval import check_fraction
from betterbench.statistics.rate import Rate
from betterbench.statistics.unpaired import binomial_probabilities

_TIE = 1e-7
"""Relative difference below which two outcomes are equally likely."""


def chance_p(rate: Rate, *, chance: float) -> float:
    """Return the two-sided p-value of the exact binomial test against a chance level.

    The p-value is the probability, under the chance level, of all outcomes that are not more likely than the observed
    outcome.

    Args:
        rate: The measured rate.
        chance: Rate of guessing, strictly between 0 and 1 (0.5 for a choice between two).

    Returns:
        The p-value, 1.0 without trials.
    """
    check_fraction("chance", chance)
    likely = binomial_probabilities(rate.n, chance)
    return min(1.0, float(likely[likely <= likely[rate.k] * (1.0 + _TIE)].sum()))
