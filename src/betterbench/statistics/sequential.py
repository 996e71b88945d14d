"""Sequential tests for pairs of trials. The evidence may be inspected after every pair.

An e-process starts at 1. If there is no difference, its expected value is at most 1 at any stopping time. By Ville's
inequality, the probability that it ever reaches ``1 / alpha`` is then at most ``alpha``, however often it is inspected.
A p-value for a fixed number of trials has no such guarantee: if it is inspected after every pair, it eventually finds a
difference.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from betterbench.statistics.interval import check_fraction
from betterbench.statistics.power import DEFAULT_ALPHA

PRIOR_COUNT = 0.18
"""Prior number of successes and failures of each rate in :func:`two_rate_e_process`.

Turner and Grünwald chose this value because the evidence then grows fast when there are few trials.
"""

DISCORDANT_PRIOR = 0.5
"""Prior number of discordant pairs in each direction in :func:`discordant_e_process` (Jeffreys' prior)."""


@dataclass(frozen=True, slots=True)
class EProcess:
    """Evidence against "no difference" after each pair.

    Attributes:
        logs: Natural logarithm of the evidence after each pair.
        alpha: Level of the test.
    """

    logs: tuple[float, ...]
    alpha: float

    @property
    def n(self) -> int:
        """Number of pairs."""
        return len(self.logs)

    @property
    def value(self) -> float:
        """Evidence after the last pair, or 1 if there are no pairs."""
        return _exp(self.logs[-1]) if self.logs else 1.0

    @property
    def p_value(self) -> float:
        """p-value that is valid at any stopping time: the inverse of the largest evidence so far, but at most 1."""
        return math.exp(-max(0.0, *self.logs)) if self.logs else 1.0

    @property
    def decided_at(self) -> int | None:
        """Number of pairs after which the evidence first reached ``1 / alpha``, or None if it never did."""
        bound = -math.log(self.alpha)
        return next((i for i, log in enumerate(self.logs, 1) if log >= bound), None)


def discordant_e_process(pairs: Iterable[tuple[bool, bool]], *, alpha: float = DEFAULT_ALPHA) -> EProcess:
    """Return the evidence from dependent pairs, such as two policies' trials with the same seed.

    This is the sequential form of McNemar's test. If the two rates are equal, each discordant pair favors the first or
    the second with probability 1/2. The next discordant pair is predicted from the earlier pairs: with ``s`` of ``t``
    discordant pairs so far in a direction, the probability of this direction is ``(s + 1/2) / (t + 1)``. The evidence
    is multiplied by twice the probability that was predicted for the actual outcome. Concordant pairs do not change the
    evidence. The test makes no assumption about the dependence within a pair. If the outcomes often agree, it is more
    powerful than :func:`two_rate_e_process`.

    Args:
        pairs: Pairs as (first succeeded, second succeeded), in an order that does not depend on the outcomes.
        alpha: Level of the test.
    """
    check_fraction("alpha", alpha)
    wins, log, logs = [0, 0], 0.0, []
    for first, second in pairs:
        if first != second:
            side = 0 if first else 1
            share = (wins[side] + DISCORDANT_PRIOR) / (sum(wins) + 2.0 * DISCORDANT_PRIOR)
            log += math.log(2.0 * share)
            wins[side] += 1
        logs.append(log)
    return EProcess(tuple(logs), alpha)


def two_rate_e_process(pairs: Iterable[tuple[bool, bool]], *, alpha: float = DEFAULT_ALPHA) -> EProcess:
    """Return the evidence from two independent arms. Each pair consists of one trial of each arm.

    This is the safe test for two proportions in blocks of two (Turner and Grünwald). The likelihood of a pair under the
    two rates estimated from earlier pairs is divided by its likelihood under the mean of both rates. The rates may
    drift from pair to pair, but the outcomes of one pair must be independent. If one arm tends to fail in trials that
    the other arm solves, the false-positive rate is higher than the level. For policies on the same trials, use
    :func:`discordant_e_process`.

    Args:
        pairs: Pairs as (first succeeded, second succeeded), in an order that does not depend on the outcomes.
        alpha: Level of the test.
    """
    check_fraction("alpha", alpha)
    counts, log, logs = [0, 0], 0.0, []
    for t, pair in enumerate(pairs):
        rates = [(k + PRIOR_COUNT) / (t + 2.0 * PRIOR_COUNT) for k in counts]
        common = sum(rates) / 2.0
        for side, success in enumerate(pair):
            log += math.log(rates[side] / common if success else (1.0 - rates[side]) / (1.0 - common))
            counts[side] += success
        logs.append(log)
    return EProcess(tuple(logs), alpha)


def _exp(log: float) -> float:
    """Return the exponential of a number, or the largest finite float if it would overflow."""
    return math.exp(min(log, 709.0))
