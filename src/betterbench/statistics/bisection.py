"""Bisection search for the last number for which a condition holds."""

from __future__ import annotations

from collections.abc import Callable

_HALVINGS = 200
"""Maximum number of times that the range is halved. This number is sufficient to reach two neighboring floats."""


def last_held(held: Callable[[float], bool], inside: float, outside: float) -> float:
    """Return the last number from ``inside`` toward ``outside`` at which the condition ``held`` is still true."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if held(middle) else (inside, middle)
    return inside
