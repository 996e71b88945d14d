"""Constraint templates: the interaction patterns that tasks fill in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from betterbench.errors import InvalidInputError
from betterbench.tasks.axes import Expected
from betterbench.tasks.condition import Condition, Role
from betterbench.tasks.relations import RELATIONS
from betterbench.tasks.thresholds import THRESHOLDS, Thresholds

SCHEMA_VERSION = 1
"""Version of the JSON form of templates."""

Order = Literal["free", "named", "built"]
"""Whether the order of the subgoals is part of the goal: never, where the sentence says so, or by construction."""


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

    group_id: str
    description: str
    allowed_types: tuple[str, ...]
    count_range: tuple[int, int]
    role: Role


@dataclass(frozen=True, slots=True)
class Template:
    """An interaction pattern: its groups, its relations and the protocol that goes with them.

    Attributes:
        name: Identifier ("loose_packing").
        title: Name for people.
        description: What is done.
        challenge: What is hard about it (paper, table of the taxonomy).
        goal: What has to hold at the end, in words.
        premise: What has to hold at the start, in words.
        groups: Object groups.
        relation: Name of the relation that a subgoal of this template asks for.
        exclusive: True if nothing that was not asked for may satisfy the relation at the end.
        order: Whether the order of the subgoals is part of the goal.
        regions: Regions that the asset of a target has, by any of these names.
        tolerances: Names of the thresholds that decide about the relation.
        also: Further relations that its subgoals may ask for.
        jitter_m: Half width of the uniform position jitter of a slot, unless the slot says otherwise [m].
        yaw_jitter: Half width of the uniform heading jitter of a slot, unless the slot says otherwise [rad].
        dwell_s: Time for which the goal has to hold [s].
        base_steps: Control steps allowed for an episode, besides those per subgoal.
        steps_per_subgoal: Control steps allowed for each subgoal.
        still_steps: Control steps for which a policy is watched where the right answer is to stay still.
    """

    name: str
    title: str
    description: str
    challenge: str
    goal: str
    premise: str
    groups: tuple[ObjectGroup, ...]
    relation: str
    exclusive: bool
    order: Order
    regions: tuple[str, ...]
    tolerances: tuple[str, ...]
    also: tuple[str, ...] = ()
    jitter_m: float = 0.015
    yaw_jitter: float = 0.15
    dwell_s: float = 0.5
    base_steps: int = 150
    steps_per_subgoal: int = 200
    still_steps: int = 200

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
            "meta": {key: getattr(self, key) for key in _META},
            "object_groups": [
                {
                    "group_id": g.group_id,
                    "description": g.description,
                    "role": g.role,
                    "allowed_types": list(g.allowed_types),
                    "count_range": list(g.count_range),
                }
                for g in self.groups
            ],
            "relations": [self.relation, *self.also],
            "exclusive": self.exclusive,
            "order": self.order,
            "regions": list(self.regions),
            "tolerances": {name: getattr(THRESHOLDS, name) for name in self.tolerances},
            "placement": {"jitter_m": self.jitter_m, "yaw_jitter": self.yaw_jitter},
            "protocol": {key: getattr(self, key) for key in _PROTOCOL},
        }

    @classmethod
    def from_json(cls, form: Mapping[str, Any]) -> Template:
        """Read the JSON form.

        Raises:
            InvalidInputError: If a field is missing, unknown, of the wrong type or out of range; it names the path.
        """
        _exactly(form, _FIELDS, "template")
        if form["schema_version"] != SCHEMA_VERSION:
            raise InvalidInputError(
                "template.schema_version", f"{form['schema_version']!r}", f"This version reads {SCHEMA_VERSION}"
            )
        meta, protocol, placement = form["meta"], form["protocol"], form["placement"]
        _exactly(meta, _META, "template.meta")
        _exactly(protocol, _PROTOCOL, "template.protocol")
        _exactly(placement, ("jitter_m", "yaw_jitter"), "template.placement")
        relations = _texts(form["relations"], "template.relations")
        for i, name in enumerate(relations):
            _one_of(name, tuple(RELATIONS), f"template.relations[{i}]")
        if not relations:
            raise InvalidInputError("template.relations", "it is empty", "Name at least one relation")
        if not isinstance(form["exclusive"], bool):
            raise InvalidInputError(
                "template.exclusive", f"{form['exclusive']!r} is no truth value", "Give true or false"
            )
        tolerances = form["tolerances"]
        if not isinstance(tolerances, Mapping):
            raise InvalidInputError("template.tolerances", "it is no object", "Give names with their values")
        for name, value in tolerances.items():
            _one_of(name, Thresholds.names(), "template.tolerances")
            if value != getattr(THRESHOLDS, name):
                raise InvalidInputError(
                    f"template.tolerances.{name}", f"{value!r}", f"It is {getattr(THRESHOLDS, name)} in this version"
                )
        return cls(
            name=_text(meta["name"], "template.meta.name"),
            title=_text(meta["title"], "template.meta.title"),
            description=_text(meta["description"], "template.meta.description"),
            challenge=_text(meta["challenge"], "template.meta.challenge"),
            goal=_text(meta["goal"], "template.meta.goal"),
            premise=_text(meta["premise"], "template.meta.premise"),
            groups=_groups(form["object_groups"]),
            relation=relations[0],
            also=relations[1:],
            exclusive=form["exclusive"],
            order=_one_of(form["order"], get_args(Order), "template.order"),
            regions=_texts(form["regions"], "template.regions"),
            tolerances=tuple(tolerances),
            jitter_m=_number(placement["jitter_m"], "template.placement.jitter_m"),
            yaw_jitter=_number(placement["yaw_jitter"], "template.placement.yaw_jitter"),
            dwell_s=_number(protocol["dwell_s"], "template.protocol.dwell_s"),
            base_steps=int(_number(protocol["base_steps"], "template.protocol.base_steps")),
            steps_per_subgoal=int(_number(protocol["steps_per_subgoal"], "template.protocol.steps_per_subgoal")),
            still_steps=int(_number(protocol["still_steps"], "template.protocol.still_steps")),
        )


_META = ("name", "title", "description", "challenge", "goal", "premise")
_PROTOCOL = ("dwell_s", "base_steps", "steps_per_subgoal", "still_steps")
_FIELDS = (
    "schema_version",
    "meta",
    "object_groups",
    "relations",
    "exclusive",
    "order",
    "regions",
    "tolerances",
    "placement",
    "protocol",
)


def _exactly(form: object, names: tuple[str, ...], where: str) -> None:
    """Check that a JSON object has exactly these fields.

    Raises:
        InvalidInputError: If it does not.
    """
    if not isinstance(form, Mapping):
        raise InvalidInputError(where, "it is no object", f"Give the fields {', '.join(names)}")
    missing, unknown = set(names) - set(form), set(form) - set(names)
    if missing:
        raise InvalidInputError(f"{where}.{min(missing)}", "it is missing", "Add it")
    if unknown:
        raise InvalidInputError(f"{where}.{min(unknown)}", "it is unknown", f"Use only {', '.join(names)}")


def _text(value: object, where: str) -> str:
    if not isinstance(value, str) or not value.strip():
        raise InvalidInputError(where, f"{value!r} is no text", "Give a text that is not empty")
    return value


def _texts(value: object, where: str) -> tuple[str, ...]:
    if not isinstance(value, list | tuple):
        raise InvalidInputError(where, f"{value!r} is no list", "Give a list of texts")
    return tuple(_text(v, f"{where}[{i}]") for i, v in enumerate(value))


def _number(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < 1e6:
        raise InvalidInputError(where, f"{value!r} is no number from 0", "Give a number that is not negative")
    return value


def _one_of(value: object, known: tuple[str, ...], where: str) -> Any:  # noqa: ANN401 - the literal that was matched
    if value not in known:
        raise InvalidInputError(where, f"{value!r} is unknown", f"Use one of {', '.join(known)}")
    return value


def _groups(value: object) -> tuple[ObjectGroup, ...]:
    if not isinstance(value, list) or not value:
        raise InvalidInputError("template.object_groups", "it is no list of groups", "Give at least one group")
    groups = []
    for i, form in enumerate(value):
        where = f"template.object_groups[{i}]"
        _exactly(form, tuple(f.name for f in fields(ObjectGroup)), where)
        count = form["count_range"]
        if not isinstance(count, list | tuple) or len(count) != 2 or not all(type(c) is int for c in count):
            raise InvalidInputError(f"{where}.count_range", f"{count!r}", "Give two whole numbers")
        if not 0 <= count[0] <= count[1]:
            raise InvalidInputError(f"{where}.count_range", f"{count!r}", "Give the smaller number first, from 0")
        groups.append(
            ObjectGroup(
                _text(form["group_id"], f"{where}.group_id"),
                _text(form["description"], f"{where}.description"),
                _texts(form["allowed_types"], f"{where}.allowed_types"),
                (count[0], count[1]),
                _one_of(form["role"], get_args(Role), f"{where}.role"),
            )
        )
    if len({g.group_id for g in groups}) < len(groups):
        raise InvalidInputError("template.object_groups", "two groups have the same group_id", "Name each differently")
    return tuple(groups)
