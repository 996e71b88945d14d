"""Psychometric threshold: the stimulus size at which answers become correct.

The model is the psychometric function with guessing and lapses (Wichmann and Hill, "The psychometric function: I.
Fitting, sampling, and goodness of fit", Perception & Psychophysics 63, 2001):

    P(correct) = f + (1 - f) k F(x),    F(x) = 1 / (1 + (x / s)^-b),    f = g c

The chance ``c`` of guessing an item is known. The fitted parameters are:

- ``s``: the threshold, i.e. the size at which half of the items can be read;
- ``b``: the slope;
- ``g``: the fraction of unreadable items that are guessed, which is 0 for a model that does not answer these items;
- ``k``: the knowledge, i.e. the fraction of readable items that are answered correctly without guessing, for each kind
  of item.

Because each kind has its own ``k``, kinds that are difficult at every size do not move the threshold.

If there are several conditions, such as image resolutions, one function is fitted to all items. If the sizes explain
all differences between the conditions, the measured score drops as much as the predicted score from one condition to
another. A larger measured drop is reported as a further loss.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from betterbench.errors import InvalidInputError
from betterbench.statistics.flips import sign_flip_p
from betterbench.statistics.interval import DEFAULT_CONFIDENCE, check_fraction

RESAMPLES = 100
"""Number of bootstrap resamples by default."""
LEAST_ITEMS, LEAST_CLUSTERS = 40, 8
"""Minimum number of items and minimum number of clusters for a conclusion."""
EDGE = 0.02
"""Minimum fraction of items that must be smaller than the interval, and minimum fraction that must be larger.

If the threshold is among the smallest or largest 2 % of the sizes, the data do not bracket it.
"""
_SLOPES = (2.0, 40.0)
"""Range of the slope. At 40, F rises from 10 to 90 % while the size grows by 11 %, which is almost a step."""
_BINS = 100
"""Number of size classes per unit of the natural logarithm (steps of 1 %).

Sizes are rounded to these classes, so that equal items are counted together.
"""
_WIDER = 1.5
"""Factor by which the bootstrap deviations of a further loss are multiplied.

The bootstrap underestimates them for sharp thresholds. On a set with 881 items in 34 clusters, the standard deviation
over 14 simulations was 1.3 to 1.6 times that of the bootstrap.
"""
_LEAST_P = 0.005
"""Minimum distance of probabilities from 0 and 1. It prevents a single lucky answer from determining the fit."""

_PRECISION = {"maxiter": 100, "ftol": 1e-6, "gtol": 1e-4}
"""Tolerances of a fit. With them, the log-likelihood of a thousand items is exact to a thousandth."""
_RESOLUTION = 1 / 40
"""Uncertainty of a fitted threshold in log size, by which the interval is extended on both sides.

It is the scale of the steepest F, which is the F of a model with a sharp threshold.
"""

_Numbers = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class FurtherLoss:
    """Part of the drop in the mean score from the first condition to another one that stimulus sizes do not explain.

    Attributes:
        value: The loss as a fraction. It is negative if the score is higher than the sizes explain.
        low: Lower end of the interval.
        high: Upper end of the interval.
        is_supported: Whether the interval excludes 0 after Bonferroni's correction for the number of conditions.
    """

    value: float
    low: float
    high: float
    is_supported: bool


@dataclass(frozen=True, slots=True)
class Threshold:
    """Threshold of the stimulus size, with its interval.

    Attributes:
        value: The threshold in the unit of the sizes. None if the data do not allow a conclusion.
        low: Lower end of the interval.
        high: Upper end of the interval.
        rises_from: Size at which a tenth of the items can be read.
        rises_to: Size at which nine tenths of the items can be read.
        reason: Reason why there is no threshold. Empty if there is one.
        n: Number of items.
        clusters: Number of clusters.
        smallest: Smallest size.
        largest: Largest size.
        guessing: Fitted fraction of unreadable items that are guessed.
        knowledge: Fitted fraction of readable items that are answered correctly without guessing, for each kind.
        further: Further loss of each condition except the first.
    """

    value: float | None
    low: float
    high: float
    rises_from: float
    rises_to: float
    reason: str
    n: int
    clusters: int
    smallest: float
    largest: float
    guessing: float
    knowledge: Mapping[str, float] = field(default_factory=dict)
    further: Mapping[str, FurtherLoss] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return the threshold in JSON form. Numbers for which there are no data are None."""
        form = asdict(self)
        return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in form.items()}


