"""Correction of p-values and e-values for multiple testing."""

from __future__ import annotations

import math
from collections.abc import Sequence

from betterbench.errors import InvalidInputError
from betterbench.statistics.interval import check_fraction


def holm(p_values: Sequence[float]) -> tuple[float, ...]:
    """Return the p-values after adjustment by the step-down procedure of Holm (1979).

    If all hypotheses with an adjusted p-value below ``alpha`` are rejected, the probability of any false rejection in
    the family is below ``alpha``, regardless of the dependence among the tests. The ``i``-th smallest of ``m`` p-values
    is multiplied by ``m - i + 1``. Adjusted values have the same order as the original values and are at most 1.
    """
    for i, p in enumerate(p_values):
        if not (math.isfinite(p) and 0.0 <= p <= 1.0):
            raise InvalidInputError(f"p_values[{i}]", f"{p!r} is not a probability", "Use values from 0 to 1")
    adjusted = [0.0] * len(p_values)
    running = 0.0
    for rank, i in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        running = max(running, min(1.0, (len(p_values) - rank) * p_values[i]))
        adjusted[i] = running
    return tuple(adjusted)


def e_benjamini_hochberg(evidence: Sequence[float], *, level: float, hypotheses: int | None = None) -> frozenset[int]:
    """Return the indices of the null hypotheses to reject, given the evidence (e-value) against each of them.

    The procedure of Wang and Ramdas (Journal of the Royal Statistical Society B 84, 2022, 822-852) rejects the ``k``
    hypotheses with the most evidence, for the largest ``k`` at which each of them has an e-value of at least ``m /
    (level k)``. The expected fraction of true hypotheses among the rejected hypotheses is at most ``level``, for any
    dependence and any stopping time. If all ``m`` hypotheses are true, this bounds the probability of any rejection.

    Args:
        evidence: One e-value for each hypothesis that may be rejected.
        level: Bound on the expected fraction of false rejections.
        hypotheses: Total number ``m`` of hypotheses, including those that can no longer be rejected. By default, it is
            the number of e-values.
    """
    check_fraction("level", level)
    for i, value in enumerate(evidence):
        if not value >= 0.0:
            raise InvalidInputError(f"evidence[{i}]", f"an e-value must be ≥ 0, got {value!r}", "Use e-values ≥ 0")
    m = len(evidence) if hypotheses is None else hypotheses
    ranked = sorted(range(len(evidence)), key=lambda i: -evidence[i])
    count = max((k for k, i in enumerate(ranked, 1) if evidence[i] >= m / (level * k)), default=0)
    return frozenset(ranked[:count])
