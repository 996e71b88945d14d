"""Rulings of the second pass: conclusions about a trial from all trials of the policy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

WORD, HABIT, LATER, PLACE, CONFUSION = "word", "habit", "later", "place", "confusion"
"""Kinds of rule that can explain a wrong first attempt. Confusion is the absence of a rule."""

RuleStatus = Literal["upheld", "rejected", "open"]
"""Status of a rule for a trial: the rule explains the trial, does not explain it, or cannot be distinguished from
another rule.
"""


@dataclass(frozen=True, slots=True)
class Ruling:
    """Result of the second pass for a trial, with the status of each kind of rule.

    Attributes:
        shortcut: Whether "the word leads there" explains this trial.
        place: Whether "always the same slot" explains this trial. It is "open" if the run is too small to prove this
            rule for any policy.
        habit: Whether "the most frequent first step" may explain this trial. A single trial is enough evidence, unless
            the policy is known to begin with later steps.
    """

    shortcut: RuleStatus = "open"
    place: RuleStatus = "rejected"
    habit: RuleStatus = "upheld"

    def status(self, rule: str) -> RuleStatus:
        """Return the status of one kind of rule."""
        known = {WORD: self.shortcut, PLACE: self.place, HABIT: self.habit}
        return known.get(rule, "upheld")


ALONE = Ruling("open", "open")
"""Ruling for a trial that cannot be compared with other trials."""
