"""``zoo:progress-cue``: reads how far the task is from how many things are left on the table."""

from __future__ import annotations

from betterbench.experts.mind import Bring, Decision, Rest, at_target, choose
from betterbench.experts.zoo.rules import BrokenRule
from betterbench.state import WorldState


class ProgressCue(BrokenRule):
    """Takes a table with one thing fewer than demonstrations began with for a task whose first step is done."""

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision: the step that the count on the table stands for."""
        del history
        goal = self.goals[0]
        left = sum(
            o.role in ("item", "distractor") and not at_target(state, o.name, goal.target, goal.relation, goal.place)
            for o in state.info.objects
        )
        index = max(0, self.regime.initial_items - left)
        if index >= len(self.goals):
            return Rest()
        name = choose(self.situation, state, index)
        return (
            Rest()
            if name is None
            else Bring(name, self.goals[index].target, self.goals[index].relation, self.goals[index].place)
        )