@dataclass(frozen=True, slots=True)
class Reading:
    """Score of the answer to one item, with the size of the item's stimulus.

    Attributes:
        size: Size of the stimulus, above 0.
        score: Score between 0 and 1.
        chance: Probability of guessing the answer, or 0 if it cannot be guessed.
        kind: Kind of the item. Each kind has its own knowledge parameter.
        cluster: Name of a cluster. Items in the same cluster are not independent.
        condition: Condition under which the item was asked.
    """

    size: float
    score: float
    chance: float
    kind: str
    cluster: str
    condition: str = ""


def fit_threshold(
    readings: Sequence[Reading],
    *,
    generator: np.random.Generator,
    resamples: int = RESAMPLES,
    confidence: float = DEFAULT_CONFIDENCE,
) -> Threshold:
    """Fit the size at which items can be read, by maximum likelihood with a bootstrap over clusters.

    A threshold is reported only if three conditions hold. First, there are enough items and clusters. Second, scores
    rise with size: a two-sided sign-flip test of each cluster's covariance of score and log size within kinds is
    significant at the level 1 - confidence. Third, the interval is within the range of the item sizes.

    Args:
        readings: Scores of the items. The condition of the first one is the reference for the further losses.
        generator: Source of randomness.
        resamples: Number of bootstrap resamples of whole clusters. An item that is asked under several conditions must
            have the same cluster in all of them.
        confidence: Two-sided confidence level. A further loss is supported at this level after Bonferroni's correction
            for the number of conditions.

    Raises:
        InvalidInputError: If a size, score or chance is out of range.
    """
    check_fraction("confidence", confidence)
    if resamples < 1:
        raise InvalidInputError("resamples", f"must be at least 1, got {resamples}", "Use 200 or more")
    for r in readings:
        if not (r.size > 0 and 0 <= r.score <= 1 and 0 <= r.chance < 1):
            problem = f"a reading has the size {r.size!r}, the score {r.score!r} and the chance {r.chance!r}"
            raise InvalidInputError("readings", problem, "Use sizes above 0, and scores and chances from 0 to 1")
    sizes = [r.size for r in readings]
    clusters = sorted({r.cluster for r in readings})
    nothing = Threshold(
        None, math.nan, math.nan, math.nan, math.nan, "", len(readings), len(clusters),
        min(sizes, default=math.nan), max(sizes, default=math.nan), math.nan,
    )  # fmt: skip
    if len(readings) < LEAST_ITEMS or len(clusters) < LEAST_CLUSTERS:
        counted = f"{len(readings)} items in {len(clusters)} clusters"
        return _because(nothing, f"{counted} are too few; {LEAST_ITEMS} in {LEAST_CLUSTERS} are needed")
    cells = _Cells.of(readings)
    everything = cells.counts(np.ones(len(cells.clusters)))
    best = cells.fit(everything)
    order = generator.multinomial(len(clusters), np.full(len(clusters), 1 / len(clusters)), size=resamples)
    drawn, losses = [], []
    for weights in order:
        counts = cells.counts(weights.astype(np.float64))
        at = cells.fit(counts, near=best)
        drawn.append(at[0])
        losses.append(cells.further_losses(at, counts))
    tail = (1 - confidence) / 2
    low, high = np.exp(np.quantile(drawn, (tail, 1 - tail)) + np.array([-_RESOLUTION, _RESOLUTION]))
    found = Threshold(
        value=float(np.exp(best[0])),
        low=float(low),
        high=float(high),
        rises_from=float(np.exp(best[0] - math.log(9) / math.exp(best[1]))),
        rises_to=float(np.exp(best[0] + math.log(9) / math.exp(best[1]))),
        reason="",
        n=len(readings),
        clusters=len(clusters),
        smallest=float(min(sizes)),
        largest=float(max(sizes)),
        guessing=float(best[2]),
        knowledge=dict(zip(cells.kinds, map(float, best[3 : 3 + len(cells.kinds)]), strict=True)),
        further=_further(cells, cells.further_losses(best, everything), np.array(losses), confidence),
    )
    return _judged(found, readings, generator, confidence)


