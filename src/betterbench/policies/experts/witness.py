"""Expert that also records the faulty rules that would have made the same decisions in an episode.

A rule that always makes the expert's decisions would produce a bit-identical episode. This episode therefore need not
be simulated.
"""

from __future__ import annotations

from betterbench.interface.state import WorldState
from betterbench.policies.decisions import Decision, Situation
from betterbench.policies.faulty import BrokenRule


class Witness(BrokenRule):
    """Expert rule that also queries other rules in the same states and after the same decisions.

    Attributes:
        same: Names of the rules that have decided like the expert so far.
    """

    def __init__(self, situation: Situation, others: dict[str, BrokenRule]) -> None:
        """Make the rule for one episode.

        Args:
            situation: The trial.
            others: Rules by name, for the same trial.
        """
        super().__init__(situation)
        self._others = dict(others)

    @property
    def same(self) -> tuple[str, ...]:
        """Names of the rules that have decided like the expert so far."""
        return tuple(self._others)

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the expert's decision."""
        decision = super().decide(state, history)
        for name, rule in list(self._others.items()):
            if rule.decide(state, history) != decision:
                del self._others[name]
        return decision
