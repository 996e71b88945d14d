"""How tests are told: p-values, intervals and the level that counts as support."""

from __future__ import annotations

from betterbench.audit.finding import ClaimSupport
from betterbench.statistics import Rate, round_half_up

ALPHA = 0.05
"""Level below which a corrected p-value counts as support."""

POINTS = 100.0
"""Percentage points in one whole."""


def shown_rate(rate: Rate) -> str:
    """Return a rate in percent with two decimals at most."""
    return f"{round_half_up(POINTS * (rate.value or 0.0), 2).normalize():f}"


def ends(support: ClaimSupport) -> str:
    """Return the ends of an interval with one decimal."""
    return f"{round_half_up(support.low_pp, 1)} to {round_half_up(support.high_pp, 1)}"


def corrected_p(p: float, corrected: float, family: int) -> str:
    """Return a p-value, and its corrected form where there are several."""
    return f"p = {round_p(p)}" + (f", {round_p(corrected)} after Holm's correction for {family}" if family > 1 else "")


def round_p(p: float) -> str:
    """Return a p-value with two digits that count ("0.26", "0.047", "2.2e-04")."""
    if p < 0.001:
        return f"{p:.1e}"
    return str(round_half_up(p, 2 if p >= 0.1 else 3 if p >= 0.01 else 4))
