"""Sign-flip test for paired differences. Its null hypothesis is that the two members of each pair are exchangeable."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

EXACT_UP_TO = 16
"""Maximum number of pairs for which all combinations of signs are enumerated."""
DRAWN = 99_999
_SLACK = 1e-9
_AT_ONCE = 10_000_000
"""Number of signs that are multiplied at once, which limits the memory."""


def sign_flip_p(differences: Sequence[float], *, generator: np.random.Generator) -> float:
    """Return the two-sided p-value of Fisher's randomization test for paired differences.

    If neither member of a pair is better, each difference is as likely as the same difference with the opposite sign.
    The p-value is the fraction of all combinations of signs that give a mean at least as far from zero as the observed
    mean. It is exact for up to :data:`EXACT_UP_TO` differences, and estimated from random combinations for more. The
    smallest possible p-value of n pairs is 2 / 2**n.

    Returns:
        The p-value, or 1.0 if there are no differences.
    """
    values = np.asarray(differences, dtype=np.float64)
    if not values.size or not values.any():
        return 1.0
    found = abs(float(values.sum())) - _SLACK
    if len(values) <= EXACT_UP_TO:
        bits = np.arange(1 << len(values))[:, None] >> np.arange(len(values)) & 1
        return float((np.abs((1 - 2 * bits) @ values) >= found).mean())
    flips = generator.integers(0, 2, size=(DRAWN, len(values)), dtype=np.int8)
    at_least = sum(
        int((np.abs((1.0 - 2.0 * part) @ values) >= found).sum())
        for part in np.array_split(flips, 1 + flips.size // _AT_ONCE)
    )
    return (1 + at_least) / (1 + DRAWN)
