"""Constraint templates: the interaction patterns that tasks fill in."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.tasks.axes import Expected
from betterbench.tasks.condition import Condition


@dataclass(frozen=True, slots=True)
class ObjectGroup:
    """An abstract group of objects of a template, as a scenario has to fill it.

    Attributes:
        group_id: Identifier.
        description: What the group stands for.
        allowed_types: Semantic categories it may hold.
        count_range: Least and largest number of objects.
    """

    group_id: str
    description: str
    allowed_types: tuple[str, ...]
    count_range: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Template:
    """An interaction pattern: its groups, its relation and the protocol that goes with it.

    Attributes:
        name: Identifier ("loose_packing").
        title: Name for people.
        description: What is done.
        challenge: What is hard about it (paper, table of the taxonomy).
        groups: Object groups.
        relation: Name of the relation that a subgoal of this template asks for.
        also: Further relations that its subgoals may ask for.
        exclusive: True if nothing that was not asked for may satisfy the relation at the end.
        dwell_s: Time for which the goal has to hold [s].
        base_steps: Control steps allowed for an episode, besides those per subgoal.
        steps_per_subgoal: Control steps allowed for each subgoal.
        still_steps: Control steps for which a policy is watched where the right answer is to stay still.
    """

    name: str
    title: str
    description: str
    challenge: str
    groups: tuple[ObjectGroup, ...]
    relation: str
    exclusive: bool
    also: tuple[str, ...] = ()
    dwell_s: float = 0.5
    base_steps: int = 150
    steps_per_subgoal: int = 200
    still_steps: int = 200

    def step_limit(self, condition: Condition) -> int:
        """Return the number of control steps after which an episode of the condition ends."""
        if condition.expected is Expected.STAY_STILL:
            return self.still_steps
        return self.base_steps + self.steps_per_subgoal * len(condition.instruction.subgoals)