def _judged(
    found: Threshold, readings: Sequence[Reading], generator: np.random.Generator, confidence: float
) -> Threshold:
    """Check whether the data bracket the threshold. If they do not, replace the threshold by the reason."""
    below, above = np.quantile([r.size for r in readings], (EDGE, 1 - EDGE))
    known = float(np.mean([found.knowledge[r.kind] for r in readings]))
    span = f"{found.smallest:.0f} to {found.largest:.0f}"
    rise, p = _trend(readings, generator)
    if p >= 1 - confidence or rise <= 0:
        excess = float(np.mean([r.score - r.chance for r in readings]))
        if excess < 0.05 or known < 0.05:
            return _because(found, f"the answers are not better than guessing at any size from {span}")
        return _because(found, f"the score does not rise with the size from {span}; a threshold would be below them")
    if found.low < below:
        return _because(found, f"too few items are smaller than the threshold (sizes from {span})")
    if found.high > above:
        return _because(found, f"too few items are larger than the threshold (sizes from {span})")
    return found


def _because(found: Threshold, reason: str) -> Threshold:
    form = {name: getattr(found, name) for name in Threshold.__slots__}
    return Threshold(**{**form, "value": None, "reason": reason})


def _trend(readings: Sequence[Reading], generator: np.random.Generator) -> tuple[float, float]:
    """Return the covariance of score and log size within kinds and conditions, and its sign-flip p-value."""
    groups: dict[tuple[str, str], list[int]] = {}
    for i, r in enumerate(readings):
        groups.setdefault((r.kind, r.condition), []).append(i)
    x, y = np.log([r.size for r in readings]), np.array([r.score for r in readings])
    for members in groups.values():
        x[members] -= x[members].mean()
        y[members] -= y[members].mean()
    sums: dict[str, float] = {}
    for r, product in zip(readings, (x * y).tolist(), strict=True):
        sums[r.cluster] = sums.get(r.cluster, 0.0) + product
    values = [sums[name] for name in sorted(sums)]
    return sum(values), sign_flip_p(values, generator=generator)


def _further(cells: _Cells, value: _Numbers, drawn: _Numbers, confidence: float) -> dict[str, FurtherLoss]:
    """Return the further loss of each condition except the first. ``drawn`` contains the losses in the resamples."""
    found = {}
    tail = (1 - confidence) / 2
    for index, name in enumerate(cells.conditions[1:], start=1):
        values = value[index] + _WIDER * (drawn[:, index] - value[index])
        low, high = np.nanquantile(values, (tail, 1 - tail))
        strict = tail / (len(cells.conditions) - 1)
        least, most = np.nanquantile(values, (strict, 1 - strict))
        found[name] = FurtherLoss(float(value[index]), float(low), float(high), bool(least > 0 or most < 0))
    return found


