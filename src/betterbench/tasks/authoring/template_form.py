"""JSON format of templates, for people and models that write scenarios."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, Field, TypeAdapter

from betterbench.errors import InvalidInputError, one_line
from betterbench.json_form import json_schema_of, read_form, strict_form
from betterbench.tasks.authoring.template import Meta, ObjectGroup, Order, Protocol, Template
from betterbench.tasks.condition import Role
from betterbench.tasks.relations import RELATIONS

SCHEMA_VERSION = 1
"""Version of the JSON form."""

_CURE = "Compare it with the output of template_to_json for a template of the suite"

_Text = Annotated[str, Field(min_length=1, pattern=r"\S")]
_Steps = Annotated[int, Field(ge=0, lt=10**6)]
_Count = Annotated[int, Field(ge=0)]

NumberT = TypeVar("NumberT", int, float)


def ascending(span: tuple[NumberT, NumberT]) -> tuple[NumberT, NumberT]:
    """Return the two ends of a span. Raises ValueError if the first is larger than the second."""
    if span[0] > span[1]:
        raise ValueError(f"{list(span)} must begin with the smaller number")
    return span


def _known_relation(name: str) -> str:
    if name not in RELATIONS:
        raise ValueError(f"there is no relation {name!r}; the relations are {', '.join(sorted(RELATIONS))}")
    return name


@strict_form
@dataclass(frozen=True, slots=True)
class _Group:
    group_id: _Text
    description: _Text
    allowed_types: tuple[_Text, ...]
    count_range: Annotated[tuple[_Count, _Count], AfterValidator(ascending)]
    role: Role


@strict_form
@dataclass(frozen=True, slots=True)
class _Meta:
    name: _Text
    title: _Text
    description: _Text
    challenge: _Text
    goal: _Text
    premise: _Text


@strict_form
@dataclass(frozen=True, slots=True)
class _Protocol:
    dwell_s: Annotated[float, Field(ge=0.0, lt=1e6)]
    base_steps: _Steps
    steps_per_subgoal: _Steps
    still_steps: _Steps


@strict_form
@dataclass(frozen=True, slots=True)
class _Form:
    schema_version: Literal[1]
    meta: _Meta
    object_groups: Annotated[tuple[_Group, ...], Field(min_length=1)]
    relations: Annotated[tuple[Annotated[str, AfterValidator(_known_relation)], ...], Field(min_length=1)]
    exclusive: bool
    order: Order
    regions: tuple[str, ...]
    tolerances: dict[str, float]
    protocol: _Protocol


_FORM = TypeAdapter(_Form)


def template_schema() -> dict[str, Any]:
    """Return the JSON schema for the JSON form of a template."""
    return json_schema_of(_FORM, title="Template")


def template_to_json(template: Template) -> dict[str, Any]:
    """Return a template as a JSON-serializable dict."""
    return {
        "schema_version": SCHEMA_VERSION,
        "meta": {f.name: getattr(template, f.name) for f in fields(Meta)},
        "object_groups": [asdict(group) for group in template.groups],
        "relations": [template.relation, *template.also],
        "exclusive": template.exclusive,
        "order": template.order,
        "regions": list(template.regions),
        "tolerances": template.tolerances,
        "protocol": {f.name: getattr(template, f.name) for f in fields(Protocol)},
    }


def template_from_json(form: Mapping[str, Any]) -> Template:
    """Read a template from JSON.

    Raises:
        InvalidInputError: If a field is missing, unknown, of the wrong type or out of range. The message names the path
            of the field.
    """
    read = read_form(_FORM, dict(form), where="template", cure=_CURE)
    relation, *also = read.relations
    template = Template(
        **asdict(read.meta),
        **asdict(read.protocol),
        groups=tuple(ObjectGroup(**asdict(group)) for group in read.object_groups),
        relation=relation,
        also=tuple(also),
        exclusive=read.exclusive,
        order=read.order,
    )
    names = [group.group_id for group in template.groups]
    if len(set(names)) < len(names):
        raise InvalidInputError("template.object_groups", "two groups have the same group_id", _CURE)
    for key, derived in (("regions", list(template.regions)), ("tolerances", template.tolerances)):
        if form[key] != derived:
            shown = one_line(repr(form[key]), most=200)
            raise InvalidInputError(
                f"template.{key}", f"is {shown}", f"Use {derived}, the value that follows from the relations"
            )
    return template
