"""Bisection for the last number at which a condition holds."""

from __future__ import annotations

from collections.abc import Callable

_HALVINGS = 200
"""Halvings of the range, at most: more than enough to reach two neighboring floats."""


def last_held(held: Callable[[float], bool], inside: float, outside: float) -> float:
    """Return the last number from ``inside``, at which a condition holds, toward ``outside`` at which it still does."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if held(middle) else (inside, middle)
    return inside
