"""Mean of scores that come in clusters, such as answers about the same image, with its confidence interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import Any

from betterbench.errors import InvalidInputError
from betterbench.statistics.interval import DEFAULT_CONFIDENCE, normal_quantile


@dataclass(frozen=True, slots=True)
class ClusteredMean:
    """Mean score with an interval that accounts for clusters.

    Attributes:
        total: Exact sum of the scores.
        n: Number of scores.
        clusters: Number of clusters.
        low: Lower end of the interval of the mean.
        high: Upper end of the interval of the mean.
    """

    total: Fraction
    n: int
    clusters: int
    low: float
    high: float

    @property
    def mean(self) -> Fraction | None:
        """Exact mean, or None if there are no scores."""
        return self.total / self.n if self.n else None

    def to_json(self) -> dict[str, Any]:
        """Return the result in JSON form, with the mean as "value"."""
        value = None if self.mean is None else float(self.mean)
        return {**asdict(self), "total": float(self.total), "value": value}


def clustered_mean(
    scores: Sequence[Fraction], clusters: Sequence[str], *, confidence: float = DEFAULT_CONFIDENCE
) -> ClusteredMean:
    """Return the mean of scores between 0 and 1 with an interval that accounts for clusters.

    The interval is Wilson's with the effective sample size n* = p (1 - p) / v. The variance v of the mean is estimated
    from the totals of the clusters by linearization. See Korn and Graubard, "Confidence intervals for proportions with
    small expected number of positive counts", 1998, and Dean and Pagano, "Evaluating confidence interval methods for
    binomial proportions in clustered surveys", 2015. n* is at most the number of scores. If all scores are 0 or all are
    1, n* is the number of clusters.

    Args:
        scores: Scores between 0 and 1 (n,).
        clusters: Name of each score's cluster (n,).
        confidence: Two-sided confidence level.

    Raises:
        InvalidInputError: If a score is not between 0 and 1, or if the lengths differ.
    """
    if len(scores) != len(clusters):
        problem = f"{len(clusters)} clusters for {len(scores)} scores"
        raise InvalidInputError("clusters", problem, "Pass one cluster per score")
    if any(not 0 <= s <= 1 for s in scores):
        raise InvalidInputError("scores", "a score is not between 0 and 1", "Use fractions from 0 to 1")
    n, z = len(scores), normal_quantile(confidence)
    members: dict[str, list[Fraction]] = {}
    for score, cluster in zip(scores, clusters, strict=True):
        members.setdefault(cluster, []).append(score)
    total, m = sum(scores, Fraction(0)), len(members)
    if n == 0:
        return ClusteredMean(total, 0, 0, 0.0, 1.0)
    p = float(total / n)
    n_effective = float(m)
    if m > 1 and 0.0 < p < 1.0:
        squares = sum((float(sum(of, Fraction(0))) - p * len(of)) ** 2 for of in members.values())
        variance = m / (m - 1) * squares / n**2
        n_effective = min(float(n), p * (1.0 - p) / variance) if variance > 0.0 else float(n)
    center = (p + z * z / (2 * n_effective)) / (1 + z * z / n_effective)
    half = z / (1 + z * z / n_effective) * math.sqrt(p * (1 - p) / n_effective + z * z / (4 * n_effective**2))
    low = 0.0 if total == 0 else max(0.0, center - half)
    high = 1.0 if total == n else min(1.0, center + half)
    return ClusteredMean(total, n, m, low, high)
