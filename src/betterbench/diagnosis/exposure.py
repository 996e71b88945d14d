"""Failure modes that the test condition of a variation can reveal, given the training distribution.

Each failure mode has a function that takes an :class:`Exposure` and returns whether the variation can reveal this
failure mode. A variation may only claim to reveal failure modes for which the function returns True.
"""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.tasks import (
    Condition,
    Expected,
    Subgoal,
    Task,
    TrainingDistribution,
    get_task,
    training_distribution_of,
)
from betterbench.tasks.interventions import resolve_condition


@dataclass(frozen=True, slots=True)
class Exposure:
    """Test condition of a variation, with its original training condition and the task's training distribution.

    Attributes:
        task: The task.
        base: Training condition that the variation is derived from.
        test: Test condition.
        trained: Training distribution of the task.
    """

    task: Task
    base: Condition
    test: Condition
    trained: TrainingDistribution

    @classmethod
    def of(cls, task_id: str, variation: str) -> Exposure:
        """Return the exposure of a variation, looked up by the names of its task and the variation.

        Raises:
            UnknownNameError: If the task or variation does not exist.
        """
        task = get_task(task_id)
        found = resolve_condition(task_id, variation)
        return cls(task, task.train(found.base), found.condition, training_distribution_of(task))

    @property
    def goals(self) -> tuple[Subgoal, ...]:
        """All subgoals of the test condition."""
        return self.test.instruction.subgoals

    def slots(self, goal: Subgoal) -> set[str]:
        """Return the starting slots of the objects that a subgoal refers to."""
        return {self.test.layout[n] for n in self.test.resolve(goal.reference) if n in self.test.layout}

    @property
    def open_goals(self) -> tuple[Subgoal, ...]:
        """Subgoals that are not done at the start and whose object is in the scene, in the order of the instruction."""
        return tuple(goal for goal in self.goals if self.slots(goal))

    @property
    def due(self) -> tuple[Subgoal, ...]:
        """Open subgoals that may correctly be done first."""
        return self.open_goals[:1] if self.test.instruction.ordered else self.open_goals

    @property
    def right_slots(self) -> set[str]:
        """Slots that contain an object that may correctly be picked first."""
        return {slot for goal in self.due for slot in self.slots(goal)}

    def movable_in(self, slot: str) -> str | None:
        """Return the kind of the movable object that starts in a slot, or None if the slot has no movable object."""
        name = self.test.occupant(slot)
        if name is None or self.test.object(name).role not in ("item", "distractor"):
            return None
        return self.test.object(name).kind

    def known(self, kind: str) -> bool:
        """Return whether any instruction of the task refers to a kind of object."""
        return kind in self.trained.known_kinds(self.test)

    def kinds(self, goal: Subgoal) -> set[str]:
        """Return the kinds of the objects that a subgoal refers to."""
        return {self.test.object(n).kind for n in self.test.resolve(goal.reference)}

    @property
    def lacks_later_step(self) -> bool:
        """Whether the same instruction had a later step in training whose object is missing from this scene.

        This is False if the condition is ambiguous, because then no behavior counts as a failure.
        """
        return self.test.expected is not Expected.AMBIGUOUS and max(absent_steps(self.task, self.test), default=0) > 0


def absent_steps(task: Task, condition: Condition) -> set[int]:
    """Return the indices of the steps that need an object that is missing from the scene.

    The steps are taken from the training instructions with the same text as the instruction of the condition.
    """
    here = {o.kind for o in condition.objects}
    return {
        number
        for known in task.training
        if known.instruction.text == condition.instruction.text
        for number, goal in enumerate(known.instruction.subgoals)
        if here.isdisjoint(known.object(n).kind for n in known.resolve(goal.reference))
    }
