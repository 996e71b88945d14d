"""``zoo:reorder``, ``zoo:repeat``, ``zoo:sequence`` and ``zoo:habit-place``: policies that choose wrong steps.

Their motions are as good as the expert's.
"""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import replace

from betterbench.interface.state import WorldState
from betterbench.policies.decisions import (
    Bring,
    Decision,
    GraspAt,
    Rest,
    at_target,
    carried,
    choose,
    open_subgoal,
    open_subgoals,
)
from betterbench.policies.faulty.rules import BrokenRule
from betterbench.tasks import Label
from betterbench.tasks.relations import relation as relation_named


class Reorder(BrokenRule):
    """Rule that executes the second of two steps before the first if the instruction prescribes their order."""

    label = Label.ORDER_VIOLATION

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        right = super().broken(state, history)
        index = open_subgoal(state, self.condition)
        if history or not self.condition.instruction.ordered or index is None or not isinstance(right, Bring):
            return right
        for later in range(index + 1, len(self.goals)):
            decision = self.bring(state, later)
            if isinstance(decision, Bring) and decision.object not in self.condition.resolve(
                self.goals[index].reference
            ):
                # The object is put where the object of the replaced step belongs, for example on the bare bun, not in
                # mid-air.
                return replace(decision, region=right.region) if relation_named(right.relation).counted else decision
        return right

    def _label_of(self, state: WorldState, history: tuple[Decision, ...], decision: Decision) -> Label | None:
        """Return the label of a wrong decision.

        The label is ``behavioral_inertia`` if most demonstrations began with the later step.
        """
        label = super()._label_of(state, history, decision)
        if label == self.label and isinstance(decision, Bring):
            is_habit = state.info.object(decision.object).kind == self.trained.habit
            return Label.BEHAVIORAL_INERTIA if is_habit else label
        return label


class Repeat(BrokenRule):
    """Rule that repeats a finished step before it continues with the next step."""

    label = Label.CAUSAL_CONFUSION

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        right = super().broken(state, history)
        brought = [decision for decision in history if isinstance(decision, Bring)]
        if len(brought) != 1 or open_subgoal(state, self.condition) is None:
            return right
        last = brought[0]
        goal = next((g for g in self.goals if last.object in self.condition.resolve(g.reference)), None)
        if goal is None or not at_target(state, last.object, last.target, last.relation, last.region):
            return right
        again = [n for n in self.condition.resolve(goal.reference) if n != last.object] or [last.object]
        return replace(last, object=again[0])


class Sequence(BrokenRule):
    """Rule that executes, after the first step, the step that came next in training, even if it was not requested."""

    label = Label.CAUSAL_CONFUSION

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        right = super().broken(state, history)
        brought = [decision for decision in history if isinstance(decision, Bring)]
        if len(brought) != 1 or len(brought) != len(history):
            return right
        before = state.info.object(brought[0].object).kind
        follows: Counter[str] = Counter()
        for sequence in self.trained.sequences:
            follows.update(b for a, b in itertools.pairwise(sequence) if a == before)
        asked = [self.condition.resolve(self.goals[i].reference) for i in open_subgoals(state, self.condition)]
        if not follows or any(state.info.object(n).kind in follows for names in asked for n in names):
            return right
        kind = min(follows, key=lambda k: (-follows[k], k))
        goal = right if isinstance(right, Bring) else brought[0]
        for o in state.info.of_kind(kind):
            if o.slot is not None and self.standing_in(state, o.slot) == o.name:
                return replace(goal, object=o.name)
        return GraspAt(self.trained.kind_slots[kind][0]) if self.trained.kind_slots.get(kind) else right

    def _label_of(self, state: WorldState, history: tuple[Decision, ...], decision: Decision) -> Label | None:
        label = super()._label_of(state, history, decision)
        if label != self.label or not isinstance(decision, Bring):
            return label
        if not any(decision.object in self.condition.resolve(g.reference) for g in self.goals):
            return Label.BEHAVIORAL_INERTIA
        # The rule executes the skipped step later, so only the order is wrong if the instruction prescribes one.
        return Label.ORDER_VIOLATION if self.condition.instruction.ordered else label


class HabitPlace(BrokenRule):
    """Rule that brings each right object once, but to the target that objects of its kind have in training."""

    label = Label.BEHAVIORAL_INERTIA

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        step = sum(isinstance(decision, Bring) for decision in history)
        goals = [i for i, goal in enumerate(self.goals) if carried(goal)]
        if not any(self._habits(state, i) for i in goals):
            return super().broken(state, history)
        if step >= len(goals):
            return Rest()
        right = self.bring(state, goals[step])
        for target, relation, place in self._habits(state, goals[step]):
            name = choose(self.situation, state, goals[step])
            if name is not None:
                return self.make_way(state, target) or Bring(name, target, relation, place)
        return right

    def _habits(self, state: WorldState, index: int) -> list[tuple[str, str, str]]:
        """Return the targets to which objects of the subgoal's kind are brought in training, with relation and region.

        The list is empty if the target of the subgoal itself occurred in training.
        """
        kinds = {state.info.object(n).kind for n in self.condition.resolve(self.goals[index].reference)}
        found = []
        for kind in sorted(kinds):
            trained = self.trained.kind_targets.get(kind, ())
            # The layer in which an object is put depends on the stack, not on habit.
            if set(trained) & self._asked(kind) or relation_named(self.goals[index].relation).counted:
                continue
            for target_kind, relation, place in trained:
                found += [(o.name, relation, place) for o in self.condition.objects if o.kind == target_kind]
        return found

    def _asked(self, kind: str) -> set[tuple[str, str, str]]:
        condition = self.condition
        return {
            (condition.object(g.target).kind, g.relation, g.region)
            for g in self.goals
            if any(condition.object(n).kind == kind for n in condition.resolve(g.reference))
        }
