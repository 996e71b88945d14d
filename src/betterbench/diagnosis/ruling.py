"""Rulings of the second pass. A ruling is a conclusion about one trial, drawn from all trials of the policy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

WORD, HABIT, LATER, PLACE, CONFUSION = "word", "habit", "later", "place", "confusion"
"""Kinds of rule that can explain a wrong first attempt. Confusion means that there is no rule."""

RuleStatus = Literal["upheld", "rejected", "open"]
"""Status of a rule for a trial.

"upheld": the rule explains the trial. "rejected": it does not. "open": another rule explains the
trials equally well.
"""


@dataclass(frozen=True, slots=True)
class Ruling:
    """Result of the second pass for one trial. It states for each kind of decision rule whether it explains the trial.

    Attributes:
        shortcut: Whether the rule "go to the slot where the word led in training" explains this trial.
        place: Whether the rule "always go to the same slot" explains this trial. The status is "open" if the run is too
            small to prove this rule for any policy.
        habit: Whether the rule "begin with the most frequent first step" may explain this trial. A single trial is
            enough evidence, unless the policy is known to begin with later steps.
    """

    shortcut: RuleStatus = "open"
    place: RuleStatus = "rejected"
    habit: RuleStatus = "upheld"

    def status(self, rule: str) -> RuleStatus:
        """Return the status of a kind of rule: it explains the trial, does not explain it, or this is undecided."""
        known = {WORD: self.shortcut, PLACE: self.place, HABIT: self.habit}
        return known.get(rule, "upheld")


ALONE = Ruling("open", "open")
"""Ruling for a trial that cannot be compared with other trials of the policy."""
