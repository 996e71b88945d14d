"""``zoo:lexical``: a policy in which each word of the instruction triggers the motion learned for that word."""

from __future__ import annotations

from betterbench.interface.state import WorldState
from betterbench.policies.decisions import Bring, Decision, GraspAt, Rest, carried, open_subgoal
from betterbench.policies.faulty.rules import BrokenRule
from betterbench.tasks import Label


class Lexical(BrokenRule):
    """Rule that picks, for each word of the instruction, at the slot that training associates with that word.

    If training associates several slots with a word, the policy uses one that contains an object.
    """

    label = place_label = Label.LEXICAL_KINEMATIC_SHORTCUT

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the decision to pick at the slot that training associates with the next word of the instruction.

        Each word is used once.
        """
        index = open_subgoal(state, self.condition)
        if index is not None and not carried(self.goals[index]):
            return super().broken(state, history)
        goals = [goal for goal in self.goals if carried(goal)]
        step = sum(isinstance(decision, Bring | GraspAt) for decision in history)
        if step >= len(goals):
            return Rest()
        goal = goals[step]
        places = self.slots_of_word(goal.word)
        if not places:
            return super().broken(state, history)
        earlier = sum(other.word == goal.word for other in goals[:step])
        filled = [slot for slot in places if self.standing_in(state, slot) is not None] or list(places)
        way = self.make_way(state, goal.target)
        return way or self.take_at(state, filled[0 if len(filled) <= earlier else earlier], goal)
