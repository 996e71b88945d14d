"""Numbers as text: counts with percentages, percentage points and p-values."""

from __future__ import annotations

from decimal import Decimal

from betterbench.statistics.rate import Rate
from betterbench.statistics.rounding import percent, round_half_up

MINUS = "\N{MINUS SIGN}"


def counted(rate: Rate) -> str:
    """Format a rate as a count and a percentage: "45/60 (75.0 %)"."""
    return f"{rate.k}/{rate.n} ({percent(rate.k, rate.n)} %)" if rate.n else "0/0"


def minus(number: Decimal) -> str:
    """Format a decimal number with a typographic minus sign instead of a hyphen."""
    return str(number).replace("-", MINUS)


def signed(number: Decimal) -> str:
    """Format a decimal number with its sign. Zero has no sign."""
    return f"+{number}" if number > 0 else minus(number)


def points(value: float, digits: int = 1) -> str:
    """Format a fraction as percentage points, without a plus sign."""
    return minus(round_half_up(100.0 * value, digits))


def p_text(p_value: float | None) -> str:
    """Format a p-value with two significant digits ("p = 0.26", "p < 0.001"). None gives an empty string."""
    if p_value is None:
        return ""
    if p_value < 0.001:
        return "p < 0.001"
    return f"p = {round_half_up(p_value, 2 if p_value >= 0.1 else 3 if p_value >= 0.01 else 4)}"
