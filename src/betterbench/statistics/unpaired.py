"""Exact tests for the difference between two independent rates."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from betterbench.statistics import special
from betterbench.statistics.rate import Rate

_NUISANCE_POINTS = 257
"""Number of values of the unknown common rate over which a p-value is maximized.

They are evenly spaced in the arcsine of the square root of the rate, where the standard error is constant. With 16
times as many values, no Barnard p-value for 20 trials per arm changes by more than 0.00002.
"""

_TIE = 1e-9
"""Relative difference below which two values of a test statistic count as equal."""


def barnard_p(first: Rate, second: Rate) -> float:
    """Return the two-sided p-value of Barnard's exact unconditional test with the pooled score statistic.

    Unlike Fisher's test, it does not condition on the total number of successes, because the experiment does not fix
    this number. It is therefore more powerful when there are few trials (Barnard 1947; Suissa and Shuster 1985).
    ``scipy.stats.barnard_exact`` is not used because its search for the worst common rate stops at a local maximum for
    some tables (10/20 against 11/20).

    Returns:
        The p-value. It is 1.0 if one of the rates has no trials or all trials have the same outcome.
    """
    if _uninformative(first, second):
        return 1.0
    statistic = _pooled_score(first.n, second.n)
    return _worst_probability(statistic >= statistic[first.k, second.k] * (1.0 - _TIE))


def boschloo_p(first: Rate, second: Rate) -> float:
    """Return the two-sided p-value of Boschloo's exact unconditional test.

    It orders the outcomes by Fisher's p-value and is uniformly more powerful than Fisher's test (Boschloo 1970). The
    two-sided value is twice the smaller one-sided value, at most 1.

    Returns:
        The p-value. It is 1.0 if one of the rates has no trials or all trials have the same outcome.
    """
    if _uninformative(first, second):
        return 1.0
    from scipy import stats  # noqa: PLC0415 - takes 0.5 s, which the workers of a run do not need

    i, j = np.arange(first.n + 1)[:, None], np.arange(second.n + 1)[None, :]
    total = first.n + second.n
    fewer = stats.hypergeom.cdf(i, total, i + j, first.n)
    more = stats.hypergeom.sf(i - 1, total, i + j, first.n)
    sides = (_worst_probability(tail <= tail[first.k, second.k] * (1.0 + _TIE)) for tail in (fewer, more))
    return min(1.0, 2.0 * min(sides))


def fisher_p(first: Rate, second: Rate) -> float:
    """Return the two-sided p-value of Fisher's exact test.

    The test is conservative. It is provided for comparison with published values.

    Returns:
        The p-value. It is 1.0 if one of the rates has no trials or all trials have the same outcome.
    """
    if _uninformative(first, second):
        return 1.0
    from scipy import stats  # noqa: PLC0415 - takes 0.5 s, which the workers of a run do not need

    table = [[first.k, second.k], [first.n - first.k, second.n - second.k]]
    return min(1.0, float(stats.fisher_exact(table).pvalue))


def barnard_p_values(n: int) -> npt.NDArray[np.float64]:
    """Return Barnard's p-value for every possible outcome of two arms with ``n`` trials each.

    Returns:
        The p-values of ``i`` successes in one arm and ``j`` in the other, as an (n + 1, n + 1) array.
    """
    flat = _pooled_score(n, n).ravel()
    order = np.argsort(-flat, kind="stable")
    descending = flat[order]
    # The p-value of an outcome includes all outcomes that are at least as extreme, including ties.
    last_tie = np.searchsorted(-descending, -descending * (1.0 - _TIE), side="right") - 1
    worst = np.zeros(flat.size)
    for rate in _common_rates():
        arm = binomial_probabilities(n, float(rate))
        mass = np.cumsum(np.outer(arm, arm).ravel()[order])
        np.maximum(worst, mass[last_tie], out=worst)
    p_values = np.empty(flat.size)
    p_values[order] = np.minimum(worst, 1.0)
    return p_values.reshape(n + 1, n + 1)


def binomial_probabilities(n: int, rate: float) -> npt.NDArray[np.float64]:
    """Return the probabilities of 0 to ``n`` successes as an (n + 1,) array."""
    k = np.arange(n + 1)
    log_ways = special.gammaln(n + 1) - special.gammaln(k + 1) - special.gammaln(n - k + 1)
    log_mass = log_ways + special.xlogy(k, rate) + special.xlog1py(n - k, -rate)
    probabilities: npt.NDArray[np.float64] = np.exp(log_mass)
    return probabilities


def _pooled_score(n1: int, n2: int) -> npt.NDArray[np.float64]:
    """Return the absolute pooled score statistic of every outcome of two arms, as an (n1 + 1, n2 + 1) array."""
    k1, k2 = np.arange(n1 + 1)[:, None], np.arange(n2 + 1)[None, :]
    gap = np.abs(k1 / n1 - k2 / n2)
    pooled = (k1 + k2) / (n1 + n2)
    spread = np.sqrt(pooled * (1.0 - pooled) * (1.0 / n1 + 1.0 / n2))
    return np.divide(gap, spread, out=np.zeros_like(gap), where=spread > 0.0)


def _common_rates() -> npt.NDArray[np.float64]:
    """Return the common rates over which a p-value is maximized. They are greater than 0 and at most 1/2.

    Larger rates are covered by exchanging successes and failures.
    """
    rates: npt.NDArray[np.float64] = np.sin(np.linspace(0.0, np.pi / 4.0, _NUISANCE_POINTS)[1:]) ** 2
    return rates


def _worst_probability(extreme: npt.NDArray[np.bool_]) -> float:
    """Return the maximum probability of a set of outcomes over all common success rates of the two arms.

    Returns:
        The maximum over a grid of common rates. The grid is refined once around its best point.
    """
    n1, n2 = extreme.shape[0] - 1, extreme.shape[1] - 1
    members = extreme.astype(np.float64)

    def mass(rates: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        arm1 = np.stack([binomial_probabilities(n1, float(rate)) for rate in rates])
        arm2 = np.stack([binomial_probabilities(n2, float(rate)) for rate in rates])
        probability: npt.NDArray[np.float64] = np.einsum("ij,ij->i", arm1 @ members, arm2)
        return probability

    half = _common_rates()
    rates = np.concatenate([half, 1.0 - half[-2::-1]])
    coarse = mass(rates)
    best = int(np.argmax(coarse))
    around = np.linspace(rates[max(0, best - 1)], rates[min(best + 1, rates.size - 1)], 33)
    return min(1.0, float(max(coarse[best], np.max(mass(around)))))


def _uninformative(first: Rate, second: Rate) -> bool:
    """Return whether no test is possible, because an arm has no trials or all trials have the same outcome."""
    k, n = first.k + second.k, first.n + second.n
    return first.n == 0 or second.n == 0 or k in (0, n)
