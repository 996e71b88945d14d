"""Correction of p-values and of e-values when many are shown together."""

from __future__ import annotations

import math
from collections.abc import Sequence

from betterbench.errors import InvalidInputError
from betterbench.statistics.interval import check_fraction


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


def e_benjamini_hochberg(evidence: Sequence[float], *, level: float, hypotheses: int | None = None) -> frozenset[int]:
    """Return the places of the null hypotheses that are rejected, given the evidence (e-value) against each.

    The procedure of Wang and Ramdas (Journal of the Royal Statistical Society B 84, 2022, 822-852) rejects the ``k``
    hypotheses with the most evidence, for the largest ``k`` at which each has at least ``m / (level k)``. Of what is
    rejected, the expected share that is true is at most ``level``, whatever the dependence and whenever one stopped;
    where all ``m`` are true, that is the probability of rejecting any.

    Args:
        evidence: One e-value per hypothesis that may be rejected.
        level: The bound of that share.
        hypotheses: Their number ``m``, with those that may no longer be rejected; as many as there is evidence for, if
            not given.
    """
    check_fraction("level", level)
    for i, value in enumerate(evidence):
        if not value >= 0.0:
            raise InvalidInputError(f"evidence[{i}]", f"{value!r} is no e-value", "Give values of at least 0")
    m = len(evidence) if hypotheses is None else hypotheses
    ranked = sorted(range(len(evidence)), key=lambda i: -evidence[i])
    count = max((k for k, i in enumerate(ranked, 1) if evidence[i] >= m / (level * k)), default=0)
    return frozenset(ranked[:count])
