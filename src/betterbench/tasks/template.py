"""Constraint templates: the interaction patterns that tasks fill in."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, TypeAdapter

from betterbench.errors import InvalidInputError
from betterbench.json_form import read_form, strict_form
from betterbench.tasks.axes import Expected
from betterbench.tasks.condition import Condition, Role
from betterbench.tasks.relations import RELATIONS, Relation
from betterbench.tasks.thresholds import THRESHOLDS

SCHEMA_VERSION = 1
"""Version of the JSON form of templates."""

Order = Literal["free", "named", "built"]
"""Whether the order of the subgoals is part of the goal: never, where the instruction says so, or by construction."""

Text = Annotated[str, Field(min_length=1, pattern=r"\S")]
Positive = Annotated[float, Field(ge=0.0, lt=1e6)]
StepCount = Annotated[int, Field(ge=0, lt=10**6)]
Count = Annotated[int, Field(ge=0)]


def _ascending(span: tuple[int, int]) -> tuple[int, int]:
    if span[0] > span[1]:
        raise ValueError(f"{list(span)} does not begin with the smaller number")
    return span


@strict_form
@dataclass(frozen=True, slots=True)
class ObjectGroup:
    """An abstract group of objects of a template, as a scenario has to fill it.

    Attributes:
        group_id: Identifier.
        description: What the group stands for.
        allowed_types: Semantic categories it may hold.
        count_range: Least and largest number of objects.
        role: Role that its objects play in a scene.
    """

    group_id: Text
    description: Text
    allowed_types: tuple[Text, ...]
    count_range: Annotated[tuple[Count, Count], AfterValidator(_ascending)]
    role: Role


@strict_form
@dataclass(frozen=True, kw_only=True)
class Meta:
    """What a template is, in words.

    Attributes:
        name: Identifier ("loose_packing").
        title: Name for people.
        description: What is done.
        challenge: What is hard about it (paper, table of the taxonomy).
        goal: What has to hold at the end.
        premise: What has to hold at the start.
    """

    name: Text
    title: Text
    description: Text
    challenge: Text
    goal: Text
    premise: Text


@strict_form
@dataclass(frozen=True, kw_only=True)
class Protocol:
    """How long an episode takes.

    Attributes:
        dwell_s: Time for which the goal has to hold [s].
        base_steps: Control steps allowed for an episode, besides those per subgoal.
        steps_per_subgoal: Control steps allowed for each subgoal.
        still_steps: Control steps for which a policy is watched where the right answer is to stay still.
    """

    dwell_s: Positive = 0.5
    base_steps: StepCount = 150
    steps_per_subgoal: StepCount = 200
    still_steps: StepCount = 200


@dataclass(frozen=True, kw_only=True)
class Template(Meta, Protocol):
    """An interaction pattern: its groups, its relations and the protocol that goes with them.

    Attributes:
        groups: Object groups.
        relation: Name of the relation that a subgoal of this template asks for.
        also: Further relations that its subgoals may ask for.
        exclusive: True if nothing that was not asked for may satisfy the relation at the end.
        order: Whether the order of the subgoals is part of the goal.
    """

    groups: tuple[ObjectGroup, ...]
    relation: str
    exclusive: bool
    order: Order
    also: tuple[str, ...] = ()

    @property
    def relations(self) -> tuple[Relation, ...]:
        """All relations that its subgoals may ask for."""
        return tuple(RELATIONS[name] for name in (self.relation, *self.also))

    @property
    def regions(self) -> tuple[str, ...]:
        """Regions that the asset of a target has, by any of these names."""
        return tuple(dict.fromkeys(region for relation in self.relations for region in relation.needs))

    @property
    def tolerances(self) -> dict[str, float]:
        """The thresholds that decide about its relations, by name."""
        values = THRESHOLDS.to_json()
        return {name: values[name] for relation in self.relations for name in relation.tolerances}

    def step_limit(self, condition: Condition) -> int:
        """Return the number of control steps after which an episode of the condition ends."""
        if condition.expected is Expected.STAY_STILL:
            return self.still_steps
        return self.base_steps + self.steps_per_subgoal * len(condition.instruction.subgoals)

    def problems(self, condition: Condition) -> tuple[str, ...]:
        """Return where a condition does not follow this pattern; empty if it does.

        Args:
            condition: The condition.
        """
        found: list[str] = []
        for group in self.groups:
            count = sum(o.role == group.role for o in condition.objects)
            low, high = group.count_range
            if not low <= count <= high:
                found.append(f"group {group.group_id!r} has {count} objects, not {low} to {high}")
        roles = {g.role for g in self.groups}
        found += [
            f"{o.name} plays the role {o.role!r}, which has no group" for o in condition.objects if o.role not in roles
        ]
        for goal in condition.instruction.subgoals:
            if goal.relation not in (self.relation, *self.also):
                found.append(f"subgoal {goal.name!r} asks for {goal.relation!r}")
        ordered = condition.instruction.ordered
        if self.order == "free" and ordered:
            found.append("the instruction is ordered, but order is no part of this pattern")
        if self.order == "built" and not ordered:
            found.append("the instruction is not ordered, but what lies below has to come first")
        return tuple(found)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form, which people and models fill in scenarios after."""
        return {
            "schema_version": SCHEMA_VERSION,
            "meta": {f.name: getattr(self, f.name) for f in fields(Meta)},
            "object_groups": [asdict(group) for group in self.groups],
            "relations": [self.relation, *self.also],
            "exclusive": self.exclusive,
            "order": self.order,
            "regions": list(self.regions),
            "tolerances": self.tolerances,
            "protocol": {f.name: getattr(self, f.name) for f in fields(Protocol)},
        }

    @classmethod
    def from_json(cls, form: Mapping[str, Any]) -> Template:
        """Read the JSON form.

        Raises:
            InvalidInputError: If a field is missing, unknown, of the wrong type or out of range; it names the path.
        """
        cure = "Write it as the templates of better list templates --json do"
        read = read_form(_form(), dict(form), where="template", cure=cure)
        relation, *also = read.relations
        template = cls(
            **asdict(read.meta),
            **asdict(read.protocol),
            groups=read.object_groups,
            relation=relation,
            also=tuple(also),
            exclusive=read.exclusive,
            order=read.order,
        )
        names = [group.group_id for group in template.groups]
        if len(set(names)) < len(names):
            raise InvalidInputError("template.object_groups", "two groups have the same group_id", cure)
        for key, derived in (("regions", list(template.regions)), ("tolerances", template.tolerances)):
            if form[key] != derived:
                raise InvalidInputError(
                    f"template.{key}", f"{form[key]!r}", f"It follows from the relations: {derived}"
                )
        return template


def _known_relation(name: str) -> str:
    if name not in RELATIONS:
        raise ValueError(f"{name!r} is unknown; there are {', '.join(sorted(RELATIONS))}")
    return name


@strict_form
@dataclass(frozen=True, slots=True)
class _Form:
    """The JSON form of a template."""

    schema_version: Literal[1]
    meta: Meta
    object_groups: Annotated[tuple[ObjectGroup, ...], Field(min_length=1)]
    relations: Annotated[tuple[Annotated[str, AfterValidator(_known_relation)], ...], Field(min_length=1)]
    exclusive: bool
    order: Order
    regions: tuple[str, ...]
    tolerances: dict[str, float]
    protocol: Protocol


@functools.cache
def _form() -> TypeAdapter[_Form]:
    """Return what reads the form; made when a template is read, because it takes 0.1 s."""
    return TypeAdapter(_Form)
