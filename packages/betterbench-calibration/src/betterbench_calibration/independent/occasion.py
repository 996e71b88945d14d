"""Trial context for the independent family: the condition, the training distribution and the completed subgoals."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.interface.state import WorldState
from betterbench.tasks import (
    Condition,
    Expected,
    Slot,
    Subgoal,
    TargetRegion,
    Task,
    TrainingDistribution,
    training_distribution_of,
)
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.relations import relation, released

_TRAINED: dict[int, tuple[Task, TrainingDistribution]] = {}
"""Training distribution of each task by ``id(task)``. The task is stored too, so that its ID is not reused."""


@dataclass(frozen=True, slots=True)
class Occasion:
    """Context of a trial, on which the decisions of habits depend. It does not contain the seed.

    Attributes:
        task: Task of the trial.
        condition: Condition of the trial.
        base: Training condition from which the condition was derived. For a training condition, the condition itself.
    """

    task: Task
    condition: Condition
    base: Condition

    @classmethod
    def of(cls, task: Task, condition: Condition) -> Occasion:
        """Return the trial context for a task condition."""
        return cls(task, condition, task.train(resolve_condition(task.id, condition.name).base))

    @property
    def trained(self) -> TrainingDistribution:
        """Training distribution of the task."""
        known = _TRAINED.get(id(self.task))
        if known is None:
            known = _TRAINED[id(self.task)] = self.task, training_distribution_of(self.task)
        return known[1]

    @property
    def goals(self) -> tuple[Subgoal, ...]:
        """Subgoals, in the order of the instruction."""
        return self.condition.instruction.subgoals

    @property
    def carried(self) -> tuple[Subgoal, ...]:
        """Subgoals that are reached by placing an object, in the order of the instruction."""
        return tuple(g for g in self.goals if relation(g.relation).carried)

    @property
    def plain(self) -> bool:
        """Whether the instruction can be carried out and the scene looks like the start of a task."""
        return self.condition.expected is Expected.SUCCEED and not self.condition.mid_task_look

    @property
    def mid_task(self) -> bool:
        """Whether the instruction can be carried out and the scene looks like the middle of a task."""
        return self.condition.expected is Expected.SUCCEED and self.condition.mid_task_look

    @property
    def picked_slots(self) -> tuple[Slot, ...]:
        """Slots from which demonstrations pick and that contain an object in the base condition."""
        slots = {name for names in self.trained.kind_slots.values() for name in names}
        return tuple(s for s in self.task.slots if s.name in slots and self.base.occupant(s.name) is not None)

    def done(self, state: WorldState, goal: Subgoal) -> bool:
        """Return whether a subgoal is reached: the required number of objects is at the target and released."""
        names = self.condition.resolve(goal.reference)
        kind = relation(goal.relation)
        there = [n for n in names if kind.holds(state, n, goal.target, goal.region) and released(state, n)]
        return len(there) >= goal.count

    def candidates(self, state: WorldState, goal: Subgoal) -> tuple[str, ...]:
        """Return the objects to which a subgoal refers, except those that are on the floor or already at a target."""
        serving = {
            n
            for g in self.carried
            for n in self.condition.resolve(g.reference)
            if relation(g.relation).holds(state, n, g.target, g.region)
        }
        names = self.condition.resolve(goal.reference)
        return tuple(n for n in names if n not in serving and state.pose(n).position[2] > -0.02)

    def begun(self, goal: Subgoal) -> bool:
        """Return whether a subgoal is reached at the start, because its objects are pre-placed."""
        place = TargetRegion(goal.target, goal.region)
        names = self.condition.resolve(goal.reference)
        return sum(self.condition.preplaced.get(n) == place for n in names) >= goal.count

    @property
    def ahead(self) -> tuple[Subgoal, ...]:
        """Subgoals that are reached by placing an object and are not reached at the start, in order."""
        return tuple(g for g in self.carried if not self.begun(g))

    def things(self, goal: Subgoal) -> tuple[str, ...]:
        """Return the objects to which a subgoal refers and that are in a slot at the start."""
        return tuple(n for n in self.condition.resolve(goal.reference) if n in self.condition.layout)

    def first_thing(self) -> str | None:
        """Return the object that a correct policy picks first, or None if there is none."""
        for goal in self.ahead:
            return next(iter(self.things(goal)), None)
        return None

    @property
    def asked(self) -> frozenset[str]:
        """Names of all objects that must be placed according to the instruction."""
        return frozenset(n for g in self.carried for n in self.condition.resolve(g.reference))

    def led_to(self, goal: Subgoal, name: str) -> bool:
        """Return whether training associates the initial slot of an object with the word of a subgoal."""
        return self.condition.layout.get(name) in self.trained.word_slots.get(goal.word, ())

    @property
    def meant_kinds(self) -> frozenset[str]:
        """Kinds of all objects and targets to which instructions of the task refer."""
        places = {kind for targets in self.trained.kind_targets.values() for kind, _, _ in targets}
        return frozenset(places | self.trained.kind_slots.keys())

    def look_alike(self) -> str | None:
        """Return the look-alike, or None if there is none.

        The look-alike is in the slot that a requested object has in the base condition, and no instruction refers to
        it.
        """
        for goal in self.carried:
            for thing in self.base.resolve(goal.reference):
                slot = self.base.layout.get(thing)
                name = None if slot is None else self.condition.occupant(slot)
                if name is not None and self.condition.object(name).kind not in self.meant_kinds | self.asked_kinds:
                    return name
        return None

    @property
    def asked_kinds(self) -> frozenset[str]:
        """Kinds of the objects that must be placed."""
        return frozenset(self.condition.object(n).kind for n in self.asked)

    def word_slot(self, goal: Subgoal) -> str | None:
        """Return the slot that training associates with the word of a subgoal, or None if there are several.

        Only training conditions with the same layout as the base condition count, unless the word occurs in none of
        them.
        """
        fitting = [c for c in self.task.training if self._stage(c) == self._stage(self.base)]
        for conditions in (fitting, self.task.training):
            slots = {
                c.layout[n]
                for c in conditions
                for g in c.instruction.subgoals
                if g.word == goal.word
                for n in c.resolve(g.reference)
                if n in c.layout
            }
            if slots:
                return slots.pop() if len(slots) == 1 else None
        return None

    def _stage(self, condition: Condition) -> frozenset[tuple[str, str]]:
        """Return the layout of a condition as pairs of object kind and slot."""
        return frozenset((condition.object(n).kind, s) for n, s in condition.layout.items())

    def others(self) -> tuple[str, ...]:
        """Return the movable objects in slots that are neither requested nor a target."""
        targets = {g.target for g in self.goals}
        loose = (o.name for o in self.condition.objects if o.role in ("item", "distractor") and not o.fixed)
        return tuple(n for n in loose if n in self.condition.layout and n not in self.asked | targets)
