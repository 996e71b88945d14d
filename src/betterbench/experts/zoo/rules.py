"""Facts that several broken rules share: what stands where, and which step comes next."""

from __future__ import annotations

from betterbench.experts.mind import Bring, Decision, ExpertMind, GraspAt, Situation
from betterbench.geometry import horizontal_distance
from betterbench.state import WorldState
from betterbench.tasks import Regime, Subgoal, regime_of

STANDS_WITHIN_M = 0.06
"""Distance from a slot within which an object counts as standing in it: the jitter and a small push."""


class BrokenRule(ExpertMind):
    """A mind that decides like the expert except where its one broken rule speaks."""

    def __init__(self, situation: Situation) -> None:
        """Prepare for an episode."""
        super().__init__(situation)
        self.regime: Regime = regime_of(situation.task)
        self.condition = situation.condition
        self.goals = situation.condition.instruction.subgoals

    def standing_in(self, state: WorldState, slot: str) -> str | None:
        """Return the movable object that stands in a slot now, or None."""
        place = state.info.slot(slot).position
        near = [
            (horizontal_distance(state.pose(o.name).position, place), o.name)
            for o in state.info.objects
            if not o.fixed and o.role in ("item", "distractor")
        ]
        near = [entry for entry in near if entry[0] < STANDS_WITHIN_M]
        return min(near)[1] if near else None

    def take_at(self, state: WorldState, slot: str, goal: Subgoal | None = None) -> Decision:
        """Return the decision to take whatever stands in a slot, or to grasp at it if nothing does.

        Args:
            state: State now.
            slot: The slot.
            goal: Where to bring it; the first subgoal's place if not given.
        """
        name = self.standing_in(state, slot)
        goal = self.goals[0] if goal is None else goal
        return GraspAt(slot) if name is None else Bring(name, goal.target, goal.relation, goal.place)
