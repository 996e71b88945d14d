"""Stratified cluster bootstrap for differences between paired rates."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from betterbench.errors import InvalidInputError
from betterbench.statistics.difference import Difference, newcombe_paired_difference
from betterbench.statistics.interval import DEFAULT_CONFIDENCE, check_fraction
from betterbench.statistics.paired import PairedTable

DEFAULT_RESAMPLES = 10_000
"""Number of resamples. The Monte Carlo error of a 2.5 % tail is then 0.16 percentage points."""


def paired_bootstrap(
    first: Sequence[float],
    second: Sequence[float],
    *,
    generator: np.random.Generator,
    strata: Sequence[str] | None = None,
    clusters: Sequence[str] | None = None,
    resamples: int = DEFAULT_RESAMPLES,
    confidence: float = DEFAULT_CONFIDENCE,
) -> Difference:
    """Return the mean difference of pairs of scores, with its percentile bootstrap interval.

    In each stratum, whole clusters are drawn with replacement. To keep the set of tasks fixed, use the task as the
    stratum. If several variations share one twin (the training trial with the same seed), use the twin as the cluster,
    because such pairs are not independent. The result does not depend on the order of the pairs.

    If all pairs differ by the same amount, the interval has zero width. For successes with few pairs or pairs that all
    agree, use :func:`~betterbench.statistics.difference.newcombe_paired_difference`.

    Args:
        first: Score of the first member of each pair (n,): 0 or 1 for success, or a fraction such as progress.
        second: Score of the second member of each pair (n,).
        generator: Source of randomness.
        strata: Name of each pair's stratum (n,). By default, all pairs are in one stratum.
        clusters: Name of each pair's cluster within its stratum (n,). By default, each pair is its own cluster.
        resamples: Number of bootstrap resamples.
        confidence: Two-sided confidence level, between 0 and 1.

    Returns:
        The mean of ``first - second``. If there are no pairs, the value is None and the interval is [-1, 1].
    """
    check_fraction("confidence", confidence)
    if resamples < 1:
        raise InvalidInputError(
            "resamples", f"{resamples} is not a valid number of resamples", "Use a number ≥ 1, such as 10000"
        )
    scores = _paired_scores(first, second)
    n = len(scores)
    strata = _names("strata", strata, n) or [""] * n
    names = _names("clusters", clusters, n) or [str(i) for i in range(n)]
    if n == 0:
        return Difference(None, -1.0, 1.0, "paired bootstrap", confidence)
    members: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for stratum, cluster, score in zip(strata, names, scores.tolist(), strict=True):
        members[stratum][cluster].append(score)
    sums, sizes = np.zeros(resamples), np.zeros(resamples)
    for stratum in sorted(members):
        # Clusters with the same sum and size are interchangeable, so drawing the count of each kind is exact.
        kinds = Counter((float(np.sum(np.sort(values))), len(values)) for values in members[stratum].values())
        ordered = sorted(kinds.items())
        total = kinds.total()
        draws = generator.multinomial(total, [count / total for _, count in ordered], size=resamples)
        sums += draws @ np.array([kind[0] for kind, _ in ordered])
        sizes += draws @ np.array([float(kind[1]) for kind, _ in ordered])
    means = sums / sizes
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(means, (tail, 1.0 - tail))
    return Difference(float(np.sum(np.sort(scores))) / n, float(low), float(high), "paired bootstrap", confidence)


def wider_paired_difference(
    outcomes: Sequence[tuple[bool, bool]],
    *,
    generator: np.random.Generator,
    strata: Sequence[str],
    clusters: Sequence[str],
    confidence: float = DEFAULT_CONFIDENCE,
) -> Difference:
    """Return the difference between two success rates over the same pairs, with the wider of two intervals.

    Each pair is given as (first succeeded, second succeeded). The bootstrap accounts for variations that share a twin
    (the training trial with the same seed), but its interval has zero width if all pairs agree. Newcombe's interval
    always has a positive width. ``strata`` and ``clusters`` are used as in :func:`paired_bootstrap`.
    """
    drawn = paired_bootstrap(
        [float(first) for first, _ in outcomes],
        [float(second) for _, second in outcomes],
        generator=generator,
        strata=strata,
        clusters=clusters,
        confidence=confidence,
    )
    scored = newcombe_paired_difference(PairedTable.from_outcomes(outcomes), confidence=confidence)
    low, high = min(drawn.low, scored.low), max(drawn.high, scored.high)
    return Difference(drawn.value, low, high, "paired bootstrap or Newcombe, the wider", confidence)


def _paired_scores(first: Sequence[float], second: Sequence[float]) -> npt.NDArray[np.float64]:
    """Return the differences (n,) between the scores of the pairs, after checking all scores."""
    if len(first) != len(second):
        problem = f"{len(first)} first and {len(second)} second scores cannot be paired"
        raise InvalidInputError(
            "first, second", problem, "Pass as many scores in first as in second, with the pairs in the same order"
        )
    sides = []
    for where, side in (("first", first), ("second", second)):
        values = np.asarray(side, dtype=np.float64)
        if not bool(np.all((values >= 0.0) & (values <= 1.0))):
            raise InvalidInputError(
                where, "a score is not between 0 and 1", "Use 0 or 1 for success, or a fraction between them"
            )
        sides.append(values)
    difference: npt.NDArray[np.float64] = sides[0] - sides[1]
    return difference


def _names(where: str, names: Sequence[str] | None, n: int) -> list[str]:
    """Return the names as a list with one name per pair, or an empty list if no names are given."""
    if names is None:
        return []
    if len(names) != n:
        raise InvalidInputError(where, f"{len(names)} names for {n} pairs", "Pass one name per pair")
    return list(names)
