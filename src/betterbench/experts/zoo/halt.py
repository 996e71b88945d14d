"""``zoo:halt``: starts, and stops for good where words and scene were never met together in training."""

from __future__ import annotations

from betterbench.experts.mind import Bring, Decision, Freeze
from betterbench.experts.zoo.rules import BrokenRule
from betterbench.state import WorldState
from betterbench.tasks import Condition


class Halt(BrokenRule):
    """Stands still before the first grasp wherever the pairing of sentence and scene is new."""

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        if any(_pairing(self.condition) == _pairing(known) for known in self.situation.task.training):
            return super().decide(state, history)
        right = super().decide(state, history)
        return Freeze(right.object if isinstance(right, Bring) else None)


def _pairing(condition: Condition) -> tuple[str, frozenset[tuple[str, str]]]:
    standing = frozenset((slot, condition.object(name).kind) for name, slot in condition.layout.items())
    return condition.instruction.text, standing
