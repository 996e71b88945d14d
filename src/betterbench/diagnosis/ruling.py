"""Rulings of the second pass over all trials of a policy on each of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

WORD, HABIT, LATER, PLACE, CONFUSION = "word", "habit", "later", "place", "confusion"
"""Kinds of rule that can explain a wrong first attempt; confusion is no rule at all."""

RuleStatus = Literal["upheld", "rejected", "open"]
"""Status of a rule for a trial: it explains the trial, does not, or too few trials separate it from another rule."""


@dataclass(frozen=True, slots=True)
class Ruling:
    """Result of the second pass for one trial: the status of each kind of rule.

    Attributes:
        shortcut: Whether "the word leads there" explains this trial.
        place: Whether "always the same place" does; "open" where the run is too small to prove it of any policy.
        habit: Whether "the most frequent first step" may; one trial shows it, unless the policy is known to begin with
            later steps.
    """

    shortcut: RuleStatus = "open"
    place: RuleStatus = "rejected"
    habit: RuleStatus = "upheld"

    def status(self, rule: str) -> RuleStatus:
        """Return the status of a kind of rule."""
        known = {WORD: self.shortcut, PLACE: self.place, HABIT: self.habit}
        return known.get(rule, "upheld")


ALONE = Ruling("open", "open")
"""The ruling on a trial that was not compared with others."""
