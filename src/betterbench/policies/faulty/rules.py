"""Base class of faulty decision rules, which records the first fault of each episode as ground truth.

A faulty policy compares each of its decisions with the decisions that would be right at that time. The first wrong
decision determines the true label of the trial. This label does not depend on the record: it is written to the run
journal and not to the record. Since the diagnosis reads only records, the label can serve as ground truth for the
diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from betterbench.geometry import horizontal_distance
from betterbench.interface.state import WorldState
from betterbench.policies.decisions import (
    Bring,
    Decision,
    Draw,
    ExpertRule,
    Freeze,
    GraspAt,
    Rest,
    Situation,
    Wander,
    at_target,
    bring_to,
    carried,
    open_subgoals,
)
from betterbench.tasks import (
    Condition,
    Expected,
    Label,
    Subgoal,
    TrainingDistribution,
    stream,
    training_distribution_of,
)
from betterbench.tasks.authoring.training_distribution import on_table

STANDS_WITHIN_M = 0.06
"""Largest distance from a slot at which an object counts as being in the slot [m].

It allows for the random placement and a small push.
"""


@dataclass(frozen=True, slots=True)
class Fault:
    """First wrong decision of an episode.

    Attributes:
        label: True outcome label of the trial.
        decision: Index of the decision, starting at 0.
        text: Description of the decision.
    """

    label: Label
    decision: int
    text: str


class BrokenRule(ExpertRule):
    """Decision rule that follows the expert except where the fault of the policy applies.

    Attributes:
        label: Outcome label if the rule takes an object that belongs to another instruction or another step.
        empty_label: Outcome label if the rule grasps at a position without an object.
        place_label: Outcome label if the rule brings the right object to a wrong target.
        fault: First wrong decision of the episode, or None if there has been no wrong decision so far.
    """

    label: ClassVar[Label] = Label.WRONG_OBJECT
    empty_label: ClassVar[Label] = Label.BEHAVIORAL_INERTIA
    place_label: ClassVar[Label] = Label.BEHAVIORAL_INERTIA

    def __init__(self, situation: Situation, strength: float = 1.0) -> None:
        """Create the rule for one episode.

        Args:
            situation: Facts about the trial.
            strength: Fraction of trials in which the fault applies, drawn from the trial's random stream. In the other
                trials, the rule decides like the expert.
        """
        super().__init__(situation)
        self.trained: TrainingDistribution = training_distribution_of(situation.task)
        self.condition = situation.condition
        self.goals = situation.condition.instruction.subgoals
        self.fault: Fault | None = None
        self.applies = strength >= 1.0 or self.draw("strength") < strength

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        if not self.applies:
            return super().decide(state, history)
        decision = self.broken(state, history)
        if self.fault is None:
            label = self._label_of(state, history, decision)
            if label is not None:
                self.fault = Fault(label, len(history), str(decision))
        return decision

    def broken(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the decision of the faulty rule. In this base class, it is the expert's decision."""
        return super().decide(state, history)

    def draw(self, purpose: str) -> float:
        """Draw a random number in [0, 1) from the trial's random stream for the given purpose."""
        name = f"{type(self).__name__}:{self.condition.name}:{purpose}"
        return float(stream(self.situation.task.id, self.situation.seed, name).random())

    def standing_in(self, state: WorldState, slot: str) -> str | None:
        """Return the name of the movable object that is in a slot now, or None if the slot is empty."""
        place = state.info.slot(slot).position
        near = [
            (horizontal_distance(state.pose(o.name).position, place), o.name)
            for o in state.info.objects
            if not o.fixed and o.role in ("item", "distractor")
        ]
        near = [entry for entry in near if entry[0] < STANDS_WITHIN_M]
        return min(near)[1] if near else None

    def slots_of_word(self, word: str) -> tuple[str, ...]:
        """Return the slots of this scene that training associates with a word."""
        return self._in_this_scene(
            self.trained.word_slots.get(word, ()),
            lambda known, goal: known.resolve(goal.reference) if goal.word == word else (),
        )

    def slots_of_kind(self, kind: str) -> tuple[str, ...]:
        """Return the slots of this scene from which objects of a kind were picked in training."""
        return self._in_this_scene(
            self.trained.kind_slots.get(kind, ()),
            lambda known, goal: [n for n in known.resolve(goal.reference) if known.object(n).kind == kind],
        )

    def _in_this_scene(
        self, slots: tuple[str, ...], meant: Callable[[Condition, Subgoal], Sequence[str]]
    ) -> tuple[str, ...]:
        """Return the slots known from training that apply to this scene.

        In most tasks, the training layouts fill different slots, so the filled slots show which layout the scene has.
        All given slots are then returned. If all layouts fill the same slots, the result contains the slots used in the
        most similar training condition, in the order of its steps.

        Args:
            slots: Slots known from training.
            meant: Function that returns the names of the objects that a subgoal of a training condition refers to.
        """
        shown: list[tuple[Condition, tuple[str, ...]]] = []
        for known in self.situation.task.training:
            names = [n for goal in known.instruction.subgoals for n in meant(known, goal)]
            own = tuple(dict.fromkeys(known.layout[n] for n in names if n in known.layout))
            if own:
                shown.append((known, own))
        if len({frozenset(known.layout[n] for n in on_table(known)) for known, _ in shown}) != 1:
            return slots
        return max(shown, key=lambda one: self._likeness(one[0]))[1]

    def _likeness(self, known: Condition) -> int:
        """Count the slots with the same kind of object in a training condition and at the start of this trial."""
        kinds = {slot: known.object(name).kind for name, slot in known.layout.items()}
        return sum(kinds.get(slot) == self.condition.object(n).kind for n, slot in self.condition.layout.items())

    def absent_step(self, state: WorldState) -> str | None:
        """Return the slot of the next training step if the object for this step is missing in the scene.

        Otherwise, return None. The steps are those of the most similar training condition with the same instruction.
        The next step is the one after the last finished step, or the first step if none is finished.
        """
        known = self._same_instruction()
        if known is None:
            return None
        steps = known.instruction.subgoals
        number = max((i + 1 for i, goal in enumerate(steps) if self._finished(state, known, goal)), default=0)
        if number == len(steps) or self._present(known, steps[number]):
            return None
        return next((known.layout[n] for n in known.resolve(steps[number].reference) if n in known.layout), None)

    def out_of_order(self, state: WorldState) -> bool:
        """Return whether a training step is finished before an earlier step whose object is in the scene."""
        known = self._same_instruction()
        if known is None:
            return False
        waits = False
        for goal in known.instruction.subgoals:
            finished = self._finished(state, known, goal)
            if finished and waits:
                return True
            waits = waits or (not finished and bool(self._present(known, goal)))
        return False

    def _same_instruction(self) -> Condition | None:
        """Return the training condition with the same instruction whose scene is most similar to this one, or None."""
        text = self.condition.instruction.text
        same = [known for known in self.situation.task.training if known.instruction.text == text]
        return max(same, key=self._likeness) if same else None

    def _present(self, known: Condition, goal: Subgoal) -> list[str]:
        """Return the objects of this scene that are of the kind picked in a step of a training condition."""
        kinds = {known.object(n).kind for n in known.resolve(goal.reference)}
        return [o.name for o in self.condition.objects if o.kind in kinds]

    def _finished(self, state: WorldState, known: Condition, goal: Subgoal) -> bool:
        """Return whether a step of a training condition is finished in this scene.

        A step is finished if an object of the right kind is at a target of the right kind.
        """
        target = known.object(goal.target).kind
        targets = [o.name for o in self.condition.objects if o.kind == target]
        return any(
            at_target(state, n, t, goal.relation, goal.region) for n in self._present(known, goal) for t in targets
        )

    def take_at(self, state: WorldState, slot: str, goal: Subgoal | None = None) -> Decision:
        """Return the decision to take the object in a slot.

        If the slot is empty, it is the decision to grasp there anyway.

        Args:
            state: Current state.
            slot: Name of the slot.
            goal: Subgoal to whose target the object is brought. By default, the first subgoal.
        """
        name = self.standing_in(state, slot)
        goal = self.goals[0] if goal is None else goal
        return GraspAt(slot) if name is None else bring_to(goal, name)

    def known(self, kind: str) -> bool:
        """Return whether any instruction of the task refers to the given kind of object."""
        return kind in self.trained.known_kinds(self.condition)

    def right_decisions(self, state: WorldState) -> tuple[Decision, ...]:
        """Return all decisions that are right in the current state. The result is empty if nothing is left to do."""
        options: list[Decision] = []
        for i in open_subgoals(state, self.condition):
            goal = self.goals[i]
            for name in self.condition.resolve(goal.reference):
                if any(
                    name in self.condition.resolve(g.reference)
                    and at_target(state, name, g.target, g.relation, g.region)
                    for g in self.goals
                ):
                    continue
                if not carried(goal):
                    options.append(Draw(name, out=False))
                else:
                    way = self.make_way(state, goal.target)
                    options.append(way or bring_to(goal, name))
        return tuple(options)

    def _label_of(self, state: WorldState, history: tuple[Decision, ...], decision: Decision) -> Label | None:
        """Return the label of a decision that is wrong, or None if the decision is right."""
        options = self.right_decisions(state)
        if decision in options:
            return None
        expected = self.condition.expected
        if isinstance(decision, Rest | Freeze | Wander):
            if not options or expected is not Expected.SUCCEED:
                return Label.PHASE_CONFLICT if isinstance(decision, Wander) else None
            touched = any(isinstance(d, Bring | GraspAt | Draw) for d in history)
            return Label.PHASE_CONFLICT if self.condition.mid_task_look and not touched else Label.EARLY_HALT
        taken = decision.object if isinstance(decision, Bring) else None
        if isinstance(decision, GraspAt):
            taken = self.standing_in(state, decision.slot)
            if taken is None:
                return self.empty_label
        if taken is not None and not self.known(state.info.object(taken).kind):
            return Label.SEMANTIC_FEATURE_COLLAPSE
        if not isinstance(decision, Bring) or all(getattr(o, "object", None) != decision.object for o in options):
            return self.label
        return Label.BEHAVIORAL_INERTIA if self._trained_there(state, decision) else self.place_label

    def _trained_there(self, state: WorldState, decision: Bring) -> bool:
        """Return whether objects of this kind were brought to targets of this kind in training.

        If so, the decision looks like a habit.
        """
        kind, target = (state.info.object(name).kind for name in (decision.object, decision.target))
        return (target, decision.relation, decision.region) in self.trained.kind_targets.get(kind, ())
