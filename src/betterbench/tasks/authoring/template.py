"""Constraint templates: the interaction patterns of tasks."""

from dataclasses import dataclass
from typing import Literal

from betterbench.tasks.axes import Expected
from betterbench.tasks.condition import Condition, Role
from betterbench.tasks.relations import RELATIONS, Relation
from betterbench.tasks.thresholds import THRESHOLDS

Order = Literal["free", "named", "built"]
"""Order of the subgoals: free, as in the instruction, or forced by construction."""


@dataclass(frozen=True, slots=True)
class ObjectGroup:
    """Group of objects in a template. A scenario fills the group.

    Attributes:
        description: Meaning of the group.
        allowed_types: Allowed semantic categories.
        count_range: Minimum and maximum number of objects.
        role: Role of its objects in a scene.
    """

    group_id: str
    description: str
    allowed_types: tuple[str, ...]
    count_range: tuple[int, int]
    role: Role


@dataclass(frozen=True, kw_only=True)
class Meta:
    """Template description in words.

    Attributes:
        name: Identifier ("loose_packing").
        challenge: Difficulty of the template (paper, table of the taxonomy).
        goal: Condition at the end of a successful episode.
        premise: Condition at the start.
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
        base_steps: Control steps allowed for an episode, in addition to the steps per subgoal.
        steps_per_subgoal: Control steps allowed for each subgoal. Together, the two limits allow about three times the
            median of the expert, enough for a policy as slow as a human teleoperator (suite, section 3).
        still_steps: Control steps for which a policy is watched if staying still is the right behavior.
    """

    dwell_s: float = 0.5
    base_steps: int = 60
    steps_per_subgoal: int = 480
    still_steps: int = 200


@dataclass(frozen=True, kw_only=True)
class Template(Meta, Protocol):
    """Interaction pattern, with object groups, relations and a protocol.

    Attributes:
        relation: Name of the main relation in its subgoals.
        also: Further relations in its subgoals.
        exclusive: Whether only instructed objects may satisfy the relation at the end.
    """

    groups: tuple[ObjectGroup, ...]
    relation: str
    exclusive: bool
    order: Order
    also: tuple[str, ...] = ()

    @property
    def relations(self) -> tuple[Relation, ...]:
        """All relations that subgoals may use."""
        return tuple(RELATIONS[name] for name in (self.relation, *self.also))

    @property
    def regions(self) -> tuple[str, ...]:
        """Regions in a target's asset, by any of these names."""
        return tuple(dict.fromkeys(region for relation in self.relations for region in relation.needs))

    @property
    def tolerances(self) -> dict[str, float]:
        """The thresholds of its relations, by name."""
        values = THRESHOLDS.to_json()
        return {name: values[name] for relation in self.relations for name in relation.tolerances}

    def step_limit(self, condition: Condition) -> int:
        """Return the number of control steps after which an episode in the condition ends."""
        if condition.expected is Expected.STAY_STILL:
            return self.still_steps
        return self.base_steps + self.steps_per_subgoal * len(condition.instruction.subgoals) + condition.watch_steps

    def problems(self, condition: Condition) -> tuple[str, ...]:
        """Return the violations of this pattern by a condition, or an empty tuple."""
        found: list[str] = []
        for group in self.groups:
            count = sum(o.role == group.role for o in condition.objects)
            low, high = group.count_range
            if condition.premise_broken and group.role == "item":
                low = 0  # with a broken premise, objects named in the instruction may be missing
            if not low <= count <= high:
                found.append(f"group {group.group_id!r} has {count} objects, not {low} to {high}")
        roles = {g.role for g in self.groups}
        strays = (o for o in condition.objects if o.role not in roles)
        found += [f"{o.name} plays the role {o.role!r}, which has no group" for o in strays]
        for goal in condition.instruction.subgoals:
            if goal.relation not in (self.relation, *self.also):
                found.append(f"subgoal {goal.name!r} uses {goal.relation!r}")
        ordered = condition.instruction.ordered
        if self.order == "free" and ordered:
            found.append("the instruction is ordered, but this pattern has no order")
        if self.order == "built" and not ordered:
            found.append("the instruction is not ordered, but lower objects must come first")
        return tuple(found)
