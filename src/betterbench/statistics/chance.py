"""Exact tests of whether a number of successes differs from the number expected from guessing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.statistics.interval import check_fraction
from betterbench.statistics.rate import Rate
from betterbench.statistics.unpaired import binomial_probabilities

_TIE = 1e-7
"""Relative difference below which two outcomes count as equally likely."""


def chance_p(rate: Rate, *, chance: float) -> float:
    """Return the two-sided p-value of the exact binomial test against a chance level.

    The p-value is the total probability, under the chance level, of all outcomes that are no more likely than the
    observed one.

    Args:
        rate: Measured rate.
        chance: Success rate of guessing, strictly between 0 and 1 (0.5 for a choice between two answers).

    Returns:
        The p-value, or 1.0 if there are no trials.
    """
    check_fraction("chance", chance)
    likely = binomial_probabilities(rate.n, chance)
    return min(1.0, float(likely[likely <= likely[rate.k] * (1.0 + _TIE)].sum()))


def guessing_p(right: int, chances: Sequence[float]) -> float:
    """Return the probability that guessing gives at least ``right`` correct answers (one-sided exact test).

    The number of correct guesses has a Poisson binomial distribution, because each answer has its own chance of being
    guessed. This distribution is computed exactly.

    Args:
        right: Number of correct answers.
        chances: Probability of guessing each answer (n,), between 0 and 1.

    Returns:
        The p-value, or 1.0 if there are no answers.

    Raises:
        InvalidInputError: If a chance is not a probability, or if there are more correct answers than answers.
    """
    if any(not 0.0 <= chance <= 1.0 for chance in chances):
        raise InvalidInputError("chances", "a chance is not between 0 and 1", "Use probabilities from 0 to 1")
    if not 0 <= right <= len(chances):
        raise InvalidInputError(
            "right",
            f"{right} right answers of {len(chances)} are impossible",
            "Use a number from 0 to the number of answers",
        )
    likely = np.ones(1)
    for chance in chances:
        likely = np.convolve(likely, (1.0 - chance, chance))
    return min(1.0, float(likely[right:].sum()))
