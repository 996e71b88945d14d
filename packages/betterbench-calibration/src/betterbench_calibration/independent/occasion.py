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
"""Training distribution of each task by identity, with the task itself, so that no other task gets its identity."""


@dataclass(frozen=True, slots=True)
class Occasion:
    """Trial condition and the regularities of training on which decisions depend. It does not depend on the seed.

    Attributes:
        base: Training condition of the trial, or the one from which it was derived.
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
        """The regularities of the training distribution."""
        known = _TRAINED.get(id(self.task))
        if known is None:
            known = _TRAINED[id(self.task)] = self.task, training_distribution_of(self.task)
        return known[1]

    @property
    def goals(self) -> tuple[Subgoal, ...]:
        """The instruction's subgoals, in its order."""
        return self.condition.instruction.subgoals

    @property
    def carried(self) -> tuple[Subgoal, ...]:
        """The subgoals that place an object, in instruction order."""
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
        """The slots from which demonstrations of this layout picked."""
        slots = {name for names in self.trained.kind_slots.values() for name in names}
        return tuple(s for s in self.task.slots if s.name in slots and self.base.occupant(s.name) is not None)

    def done(self, state: WorldState, goal: Subgoal) -> bool:
        """Return whether a subgoal is done, so that enough of its objects are at the target and released."""
        names = self.condition.resolve(goal.reference)
        kind = relation(goal.relation)
        there = [n for n in names if kind.holds(state, n, goal.target, goal.region) and released(state, n)]
        return len(there) >= goal.count

    def candidates(self, state: WorldState, goal: Subgoal) -> tuple[str, ...]:
        """Return the unused objects on the table that a subgoal can refer to."""
        serving = {
            n
            for g in self.carried
            for n in self.condition.resolve(g.reference)
            if relation(g.relation).holds(state, n, g.target, g.region)
        }
        names = self.condition.resolve(goal.reference)
        return tuple(n for n in names if n not in serving and state.pose(n).position[2] > -0.02)

    def begun(self, goal: Subgoal) -> bool:
        """Return whether a subgoal is done at the start because its objects were pre-placed."""
        place = TargetRegion(goal.target, goal.region)
        names = self.condition.resolve(goal.reference)
        return sum(self.condition.preplaced.get(n) == place for n in names) >= goal.count

    @property
    def ahead(self) -> tuple[Subgoal, ...]:
        """The placing subgoals that are not done at the start, in order."""
        return tuple(g for g in self.carried if not self.begun(g))

    def things(self, goal: Subgoal) -> tuple[str, ...]:
        """Return the objects in slots at the start to which a subgoal can refer."""
        return tuple(n for n in self.condition.resolve(goal.reference) if n in self.condition.layout)

    def first_thing(self) -> str | None:
        """Return the object that a correct policy picks first, or None if there is none."""
        for goal in self.ahead:
            return next(iter(self.things(goal)), None)
        return None

    @property
    def asked(self) -> frozenset[str]:
        """All objects to be placed according to the instruction."""
        return frozenset(n for g in self.carried for n in self.condition.resolve(g.reference))

    def led_to(self, goal: Subgoal, name: str) -> bool:
        """Return whether a subgoal's word referred to the object's current slot in any demonstration."""
        return self.condition.layout.get(name) in self.trained.word_slots.get(goal.word, ())

    @property
    def meant_kinds(self) -> frozenset[str]:
        """Kinds that any instruction of the task names, as object or target."""
        places = {kind for targets in self.trained.kind_targets.values() for kind, _, _ in targets}
        return frozenset(places | self.trained.kind_slots.keys())

    def look_alike(self) -> str | None:
        """Return the object not named in the instruction that is in the slot of the twin's instructed object."""
        for goal in self.carried:
            for thing in self.base.resolve(goal.reference):
                slot = self.base.layout.get(thing)
                name = None if slot is None else self.condition.occupant(slot)
                if name is not None and self.condition.object(name).kind not in self.meant_kinds | self.asked_kinds:
                    return name
        return None

    @property
    def asked_kinds(self) -> frozenset[str]:
        """Kinds of the objects to be placed."""
        return frozenset(self.condition.object(n).kind for n in self.asked)

    def word_slot(self, goal: Subgoal) -> str | None:
        """Return the slot that the word of a subgoal led to in training, or None if there were several.

        Only demonstrations with the fixtures in the same places as in this trial count. If there are none, all count.
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
        """Return the fixture and object slots in a condition's layout, by kind."""
        return frozenset((condition.object(n).kind, s) for n, s in condition.layout.items())

    def others(self) -> tuple[str, ...]:
        """Return the loose objects in slots that are neither requested nor a target."""
        targets = {g.target for g in self.goals}
        loose = (o.name for o in self.condition.objects if o.role in ("item", "distractor") and not o.fixed)
        return tuple(n for n in loose if n in self.condition.layout and n not in self.asked | targets)
