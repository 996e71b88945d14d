"""Favorite kind of object of a policy, in a world whose tasks never share a scene.

In our own scenes trials that differ in the instruction alone show whether it is used
(:mod:`betterbench.diagnosis.instruction_effect`). In LIBERO every task has a scene of its own, so there are no such
pairs; but the same kinds of objects stand in many scenes of a suite. A policy that takes the milk in each scene that
holds one, regardless of the instruction, does not choose by the instruction there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from betterbench.diagnosis.thresholds import LEAST_ASKED, LEAST_PAIRS, LEVEL, USED
from betterbench.diagnosis.trial import Choice
from betterbench.statistics import Rate
from betterbench.statistics.unpaired import binomial_probabilities


@dataclass(frozen=True, slots=True)
class FavoriteThing:
    """Kind of object that a policy goes for in every scene that holds one.

    Attributes:
        kind: The kind.
        rate: Trials that begin with an attempt at it, of those in which one stands and something else is asked for.
        asked: Number of other kinds that these trials ask for.
    """

    kind: str
    rate: Rate
    asked: int

    def words(self) -> str:
        """Return the sentence that counts the trials."""
        return (
            f"Where a thing of the kind {self.kind!r} stands and something else is asked for ({self.asked} different "
            f"things), the first attempt is at it in {self.rate.k} of {self.rate.n} trials."
        )

    def finding(self, suite: str) -> str:
        """Return the finding of a suite."""
        low, high = 100 * self.rate.low, 100 * self.rate.high
        return (
            f"{suite}: It goes for the {self.kind} wherever one stands, whatever the instruction says: in "
            f"{self.rate.k} of {self.rate.n} trials that ask for {self.asked} other things (95 % interval {low:.0f} to "
            f"{high:.0f} %)."
        )


def favorite_thing(choices: Mapping[str, Choice]) -> FavoriteThing | None:
    """Return the kind of object that a policy goes for in every scene of a suite that holds one, or None if not proven.

    It has to be asked for other things in :data:`LEAST_PAIRS` trials where
    one stands, :data:`LEAST_ASKED` kinds in all, and to go for it more often than a policy that picks one of two things
    at random (exact binomial test, one-sided, corrected for the kinds that it wrongly went for).
    """
    wrong = Counter(c.thing for c in choices.values() if c.thing and not c.correct)
    if not wrong:
        return None
    kind = max(sorted(wrong), key=lambda k: wrong[k])
    elsewhere = [c for c in choices.values() if _asks_for_another(c, kind)]
    asked = {frozenset(k for slot, k in c.layout if slot in c.right) for c in elsewhere}
    rate = Rate(sum(c.thing == kind for c in elsewhere), len(elsewhere))
    if rate.n < LEAST_PAIRS or len(asked) < LEAST_ASKED:
        return None
    p = float(binomial_probabilities(rate.n, USED)[rate.k :].sum())
    return FavoriteThing(kind, rate, len(asked)) if p * len(wrong) < LEVEL else None


def _asks_for_another(choice: Choice, kind: str) -> bool:
    """Tell whether an object of a kind stands in the scene of a trial that asks for another kind."""
    standing = {slot for slot, k in choice.layout if k == kind}
    return bool(standing) and bool(choice.right) and not standing & choice.right
