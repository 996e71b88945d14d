"""Sensitivity of a shortcut audit: the smallest rule that it would have found with the given number of demonstrations.

The sensitivity is estimated by planting artificial rules in the data. Planted data have the same frequencies of words
and outcomes as the real data, so the same permutations, correction and threshold apply. In a fraction of the
demonstrations, the word or object determines the outcome. In all others, the outcome is random. The result is the
smallest fraction at which the rule is found often enough.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from betterbench.demonstrations.shortcuts.association import (
    PERMUTATIONS,
    Association,
    PermutationTest,
    codes_of,
    counts_log_counts,
    joint_counts,
    random_orders,
    shuffled_inside,
)

POWER = 0.8
"""Fraction of planted data sets in which the audit must find a rule."""
REPLICATES = 400
"""Number of planted data sets for each size of a rule."""
_ENOUGH = POWER + 1.645 * math.sqrt(POWER * (1.0 - POWER) / REPLICATES)
"""Minimum fraction of the planted data sets in which the audit must find a rule.

The true fraction is then at least :data:`POWER` with 95 % confidence.
"""
STEPS = 20
"""Number of sizes that are tried: rules that decide 1/20, 2/20, ... of the demonstrations."""
_MOST_WORDS = 20
"""Maximum number of different word frequencies that are tried."""
_CHUNK = 2_000_000
"""Maximum number of values that are planted in one batch, to bound the memory."""

_Bools = npt.NDArray[np.bool_]
_Ints = npt.NDArray[np.int64]
_Floats = npt.NDArray[np.float64]

Certain = Callable[[_Ints], _Bools]
"""Function that takes joint counts (tables, nx, ny) and returns a mask of the tables in which a weak association is
reported, because one value always occurs with the same other value.
"""


@dataclass(frozen=True, slots=True)
class RuleCounts:
    """Criterion for reporting a significant association.

    Attributes:
        strong: Minimum strength at which every significant association is reported.
        certain: Function that decides whether a weaker association is reported.
    """

    strong: float
    certain: Certain


@dataclass(frozen=True, slots=True)
class SmallestRule:
    """Smallest rule that the audit would have found when it tested a question.

    Attributes:
        question: Question name.
        title: The question in words.
        n: Number of compared demonstrations, or of compared observations within demonstrations.
        noun: Noun for the counted items, such as "demonstrations".
        least_share: Minimum fraction of the outcomes that a rule must determine to be found in at least the fraction
            :data:`POWER` of all data sets with these counts. The other outcomes are random. None if not even a rule
            without exceptions would be found.
        strong_share: The same fraction if the rule must only be strong and need not be significant. ``least_share``
            approaches this value as the number of demonstrations increases.
        sentence: Sentence that explains ``least_share``.
    """

    question: str
    title: str
    n: int
    noun: str
    least_share: float | None
    strong_share: float | None
    sentence: str

    @property
    def too_few(self) -> bool:
        """Whether some strong rules would be missed because there are too few demonstrations.

        A difference of one step of the search grid is ignored.
        """
        if self.least_share is None:
            return True
        return self.strong_share is not None and self.least_share - self.strong_share > 1.5 / STEPS


def smallest_rule(
    question: str, title: str, n: int, noun: str, shares: tuple[float | None, float | None]
) -> SmallestRule:
    """Create the smallest rule for a question, with the sentence that explains it.

    Args:
        question: Question name.
        title: The question in words.
        n: Number of compared demonstrations or observations.
        noun: Noun for the counted items, such as "demonstrations".
        shares: Fractions ``least_share`` and ``strong_share``.
    """
    return SmallestRule(question, title, n, noun, *shares, f"{title}: {said_of(shares[0], f'{n} {noun}')}")


def said_of(share: float | None, of: str) -> str:
    """Return a sentence that states which rules the audit would have found.

    Args:
        share: Minimum fraction of the outcomes that a rule must determine so that the audit finds it; None if the audit
            would not find any rule.
        of: Number and noun of the compared items, such as "24 demonstrations".
    """
    if share is None:
        return f"with {of}, not even a rule without exceptions would be found"
    if share >= 1.0:
        return f"with {of}, only a rule without exceptions would be found"
    return f"with {of}, a rule would be found if it decides at least {100.0 * share:.0f} % of them"


def most_permutations(level: float, tests: int) -> int:
    """Return the maximum number of permutations that exceed the data in a significant test.

    A permutation exceeds the data if it has at least as much mutual information. The result is negative if no test can
    be significant, because the smallest possible p-value times ``tests`` exceeds the level.
    """
    least = 1.0 / (1 + PERMUTATIONS)
    most = int(level / (least * tests)) + 1
    while most >= 0 and round((1 + most) * least * tests, 6) > level:
        most -= 1
    return most


@dataclass(frozen=True, slots=True)
class Planted:
    """Data of a question, used to make data sets with an artificial rule.

    Attributes:
        y: (n,) outcome of each observation.
        perfect: (n,) values of the first variable, rearranged so that they determine the outcomes as far as the counts
            allow.
        block: (n,) index of the unit that each observation belongs to. A unit is usually a demonstration. A rule
            determines all observations of a unit or none.
        sizes: Number of distinct values of the first variable, and of the second.
        within: Whether the first variable's values are permuted within units instead of between units.
        null: (PERMUTATIONS,) mutual information of each permutation [bit].
        expected: Mutual information expected by chance [bit].
    """

    y: _Ints
    perfect: _Ints
    block: _Ints
    sizes: tuple[int, int]
    within: bool
    null: _Floats
    expected: float

    def rows(self, share: float, rows: int, draw: np.random.Generator) -> _Ints:
        """Return data sets with a planted rule that determines a fraction of the units. The other units are random.

        Args:
            share: Fraction of the units that the rule determines.
            rows: Number of data sets to make.
            draw: Random generator.

        Returns:
            Values of the first variable, as a (rows, n) array.
        """
        units = int(self.block.max()) + 1
        free = units - round(share * units)
        chosen = random_orders(draw, rows, units)[:, :free]
        if self.within:
            by_chance = np.zeros((rows, units), dtype=np.bool_)
            np.put_along_axis(by_chance, chosen, values=True, axis=1)
            return np.where(
                by_chance[:, self.block], shuffled_inside(self.perfect, self.block, rows, draw), self.perfect
            )
        values = self.perfect[np.unique(self.block, return_index=True)[1]]
        each = np.tile(values, (rows, 1))
        each[np.arange(rows)[:, None], np.sort(chosen, axis=1)] = values[chosen]
        return each[:, self.block]

    def threshold(self, level: float, tests: int) -> float:
        """Return the mutual information [bit] above which the corrected p-value is at most ``level``."""
        most = most_permutations(level, tests)
        if most < 0:
            return math.inf
        place = len(self.null) - 1 - most
        return float(np.partition(self.null, place)[place])

    def share_found(self, share: float, threshold: float, counts: RuleCounts, draw: np.random.Generator) -> float:
        """Return the fraction of data sets with a planted rule in which the audit finds this rule.

        Args:
            share: Fraction of the units that the rule determines.
            threshold: Mutual information above which a test is significant [bit].
            counts: Criterion for reporting a significant association.
            draw: Random generator.
        """
        replicates = 1 if share >= 1.0 else REPLICATES
        at_once = max(1, _CHUNK // max(len(self.y), self.sizes[0] * self.sizes[1]))
        found = 0
        for start in range(0, replicates, at_once):
            joint = joint_counts(self.rows(share, min(at_once, replicates - start), draw), self.y, self.sizes)
            bits, smaller = _bits(joint)
            room = smaller - self.expected
            strength = np.where(room > 1e-9, (bits - self.expected) / np.maximum(room, 1e-9), 0.0)
            significant = bits - 1e-9 > threshold
            strong = strength >= counts.strong
            found += int((significant & strong).sum())
            found += int(counts.certain(joint[significant & ~strong]).sum())
        return found / replicates

    def least_share(self, threshold: float, counts: RuleCounts, draw: np.random.Generator) -> float | None:
        """Return the smallest fraction of the units that a rule must determine so that the audit finds it.

        Return None if no rule is found.
        """
        if self.share_found(1.0, threshold, counts, draw) < 1.0:
            return None
        units = int(self.block.max()) + 1
        # If a single unit is random, no values are exchanged, so the rule would have no exception.
        decided = {round(step / STEPS * units) for step in range(STEPS + 1)} - ({0, units - 1} if units > 1 else {0})
        shares = [number / units for number in sorted(decided)]
        # The share at index low is too small, and the share at index high is large enough.
        low, high = -1, len(shares) - 1
        while high - low > 1:
            middle = (low + high) // 2
            enough = self.share_found(shares[middle], threshold, counts, draw) >= _ENOUGH
            low, high = (low, middle) if enough else (middle, high)
        return round(shares[high], 2)


def planted_question(test: PermutationTest) -> Planted:
    """Rearrange the data of a question so that the first variable determines the second variable as far as possible."""
    perfect = _matched_inside(test) if test.within else _matched_between(test)
    return Planted(test.y, perfect, test.block, test.sizes, test.within, test.null, test.found.expected_bits)


def planted_word(presence: _Bools, outcome: Sequence[Hashable], found: Sequence[Association], null: _Floats) -> Planted:
    """Rearrange the data of a question about words so that the most informative word determines the outcome.

    Args:
        presence: (episodes, words) mask of the words that each episode's instruction contains.
        outcome: Outcome of each episode.
        found: Association found for each word.
        null: (PERMUTATIONS,) largest mutual information of any word in each permutation [bit].
    """
    y, kinds = codes_of(outcome)
    counts = presence.sum(axis=0)
    # Try only one word for each frequency.
    first = {int(count): i for i, count in reversed(list(enumerate(counts)))}
    even = sorted(first, key=lambda count: (abs(2 * count - len(y)), count))[:_MOST_WORDS]
    block = np.arange(len(y))
    best: tuple[float, _Ints, int] | None = None
    for count in even:
        x = np.repeat(np.array([1, 0]), [count, len(y) - count])
        bits, perfect = _best_order(x, [(int(v),) for v in y], lambda x: x, y, (2, kinds))
        if best is None or bits > best[0] + 1e-9:
            best = bits, perfect, first[count]
    assert best is not None, "a question about words has words"  # noqa: S101 - narrows the type
    return Planted(y, best[1], block, (2, kinds), False, null, found[best[2]].expected_bits)


def _matched_between(test: PermutationTest) -> _Ints:
    """Exchange the values of the first variable between demonstrations so that they predict the outcomes best."""
    units = int(test.block.max()) + 1
    x = test.x[np.unique(test.block, return_index=True)[1]]
    ranked = np.argsort(-np.bincount(x, minlength=test.sizes[0]), kind="stable")
    place = np.argsort(ranked)
    x = x[np.argsort(place[x], kind="stable")]
    outcomes: list[list[int]] = [[] for _ in range(units)]
    for unit, value in zip(test.block.tolist(), test.y.tolist(), strict=True):
        outcomes[unit].append(value)
    told = [tuple(sorted(values)) for values in outcomes]
    return _best_order(x, told, lambda each: each[test.block], test.y, test.sizes)[1]


def _best_order(
    x: _Ints,
    outcomes: Sequence[tuple[int, ...]],
    spread: Callable[[_Ints], _Ints],
    y: _Ints,
    sizes: tuple[int, int],
) -> tuple[float, _Ints]:
    """Assign sorted values of the first variable to sorted outcomes so that the mutual information is maximized.

    The outcomes are sorted by frequency. Several of the most frequent outcomes are tried in the first position.

    Args:
        x: (units,) sorted values of the first variable.
        outcomes: Outcomes of each unit.
        spread: Function that expands an array with one value per unit to one value per observation.
        y: (n,) outcome of each observation.
        sizes: Number of distinct values of the first variable, and of the second.

    Returns:
        Mutual information [bit], and the value of the first variable in each observation.
    """
    frequent = Counter(outcomes)
    kinds = sorted(frequent, key=lambda kind: (-frequent[kind], kind))
    best, found = -1.0, spread(x)
    for turn in range(min(len(kinds), _MOST_WORDS)):
        rank = {kind: i for i, kind in enumerate([*kinds[turn:], *kinds[:turn]])}
        each = np.empty(len(x), dtype=np.int64)
        each[np.argsort(np.array([rank[told] for told in outcomes]), kind="stable")] = x
        values = spread(each)
        bits = float(_bits(joint_counts(values[None, :], y, sizes))[0][0])
        if bits > best + 1e-9:
            best, found = bits, values
    return best, found


def _matched_inside(test: PermutationTest) -> _Ints:
    """Permute the values of the first variable within each demonstration so that all demonstrations follow one rule."""

    def by_count(values: _Ints, size: int) -> list[int]:
        return list(map(int, np.argsort(-np.bincount(values, minlength=size), kind="stable")))

    firsts, seconds = by_count(test.x, test.sizes[0]), by_count(test.y, test.sizes[1])
    partner = dict(zip(seconds, firsts, strict=False))
    perfect = test.x.copy()
    order = np.argsort(test.block, kind="stable")
    for rows in np.split(order, np.cumsum(np.bincount(test.block))[:-1]):
        left = sorted(test.x[rows].tolist(), key=firsts.index)
        open_rows = []
        for row in rows.tolist():
            wanted = partner.get(int(test.y[row]), -1)
            if wanted in left:
                left.remove(wanted)
                perfect[row] = wanted
            else:
                open_rows.append(row)
        for row, value in zip(sorted(open_rows, key=lambda r: seconds.index(int(test.y[r]))), left, strict=True):
            perfect[row] = value
    return perfect


def _bits(joint: _Ints) -> tuple[_Floats, _Floats]:
    """Return the mutual information of joint counts (rows, nx, ny) and the smaller of their two entropies [bit]."""
    n = int(joint[0].sum())
    logs = counts_log_counts(n)
    first, second = (logs[joint.sum(axis=axis)].sum(axis=1) for axis in (2, 1))
    bits = np.maximum(0.0, (logs[joint].sum(axis=(1, 2)) + logs[n] - first - second) / n)
    return bits, (logs[n] - np.maximum(first, second)) / n


def shares_line(rules: Iterable[SmallestRule]) -> str:
    """List the questions on one line, grouped by their smallest rule.

    Questions for which the audit could not have found any rule come first.
    """
    groups: dict[float | None, list[str]] = {}
    for rule in rules:
        groups.setdefault(rule.least_share, []).append(rule.title)
    ranked = sorted(groups.items(), key=lambda item: -2.0 if item[0] is None else -item[0])
    return "; ".join(f"{share_text(share)}: {', '.join(titles)}" for share, titles in ranked)


def share_text(share: float | None) -> str:
    """Format a fraction for a table, e.g. "85 %". If no rule would be found, return "none, however strong"."""
    return "none, however strong" if share is None else f"{100.0 * share:.0f} %"
