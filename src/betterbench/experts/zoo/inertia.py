"""``zoo:inertia``: every episode begins with the step that most demonstrations began with."""

from __future__ import annotations

from betterbench.experts.mind import Bring, Decision, GraspAt
from betterbench.experts.zoo.rules import BrokenRule
from betterbench.state import WorldState


class Inertia(BrokenRule):
    """Begins with the most frequent first step of training; where its object is gone, it plays the motion all the same.

    Where training began equally often with several kinds, the instruction chooses among them.
    """

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        if history:
            return super().decide(state, history)
        first = self.regime.first_kinds
        goal = self.goals[0]
        if len(first) > 1 and first[0][1] == first[1][1]:
            names = list(self.condition.resolve(goal.reference))
            memorised = self.regime.word_slots[goal.word]
        else:
            names = [o.name for o in state.info.of_kind(first[0][0])]
            memorised = self.regime.kind_slots[first[0][0]]
        waiting = {state.info.object(n).slot: n for n in names if state.info.object(n).slot is not None}
        if not waiting:
            return GraspAt(memorised[0])
        return Bring(waiting[min(waiting, key=str)], goal.target, goal.relation, goal.place)
