"""``zoo:progress-cue``: a policy that infers its progress from the number of objects left on the table."""

from __future__ import annotations

from betterbench.interface.state import WorldState
from betterbench.policies.decisions import Decision, Rest, at_target, carried
from betterbench.policies.faulty.rules import BrokenRule
from betterbench.tasks import Label


class ProgressCue(BrokenRule):
    """Rule that considers a step done whenever one object fewer is on the table than at the start of demonstrations."""

    label = Label.CAUSAL_CONFUSION

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the decision for the step that corresponds to the number of objects on the table."""
        del history
        left = sum(
            o.role in ("item", "distractor")
            and not any(at_target(state, o.name, g.target, g.relation, g.region) for g in self.goals)
            for o in state.info.objects
        )
        index = max(0, self.trained.initial_items - left)
        steps = [i for i, goal in enumerate(self.goals) if carried(goal)]
        if index >= len(steps):
            closing = [i for i, goal in enumerate(self.goals) if not carried(goal)]
            waiting = [i for i in closing if self.bring(state, i) in self.right_decisions(state)]
            return self.bring(state, waiting[0]) if waiting else Rest()
        return self.bring(state, steps[index])