@dataclass(frozen=True)
class _Cells:
    """Items grouped by size, chance, kind and condition, so that the time for a fit does not grow with their number."""

    x: _Numbers
    chance: _Numbers
    kind: _Indices
    condition: _Indices
    kinds: tuple[str, ...]
    conditions: tuple[str, ...]
    clusters: tuple[str, ...]
    of_item: tuple[_Indices, _Indices, _Numbers]

    @classmethod
    def of(cls, readings: Sequence[Reading]) -> _Cells:
        kinds = tuple(sorted({r.kind for r in readings}))
        conditions = tuple(dict.fromkeys(r.condition for r in readings))
        clusters = tuple(sorted({r.cluster for r in readings}))
        number = {name: i for i, name in enumerate(clusters)}
        keys: dict[tuple[float, float, int, int], int] = {}
        where, who = [], []
        for r in readings:
            x = round(math.log(r.size) * _BINS) / _BINS
            key = (x, r.chance, kinds.index(r.kind), conditions.index(r.condition))
            where.append(keys.setdefault(key, len(keys)))
            who.append(number[r.cluster])
        logs = np.array([key[0] for key in keys], dtype=np.float64)
        chance = np.array([key[1] for key in keys], dtype=np.float64)
        kind, condition = (np.array([key[i] for key in keys], dtype=np.intp) for i in (2, 3))
        items = (
            np.array(where, dtype=np.intp),
            np.array(who, dtype=np.intp),
            np.array([r.score for r in readings], dtype=np.float64),
        )
        return cls(logs, chance, kind, condition, kinds, conditions, clusters, items)

    def counts(self, weights: _Numbers) -> tuple[_Numbers, _Numbers]:
        """Return the weighted sum of scores and number of items in each group.

        ``weights`` has one entry per cluster.
        """
        where, who, scores = self.of_item
        weight = weights[who]
        size = len(self.x)
        correct = np.bincount(where, weight * scores, size).astype(np.float64)
        total = np.bincount(where, weight, size).astype(np.float64)
        return correct, total

    def further_losses(self, at: _Numbers, counts: tuple[_Numbers, _Numbers]) -> _Numbers:
        """Return the measured minus the predicted drop in the mean score of each condition, relative to the first."""
        correct, total = counts
        size = len(self.conditions)
        left = np.bincount(self.condition, correct - total * self._rates(at)[0], size)
        with np.errstate(invalid="ignore"):  # a resample may contain no items of a condition
            mean = left / np.bincount(self.condition, total, size)
        return np.asarray(mean[0] - mean, dtype=np.float64)

    def _rates(self, at: _Numbers) -> tuple[_Numbers, _Numbers, _Numbers]:
        """Return the probability of a correct answer, F and k for each group of items.

        The module docstring defines F and k.
        """
        read = 1 / (1 + np.exp(np.clip(-math.exp(at[1]) * (self.x - at[0]), -50, 50)))
        known = at[3:][self.kind]
        floor = at[2] * self.chance
        return floor + (1 - floor) * known * read, read, known

    def fit(self, counts: tuple[_Numbers, _Numbers], near: _Numbers | None = None) -> _Numbers:
        """Return the maximum-likelihood estimates of log threshold, log slope, guessing and knowledge."""
        from scipy.optimize import minimize  # noqa: PLC0415 - takes 0.2 s, which most commands do not need

        kinds = len(self.kinds)
        low, high = float(self.x.min()) - 0.3, float(self.x.max()) + 0.3
        bounds = [
            (low, high),
            tuple(np.log(_SLOPES)),
            (0.0, 1.0),
            *[(0.001, 0.999)] * kinds,
        ]
        starts = np.quantile(self.x, (0.05, 0.3, 0.55, 0.8))
        guesses = [np.array([s, math.log(8), 0.9, *[0.8] * kinds]) for s in starts]
        if near is not None:
            guesses = [near]
        found = [
            minimize(self._loss, guess, args=counts, jac=True, method="L-BFGS-B", bounds=bounds, options=_PRECISION)
            for guess in guesses
        ]
        best = min(found, key=lambda result: float(result.fun))
        return np.asarray(best.x, dtype=np.float64)

    def _loss(self, at: _Numbers, correct: _Numbers, total: _Numbers) -> tuple[float, _Numbers]:
        """Return the negative log-likelihood per item and its gradient."""
        rate, read, known = self._rates(at)
        n = total.sum()
        free = (rate > _LEAST_P) & (rate < 1 - _LEAST_P)
        rate = np.clip(rate, _LEAST_P, 1 - _LEAST_P)
        value = -(correct * np.log(rate) + (total - correct) * np.log(1 - rate)).sum() / n
        slope = -(correct / rate - (total - correct) / (1 - rate)) * free / n
        by_share = slope * (1 - at[2] * self.chance)
        by_threshold = by_share * known * read * (1 - read) * math.exp(at[1])
        gradient = np.empty(len(at))
        gradient[0] = -by_threshold.sum()
        gradient[1] = (by_threshold * (self.x - at[0])).sum()
        gradient[2] = (slope * self.chance * (1 - known * read)).sum()
        gradient[3:] = np.bincount(self.kind, by_share * read, len(self.kinds))
        return float(value), gradient
