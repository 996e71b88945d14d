"""Decimal rounding in which ties are rounded away from zero."""

from __future__ import annotations

import math
from decimal import ROUND_HALF_UP, Context, Decimal
from fractions import Fraction

from betterbench.errors import InvalidInputError
from betterbench.statistics.interval import check_counts

_FLOAT_DIGITS = 12
"""Number of significant decimal digits that are used of a float.

A float has 15, but the last digits contain rounding errors of binary arithmetic. With these errors, 7.685 could be
rounded either up or down.
"""


def round_half_up(value: float | str | Decimal | Fraction, digits: int) -> Decimal:
    """Round to a number of decimals, with ties away from zero.

    Python's ``round`` gives 7.68 for 7.685, because the nearest float is below it and because it rounds ties to even
    digits. The tables in papers are rounded in decimal arithmetic.

    Args:
        value: A finite number. Fractions, decimals, integers and numeric strings are used exactly, floats with 12
            digits.
        digits: Number of decimals to keep, at least 0.

    Returns:
        The rounded number with exactly that many decimals.
    """
    if digits < 0:
        raise InvalidInputError("digits", f"{digits} is not a valid number of decimals", "Use a number ≥ 0")
    if isinstance(value, float) and math.isfinite(value):
        decimal = Decimal(f"{value:.{_FLOAT_DIGITS - 1}e}")
        room = Context(prec=max(28, decimal.adjusted() + digits + 2), rounding=ROUND_HALF_UP)
        rounded = decimal.quantize(Decimal((0, (1,), -digits)), context=room)
        return rounded or abs(rounded)
    try:
        exact = Fraction(value)
    except (ValueError, OverflowError, ZeroDivisionError) as error:
        raise InvalidInputError("value", f"{value!r} is not a finite number", "Use a number such as 7.685") from error
    scaled = abs(exact) * 10**digits
    whole = int(scaled) + (1 if scaled - int(scaled) >= Fraction(1, 2) else 0)
    sign = "-" if exact < 0 and whole else ""
    return Decimal(f"{sign}{whole}").scaleb(-digits, Context(prec=max(28, len(str(whole)) + digits)))


def percent(k: int, n: int, *, digits: int = 1) -> Decimal | None:
    """Return ``k`` of ``n`` in percent, computed exactly and rounded half up.

    Returns:
        The percentage, or None if there are no trials.
    """
    check_counts(k, n)
    return round_half_up(Fraction(100 * k, n), digits) if n else None
