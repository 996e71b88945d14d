"""Constraint templates, i.e. the patterns of interaction that tasks follow."""

from dataclasses import dataclass
from typing import Literal

from betterbench.tasks.axes import Expected
from betterbench.tasks.condition import Condition, Role
from betterbench.tasks.relations import RELATIONS, Relation
from betterbench.tasks.thresholds import THRESHOLDS

Order = Literal["free", "named", "built"]
"""Order in which the subgoals are done.

- "free": any order.
- "named": the order in the instruction.
- "built": only one order is physically possible, because each object is placed on the previous one.
"""


@dataclass(frozen=True, slots=True)
class ObjectGroup:
    """Group of objects in a template. A scenario fills the group with objects.

    Attributes:
        group_id: Name of the group.
        description: Meaning of the group.
        allowed_types: Semantic categories of objects that are allowed.
        count_range: Smallest and largest number of objects.
        role: Role of the objects in a scene.
    """

    group_id: str
    description: str
    allowed_types: tuple[str, ...]
    count_range: tuple[int, int]
    role: Role

    @property
    def counts(self) -> str:
        """The allowed numbers of objects as a text ("1" or "2 to 4")."""
        low, high = self.count_range
        return str(low) if low == high else f"{low} to {high}"


@dataclass(frozen=True, kw_only=True)
class Meta:
    """Description of a template in words.

    Attributes:
        name: Identifier ("loose_packing").
        title: Name that is shown in tables.
        description: Instruction that the template's tasks follow.
        challenge: What makes the tasks difficult, as given in the taxonomy table of the paper.
        goal: Condition that holds at the end of a successful episode.
        premise: Condition that holds at the start.
    """

    name: str
    title: str
    description: str
    challenge: str
    goal: str
    premise: str


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """Time limits of an episode.

    Attributes:
        dwell_s: Time for which the goal must stay true [s].
        base_steps: Control steps that every episode is allowed, in addition to the steps for its subgoals.
        steps_per_subgoal: Control steps that are allowed for each subgoal. Together with ``base_steps``, this allows
            about three times the expert's median number of steps, which is enough for a policy as slow as a human
            teleoperator.
        still_steps: Number of control steps in an episode where the correct behavior is to stay still.
    """

    dwell_s: float = 0.5
    base_steps: int = 60
    steps_per_subgoal: int = 480
    still_steps: int = 200


@dataclass(frozen=True, kw_only=True)
class Template(Meta, Protocol):
    """Pattern of interaction, with its object groups, relations and time limits.

    Attributes:
        groups: Groups of objects.
        relation: Name of the main relation in the subgoals.
        exclusive: Whether only requested objects may satisfy the relation at the end.
        order: Order of the subgoals.
        also: Names of additional relations in the subgoals.
    """

    groups: tuple[ObjectGroup, ...]
    relation: str
    exclusive: bool
    order: Order
    also: tuple[str, ...] = ()

    @property
    def relations(self) -> tuple[Relation, ...]:
        """All relations that the subgoals may use."""
        return tuple(RELATIONS[name] for name in (self.relation, *self.also))

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the asset regions that can serve as targets.

        The asset of a target must have at least one of them.
        """
        return tuple(dict.fromkeys(region for relation in self.relations for region in relation.needs))

    @property
    def tolerances(self) -> dict[str, float]:
        """Values of the thresholds that the relations use, keyed by the name of the threshold."""
        values = THRESHOLDS.to_json()
        return {name: values[name] for relation in self.relations for name in relation.tolerances}

    def step_limit(self, condition: Condition) -> int:
        """Return the maximum number of control steps of an episode in a condition."""
        if condition.expected is Expected.STAY_STILL:
            return self.still_steps
        return self.base_steps + self.steps_per_subgoal * len(condition.instruction.subgoals) + condition.watch_steps

    def problems(self, condition: Condition) -> tuple[str, ...]:
        """Return one clause for each way in which a condition violates the template.

        The result is empty if the condition follows the template.
        """
        found: list[str] = []
        for group in self.groups:
            count = sum(o.role == group.role for o in condition.objects)
            low, high = group.count_range
            if condition.premise_broken and group.role == "item":
                low = 0  # with a broken premise, objects named in the instruction may be missing
            if not low <= count <= high:
                one = "1 object" if count == 1 else f"{count} objects"
                found.append(f"group {group.group_id!r} (role {group.role!r}) has {one}, not {group.counts}")
        roles = {g.role for g in self.groups}
        strays = (o for o in condition.objects if o.role not in roles)
        found += [f"{o.name} has the role {o.role!r}, for which there is no group" for o in strays]
        for goal in condition.instruction.subgoals:
            if goal.relation not in (self.relation, *self.also):
                found.append(f"subgoal {goal.name!r} uses {goal.relation!r}")
        ordered = condition.instruction.ordered
        if self.order == "free" and ordered:
            found.append("the instruction is ordered, but the order of this template is free")
        if self.order == "built" and not ordered:
            found.append("the instruction is not ordered, but lower objects must come first")
        return tuple(found)
