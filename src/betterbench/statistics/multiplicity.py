"""Correction of p-values when many are shown together."""

from __future__ import annotations

import math
from collections.abc import Sequence

from betterbench.errors import InvalidInputError


def holm(p_values: Sequence[float]) -> tuple[float, ...]:
    """Return the p-values adjusted by the step-down procedure of Holm (1979).

    Rejecting what is below ``alpha`` after adjustment keeps the probability of any false rejection in the family below
    ``alpha``, whatever the dependence among the tests. The ``i``-th smallest of ``m`` values is multiplied by
    ``m - i + 1``; a value is never adjusted below a smaller one, nor above 1.
    """
    for i, p in enumerate(p_values):
        if not (math.isfinite(p) and 0.0 <= p <= 1.0):
            raise InvalidInputError(f"p_values[{i}]", f"{p!r} is no probability", "Give values from 0 to 1")
    adjusted = [0.0] * len(p_values)
    running = 0.0
    for rank, i in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        running = max(running, min(1.0, (len(p_values) - rank) * p_values[i]))
        adjusted[i] = running
    return tuple(adjusted)
