"""Where a condition ends, by halving the way between a place at which it holds and one at which it may not."""

from __future__ import annotations

from collections.abc import Callable

_HALVINGS = 200
"""More than enough to leave no number between two neighboring floats."""


def last_held(held: Callable[[float], bool], inside: float, outside: float) -> float:
    """Return the last number from ``inside``, at which a condition holds, toward ``outside`` at which it still does."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if held(middle) else (inside, middle)
    return inside
