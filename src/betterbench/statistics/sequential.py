"""Sequential tests for pairs. The evidence may be inspected after every pair.

An e-process starts at 1. If there is no difference, its expected value is at most 1 at any stopping time. By Ville's
inequality, it then reaches ``1 / alpha`` with a probability of at most ``alpha``, regardless of the number of
inspections. A p-value for a fixed number of trials has no such guarantee: inspected after every pair, it eventually
finds a difference.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from betterbench.statistics.interval import check_fraction
from betterbench.statistics.power import DEFAULT_ALPHA

PRIOR_COUNT = 0.18
"""Prior number of successes and failures of a rate in :func:`two_rate_e_process`. Turner and Grünwald chose this value
because the evidence then grows fast with few trials.
"""

DISCORDANT_PRIOR = 0.5
"""Prior number of discordant pairs for each side in :func:`discordant_e_process`: Jeffreys' prior."""


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
        """The evidence after the last pair, or 1 without pairs."""
        return _exp(self.logs[-1]) if self.logs else 1.0

    @property
    def p_value(self) -> float:
        """The anytime-valid p-value, which is the inverse of the largest evidence so far, but at most 1."""
        return math.exp(-max(0.0, *self.logs)) if self.logs else 1.0

    @property
    def decided_at(self) -> int | None:
        """Number of pairs after which the evidence first reached ``1 / alpha``, or None."""
        bound = -math.log(self.alpha)
        return next((i for i, log in enumerate(self.logs, 1) if log >= bound), None)


def discordant_e_process(pairs: Iterable[tuple[bool, bool]], *, alpha: float = DEFAULT_ALPHA) -> EProcess:
    """Return the evidence from dependent pairs, such as two policies on the same trials.

    This is the sequential form of McNemar's test. If the two rates are equal, each discordant pair favors either side
    with probability 1/2. The next discordant pair is predicted from the earlier pairs, with probability ``(s + 1/2) /
    (t + 1)``. The evidence is multiplied by twice the probability given to the actual outcome. Concordant pairs leave
    it unchanged. The test makes no assumption on the dependence within a pair. If the outcomes often agree, it is more
    powerful than :func:`two_rate_e_process`.

    Args:
        pairs: (first succeeded, second succeeded) in an order that does not depend on the outcomes.
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
    """Return the evidence from two independent arms, with one trial of each per pair.

    This is the safe test for two proportions in blocks of two (Turner and Grünwald). The likelihood of a pair under the
    two rates estimated from earlier pairs is divided by its likelihood under their mean. The rates may drift from pair
    to pair, but the outcomes of one pair must be independent. If one side tends to fail trials that the other side
    solves, the false-positive rate exceeds the level. For policies on the same trials use :func:`discordant_e_process`.

    Args:
        pairs: (first succeeded, second succeeded) in an order that does not depend on the outcomes.
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
    """Return the exponential, or the largest finite float on overflow."""
    return math.exp(min(log, 709.0))
