"""Test for a policy's favorite kind of object, for simulated worlds in which every task has its own scene.

In betterbench's own scenes, trials that differ only in the instruction show whether the policy uses it
(:mod:`betterbench.diagnosis.instruction_effect`). In LIBERO, every task has its own scene, so there are no such pairs
of trials. However, the same kinds of objects occur in many scenes of a suite. A policy that goes for the milk in every
scene with milk does not use the instruction.
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
    """Kind of object that a policy goes for in every scene that contains it.

    Attributes:
        kind: The favorite kind of object.
        rate: Fraction of trials that begin with an attempt at this kind. Only trials that have this kind in the scene
            but name another kind in the instruction are counted.
        asked: Number of different kinds that are named by the instructions of these trials.
    """

    kind: str
    rate: Rate
    asked: int

    def words(self) -> str:
        """Return a sentence that states in how many trials the policy attempts its favorite kind of object first."""
        return (
            f"In scenes with an object of kind {self.kind!r} and a request for another kind ({self.asked} kinds in "
            f"total), the first attempt is at the {self.kind} in {self.rate.k} of {self.rate.n} trials."
        )

    def finding(self, suite: str) -> str:
        """Return the sentence that reports the favorite kind of object for a suite."""
        low, high = 100 * self.rate.low, 100 * self.rate.high
        return (
            f"{suite}: It goes for the {self.kind} in every scene that contains it, regardless of the instruction: in "
            f"{self.rate.k} of {self.rate.n} trials whose instructions name {self.asked} other kinds "
            f"(95 % interval {low:.0f} to {high:.0f} %)."
        )


def favorite_thing(choices: Mapping[str, Choice]) -> FavoriteThing | None:
    """Return the kind of object that a policy provably goes for in every scene that contains it, or None.

    At least :data:`LEAST_PAIRS` trials must have such an object in the scene while their instruction names another
    kind. These instructions must name at least :data:`LEAST_ASKED` kinds in total. The policy must attempt its favorite
    kind more often than a policy that picks one of two objects at random. This is tested with an exact one-sided
    binomial test. Its p-value is corrected for the number of kinds that the policy wrongly attempted.
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
    """Return whether a trial's scene contains an object of the given kind while its instruction names another kind."""
    standing = {slot for slot, k in choice.layout if k == kind}
    return bool(standing) and bool(choice.right) and not standing & choice.right
