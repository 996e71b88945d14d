"""Pairs of trials: a trial and its counterfactual twin, or two policies on the same seeds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.statistics import special


@dataclass(frozen=True, slots=True)
class PairedTable:
    """Counts of the four kinds of pairs."""

    both: int
    only_first: int
    only_second: int
    neither: int

    def __post_init__(self) -> None:
        """Refuse negative counts."""
        for name in ("both", "only_first", "only_second", "neither"):
            count = getattr(self, name)
            if count < 0:
                raise InvalidInputError(name, f"{count} is not a number of pairs", "Give counts of at least 0")

    @classmethod
    def from_outcomes(cls, outcomes: Iterable[tuple[bool, bool]]) -> PairedTable:
        """Count pairs given as (first succeeded, second succeeded)."""
        counts = [0, 0, 0, 0]
        for first, second in outcomes:
            counts[2 * (not first) + (not second)] += 1
        return cls(*counts)

    @property
    def n(self) -> int:
        """Number of pairs."""
        return self.both + self.only_first + self.only_second + self.neither


def mcnemar_p(table: PairedTable) -> float:
    """Return the two-sided p-value of the exact test of McNemar (1947).

    If the two rates are equal, each discordant pair is equally likely to favor either side. The p-value is twice
    the smaller tail of that fair binomial, at most 1; concordant pairs carry no information.

    Returns:
        The p-value, 1.0 when no pair is discordant.
    """
    discordant = table.only_first + table.only_second
    smaller = min(table.only_first, table.only_second)
    return min(1.0, 2.0 * float(special.bdtr(smaller, discordant, 0.5)))
