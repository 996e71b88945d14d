"""Text for the results of statistical tests: rates, p-values and intervals."""

from __future__ import annotations

from betterbench.statistics import Rate, round_half_up
from betterbench.statistics.wording import p_text
from betterbench_calibration.audit.finding import ClaimSupport

ALPHA = 0.05
"""Significance level: a claim is supported if its corrected p-value is below this level."""

POINTS = 100.0
"""Factor that converts a fraction to percent."""


def shown_rate(rate: Rate) -> str:
    """Return a rate in percent with at most two decimals."""
    return f"{round_half_up(POINTS * (rate.value or 0.0), 2).normalize():f}"


def ends(support: ClaimSupport) -> str:
    """Return the ends of an interval as text with one decimal."""
    return f"{round_half_up(support.low_pp, 1)} to {round_half_up(support.high_pp, 1)}"


def tested(p: float, corrected: float, family: int) -> str:
    """Return a p-value as text, with the corrected p-value if ``family`` (the number of tests) is above 1."""
    return p_text(p) + (f", {p_text(corrected)} after Holm's correction for {family}" if family > 1 else "")
