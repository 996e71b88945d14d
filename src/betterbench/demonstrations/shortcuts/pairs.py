"""Pairs of words that determine an outcome only when they occur together."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

MOST_WORDS = 200
"""Maximum number of words that are tested in pairs.

If there are more, the words that split the episodes most evenly are used.
"""

_Bools = npt.NDArray[np.bool_]
_Ints = npt.NDArray[np.int64]
_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class WordPair:
    """Two features that are associated with an outcome when they occur together. A feature is the presence of a word.

    Attributes:
        first: Index of the first feature.
        second: Index of the second feature.
        outcome: Index of the most frequent outcome among episodes with both features.
        p_value: The larger p-value of two exact tests. Each test takes the episodes with one of the features, and
            compares the frequency of the outcome with and without the other feature. The p-value is corrected for the
            number of outcomes, and by Holm's method (1979) for the number of pairs.
        gain: Increase of the outcome's frequency when the second feature is added to the first, as a fraction of the
            largest possible increase.
    """

    first: int
    second: int
    outcome: int
    p_value: float
    gain: float


def telling_pairs(presence: _Bools, outcome: _Ints, *, fewest: int) -> list[WordPair]:
    """Test all pairs of features that occur together often enough. Return the pairs in order of increasing p-value.

    A feature that occurs in exactly the episodes with two other features is left out, because it is equivalent to this
    pair of features.

    Args:
        presence: (episodes, features) mask of the features in each episode.
        outcome: (episodes,) index of each episode's outcome, from 0.
        fewest: Minimum number of episodes with both features of a pair.
    """
    kept = _elements(presence)
    counts = presence[:, kept].sum(axis=0)
    ranked = np.argsort(-np.minimum(counts, len(presence) - counts), kind="stable")[:MOST_WORDS]
    kept = kept[np.sort(ranked)]
    has = presence[:, kept].astype(np.float64)
    each = has.sum(axis=0)
    both = has.T @ has
    kinds = range(int(outcome.max()) + 1)
    each_of = np.array([has[outcome == k].sum(axis=0) for k in kinds])
    both_of = np.array([has[outcome == k].T @ has[outcome == k] for k in kinds])
    likeliest = both_of.argmax(axis=0)
    enough = (both >= fewest) & (both < each[:, None]) & (both < each[None, :])
    rows = [(int(i), int(j)) for i, j in zip(*np.nonzero(np.triu(enough, 1)), strict=True)]
    logs = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, len(presence) + 1)))])
    found = []
    for i, j in rows:
        k = int(likeliest[i, j])
        together = (int(both_of[k, i, j]), int(both[i, j]))
        alone = [(int(each_of[k, a] - both_of[k, i, j]), int(each[a] - both[i, j])) for a in (i, j)]
        p = max(_more_frequent_p(together, without, logs) for without in alone)
        usual = max(k_alone / n_alone for k_alone, n_alone in alone)
        gain = (together[0] / together[1] - usual) / (1.0 - usual) if usual < 1.0 else 0.0
        found.append(WordPair(int(kept[i]), int(kept[j]), k, min(1.0, p * len(kinds)), gain))
    return _corrected(sorted(found, key=lambda pair: (pair.p_value, pair.first, pair.second)))


def _corrected(pairs: Sequence[WordPair]) -> list[WordPair]:
    """Correct the p-values of pairs by Holm's method. The pairs are sorted by p-value."""
    corrected, least = [], 0.0
    for rank, pair in enumerate(pairs):
        least = max(least, min(1.0, pair.p_value * (len(pairs) - rank)))
        corrected.append(replace(pair, p_value=least))
    return corrected


def _elements(presence: _Bools) -> _Ints:
    """Return the indices of the features that are not equivalent to a pair of other features."""
    columns = [np.packbits(column).tobytes() for column in presence.T]
    counts = presence.sum(axis=0)
    order = np.argsort(-counts, kind="stable")[: 2 * MOST_WORDS]
    packed = np.packbits(presence.T, axis=1)
    made = set()
    for i, j in itertools.combinations(order.tolist(), 2):
        both = packed[i] & packed[j]
        if (both != packed[i]).any() and (both != packed[j]).any():
            made.add(both.tobytes())
    return np.array([i for i, column in enumerate(columns) if column not in made], dtype=np.int64)


def _more_frequent_p(with_it: tuple[int, int], without: tuple[int, int], logs: _Floats) -> float:
    """Test whether an outcome is more frequent with a feature than without it.

    Return the p-value of Fisher's exact test.

    Args:
        with_it: Number of episodes with the feature and the outcome, and number of all episodes with the feature.
        without: Number of episodes with the outcome but without the feature, and number of all episodes without the
            feature.
        logs: Logarithms of the factorials 0!, 1!, 2!, ...
    """
    (k, n), (k_out, n_out) = with_it, without
    total, successes = n + n_out, k + k_out

    def log_choose(a: int, b: int) -> float:
        return float(logs[a] - logs[b] - logs[a - b])

    whole = log_choose(total, n)
    most = min(n, successes)
    terms = [
        log_choose(successes, i) + log_choose(total - successes, n - i) - whole
        for i in range(k, most + 1)
        if n - i <= total - successes
    ]
    return min(1.0, math.fsum(math.exp(term) for term in terms))


def least_share(n: int, tests: int, level: float) -> float | None:
    """Return the smallest fraction of episodes that must follow a rule for the test of the rule to be significant.

    The rule relates a word that occurs in half of the episodes to two equally frequent outcomes. The test is Fisher's
    one-sided exact test, corrected for the number of tests (pairs times outcomes). Return None if the test is not
    significant even if all episodes follow the rule.
    """
    logs = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, n + 1)))])
    half = n // 2
    for k in range(half // 2, half + 1):
        if tests * _more_frequent_p((k, half), (half - k, half), logs) <= level:
            return k / half
    return None
