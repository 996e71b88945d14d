"""``zoo:colour``: any object of the right colour will do."""

from __future__ import annotations

from betterbench.experts.mind import Bring, Decision, Rest, open_subgoal
from betterbench.experts.zoo.rules import BrokenRule
from betterbench.state import WorldState


class Colour(BrokenRule):
    """Looks for the colour of what is asked for, first where training picked it."""

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        del history
        index = open_subgoal(state, self.condition)
        if index is None:
            return Rest()
        right = self.bring(state, index)
        goal = self.goals[index]
        if not isinstance(right, Bring) or goal.reference.kind is None:
            return right
        colour = state.info.object(right.object).colour
        for slot in self.regime.word_slots[goal.word]:
            name = self.standing_in(state, slot)
            if name is not None and state.info.object(name).colour == colour:
                return Bring(name, goal.target, goal.relation, goal.place)
        return right
