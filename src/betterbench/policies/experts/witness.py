"""Expert that also records which faulty rules would have made the same decisions in an episode.

A faulty rule that always makes the expert's decisions would produce a bit-identical episode. The episode of that faulty
policy then need not be simulated.
"""

from __future__ import annotations

from betterbench.interface.state import WorldState
from betterbench.policies.decisions import Decision, Situation
from betterbench.policies.faulty import BrokenRule


class Witness(BrokenRule):
    """Decision rule of the expert, which also records what other rules would decide.

    The other rules get the same states and the same history of decisions.

    Attributes:
        same: Names of the rules that have made the same decisions as the expert so far.
    """

    def __init__(self, situation: Situation, others: dict[str, BrokenRule]) -> None:
        """Create the rule for one episode.

        Args:
            situation: Facts about the trial.
            others: Rules to compare with the expert, by name, for the same trial.
        """
        super().__init__(situation)
        self._others = dict(others)

    @property
    def same(self) -> tuple[str, ...]:
        """Names of the rules that have made the same decisions as the expert so far."""
        return tuple(self._others)

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the expert's decision."""
        decision = super().decide(state, history)
        for name, rule in list(self._others.items()):
            if rule.decide(state, history) != decision:
                del self._others[name]
        return decision
