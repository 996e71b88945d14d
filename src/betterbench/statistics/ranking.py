"""Ranking quality of a score: the area under its ROC curve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.statistics.bisection import last_held
from betterbench.statistics.interval import DEFAULT_CONFIDENCE, normal_quantile


@dataclass(frozen=True, slots=True)
class RankingArea:
    """Probability that a positive case has a higher score than a negative one (area under the ROC curve).

    Attributes:
        value: The area, 0.5 for a score without information; None if all cases are positive or all are negative.
        low: Lower end of the interval, in [0, 1].
        high: Upper end.
        positives: Number of positive cases.
        negatives: Number of negative cases.
    """

    value: float | None
    low: float
    high: float
    positives: int
    negatives: int


def ranking_area(
    scores: Sequence[float], happened: Sequence[bool], *, confidence: float = DEFAULT_CONFIDENCE
) -> RankingArea:
    """Return the area under the receiver operating characteristic (AUROC); ties count half.

    The interval is Newcombe's score interval (Statistics in Medicine 25, 2006, 559-573, method 5): all areas whose
    distance from the estimate is within the normal quantile, with Hanley and McNeil's variance at that area. Its width
    is positive even if the ranking is perfect, and large if there are few positive or negative cases.
    """
    if len(scores) != len(happened):
        problem = f"{len(scores)} scores for {len(happened)} outcomes"
        raise InvalidInputError("scores, happened", problem, "Give one of each")
    quantile = normal_quantile(confidence)
    values, truth = np.asarray(scores, dtype=np.float64), np.asarray(happened, dtype=bool)
    yes, no = values[truth], values[~truth]
    if not len(yes) or not len(no):
        return RankingArea(None, 0.0, 1.0, len(yes), len(no))
    apart = yes[:, None] - no[None, :]
    area = float((apart > 0.0).mean() + 0.5 * (apart == 0.0).mean())
    low, high = (_end(area, end, quantile, len(yes), len(no)) for end in (0.0, 1.0))
    return RankingArea(area, low, high, len(yes), len(no))


def _end(area: float, end: float, quantile: float, m: int, n: int) -> float:
    """Return the end of the interval in a given direction."""
    more = 0.5 * (m + n) - 1.0

    def near(other: float) -> bool:
        spread = other * (1.0 - other) * (1.0 + more * ((1.0 - other) / (2.0 - other) + other / (1.0 + other)))
        return abs(area - other) <= quantile * math.sqrt(spread / (m * n))

    return last_held(near, area, end)
