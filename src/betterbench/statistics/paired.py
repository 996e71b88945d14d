"""Tests for paired trials, such as a variation trial and its training twin, or two policies on the same seeds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.statistics import special


@dataclass(frozen=True, slots=True)
class PairedTable:
    """Number of pairs for each of the four possible outcomes of a pair."""

    both: int
    only_first: int
    only_second: int
    neither: int

    def __post_init__(self) -> None:
        """Raise InvalidInputError if a count is negative."""
        for name in ("both", "only_first", "only_second", "neither"):
            count = getattr(self, name)
            if count < 0:
                raise InvalidInputError(name, f"{count} is not a valid number of pairs", "Use counts ≥ 0")

    @classmethod
    def from_outcomes(cls, outcomes: Iterable[tuple[bool, bool]]) -> PairedTable:
        """Count the pairs. Each pair is given as (first succeeded, second succeeded)."""
        counts = [0, 0, 0, 0]
        for first, second in outcomes:
            counts[2 * (not first) + (not second)] += 1
        return cls(*counts)

    @property
    def n(self) -> int:
        """Number of pairs."""
        return self.both + self.only_first + self.only_second + self.neither


def exchange_p(outcomes: Sequence[tuple[bool, bool]], shared: Sequence[str]) -> float:
    """Return the two-sided p-value of an exact test for pairs, where several pairs may share the same first trial.

    Pairs with the same first trial form a group. Under the null hypothesis, the first trial of a group and its second
    trials are exchangeable. The statistic is the sum of first minus second outcomes over all pairs. Its distribution
    over all exchanges is computed exactly. With one pair per group, this is McNemar's exact test.

    Args:
        outcomes: Outcome of each pair, as (first succeeded, second succeeded).
        shared: Name of each pair's first trial.

    Returns:
        Twice the smaller tail probability, at most 1.

    Raises:
        InvalidInputError: If the number of names differs from the number of pairs, or if the same first trial is given
            with two different outcomes.
    """
    if len(outcomes) != len(shared):
        raise InvalidInputError("shared", f"{len(shared)} names for {len(outcomes)} pairs", "Pass one name per pair")
    groups: dict[str, tuple[bool, list[bool]]] = {}
    for (first, second), name in zip(outcomes, shared, strict=True):
        known, seconds = groups.setdefault(name, (first, []))
        if known is not first:
            raise InvalidInputError(
                "outcomes",
                f"the first trial {name} has succeeded in one pair and failed in another",
                "Use the same outcome of a first trial in all its pairs",
            )
        seconds.append(second)
    chances = {0: 1.0}
    observed = 0
    for first, seconds in groups.values():
        size, total = len(seconds) + 1, sum(seconds) + first
        # Sum of first minus second outcomes. The first trial is one of `size` trials, of which `total` succeeded.
        steps = ((size - total, total / size), (-total, 1.0 - total / size))
        observed += steps[0][0] if first else steps[1][0]
        drawn: dict[int, float] = {}
        for value, chance in chances.items():
            for step, share in steps:
                if share > 0.0:
                    drawn[value + step] = drawn.get(value + step, 0.0) + chance * share
        chances = drawn
    tails = (
        sum(chance for value, chance in chances.items() if value <= observed),
        sum(chance for value, chance in chances.items() if value >= observed),
    )
    return min(1.0, 2.0 * min(tails))


def mcnemar_p(table: PairedTable) -> float:
    """Return the two-sided p-value of McNemar's exact test (1947).

    If the two rates are equal, each discordant pair is equally likely to favor the first or the second. The p-value is
    twice the smaller tail of a binomial distribution with probability 1/2, at most 1. Concordant pairs carry no
    information.

    Returns:
        The p-value, or 1.0 if no pair is discordant.
    """
    discordant = table.only_first + table.only_second
    smaller = min(table.only_first, table.only_second)
    return min(1.0, 2.0 * float(special.bdtr(smaller, discordant, 0.5)))
