"""``zoo:inertia``: a policy that begins every episode with the most frequent first step of demonstrations."""

from __future__ import annotations

from betterbench.interface.state import WorldState
from betterbench.policies.decisions import Decision, Draw, GraspAt, Rest, bring_to, carried
from betterbench.policies.faulty.rules import BrokenRule
from betterbench.tasks import Label


class Inertia(BrokenRule):
    """Begins with the most frequent first step of training, even if its object is missing.

    If several kinds were equally frequent in training, the instruction chooses among them. When nothing is left to do,
    it executes the next step of training if the object of that step is missing.
    """

    label = Label.BEHAVIORAL_INERTIA

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        if any(not isinstance(decision, Draw) for decision in history):
            right = super().broken(state, history)
            absent = self.absent_step(state) if isinstance(right, Rest) else None
            return right if absent is None or GraspAt(absent) in history else GraspAt(absent)
        habit = self.trained.habit
        goal = next((g for g in self.goals if carried(g)), self.goals[0])
        if habit is None:
            names = list(self.condition.resolve(goal.reference))
            memorized = self.slots_of_word(goal.word)
        else:
            names = [o.name for o in state.info.of_kind(habit)]
            memorized = self.slots_of_kind(habit)
        way = self.make_way(state, goal.target)
        if way is not None:
            return way
        waiting = {state.info.object(n).slot: n for n in names if state.info.object(n).slot is not None}
        if not waiting:
            return GraspAt(memorized[0]) if memorized else super().broken(state, history)
        return bring_to(goal, waiting[min(waiting, key=str)])
