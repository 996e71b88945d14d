"""``zoo:inertia``: a policy that starts as most demonstrations do, and continues after each step as they do."""

from __future__ import annotations

from betterbench.interface.state import WorldState
from betterbench.policies.decisions import Decision, Draw, GraspAt, Rest, bring_to, carried
from betterbench.policies.faulty.rules import BrokenRule
from betterbench.tasks import Label


class Inertia(BrokenRule):
    """Rule that first does what most demonstrations do first, and executes the next step even if its object is missing.

    The paper describes two kinds of demonstrations. In the first kind, the demonstrations combine steps in several ways
    (A to B, A to C). The policy then begins with the most frequent first step even if the object for this step is
    missing. If several first steps are equally frequent, the instruction selects one of them. In the second kind, all
    demonstrations show one fixed sequence, in which a finished step triggers the next step. The policy then begins with
    the first step only if the object for this step is still on the table.

    When the instruction is completed, the policy also attempts the step that comes next in the demonstrations if the
    object for that step is missing. It then grasps at the empty slot of the object.
    """

    label = Label.BEHAVIORAL_INERTIA

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        if all(isinstance(decision, Draw) for decision in history):
            first = self._first(state)
            if first is not None:
                return first
        right = super().broken(state, history)
        absent = self.absent_step(state) if isinstance(right, Rest) else None
        return right if absent is None or GraspAt(absent) in history else GraspAt(absent)

    def _first(self, state: WorldState) -> Decision | None:
        """Return the decision for the most frequent first step in training, or None if it does not apply here."""
        habit = self.trained.habit
        goal = next((g for g in self.goals if carried(g)), self.goals[0])
        if habit is None:
            names = list(self.condition.resolve(goal.reference))
            memorized = self.slots_of_word(goal.word)
        else:
            names = [o.name for o in state.info.of_kind(habit)]
            memorized = self.slots_of_kind(habit)
        waiting = {state.info.object(n).slot: n for n in names if state.info.object(n).slot is not None}
        if self.trained.fixed_sequence is not None and not waiting:
            return None
        way = self.make_way(state, goal.target)
        if way is not None:
            return way
        if not waiting:
            return GraspAt(memorized[0]) if memorized else None
        return bring_to(goal, waiting[min(waiting, key=str)])
