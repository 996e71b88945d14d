"""``zoo:layout``: a policy whose first pick is at the same slot in every trial, regardless of the instruction."""

from __future__ import annotations

from betterbench.interface.state import WorldState
from betterbench.policies.decisions import Decision, Draw, carried
from betterbench.policies.faulty.rules import BrokenRule
from betterbench.tasks import Label


class Layout(BrokenRule):
    """Rule that first picks at the slot from which demonstrations pick most often, then works on other subgoals."""

    label = empty_label = place_label = Label.VISUAL_LAYOUT_BIAS

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        if any(not isinstance(decision, Draw) for decision in history):
            return super().broken(state, history)
        goal = next((g for g in self.goals if carried(g)), self.goals[0])
        return self.make_way(state, goal.target) or self.take_at(state, self.trained.favorite_slot, goal)
