"""Rulings: what the second pass over all trials of a policy says about one of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

WORD, HABIT, PLACE, CONFUSION = "word", "habit", "place", "confusion"
"""Kinds of rule that can explain a wrong first attempt; confusion is no rule at all."""

RuleStatus = Literal["upheld", "rejected", "open"]
"""Whether a rule explains a trial, does not, or cannot be told from another for lack of trials."""


@dataclass(frozen=True, slots=True)
class Ruling:
    """What the second pass says about one trial.

    Attributes:
        place: Whether "always the same place" is upheld and explains this trial.
    """

    shortcut: RuleStatus = "open"
    place: bool = False

    def status(self, rule: str) -> RuleStatus:
        """Return the status of a kind of rule; the habit needs no ruling, because one trial shows it."""
        if rule == WORD:
            return self.shortcut
        return "rejected" if rule == PLACE and not self.place else "upheld"


ALONE = Ruling()
"""The ruling on a trial that was not compared with others."""
