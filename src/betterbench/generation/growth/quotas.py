"""Quotas of a growing suite: minimum and maximum amounts for templates, axes, contexts and difficulties."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal, Protocol, cast, get_args

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, UnknownNameError, one_line
from betterbench.generation.growth.difficulty import Difficulty
from betterbench.generation.scenario_form import LONGEST_NAME, plain_text
from betterbench.json_form import json_schema_of, read_form, strict_form
from betterbench.tasks import Axis
from betterbench.tasks.authoring.templates import TEMPLATES

Kind = Literal["template", "axis", "context", "difficulty"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""Properties that can have quotas. A quota of an axis counts variations, all other quotas count tasks."""

AXIS_NAMES: Mapping[str, Axis] = {
    "spatial": Axis.SPATIAL_LAYOUT_SHIFT,
    "recomposition": Axis.PRIMITIVE_RECOMPOSITION,
    "object": Axis.ADVERSARIAL_OBJECT_PERTURBATION,
    "temporal": Axis.TEMPORAL_EXTRAPOLATION,
}
"""Short names of the axes in quotas. The complete names are allowed too."""

_AMOUNT_PATTERN = r"^\d{1,6}(\.\d+)?%?(-\d{1,6}(\.\d+)?%?)?$"
_AMOUNT = re.compile(r"(\d{1,6}(?:\.\d+)?)(%?)(?:-(\d{1,6}(?:\.\d+)?)(%?))?")
_EXAMPLE = "Write PROPERTY=VALUE:AMOUNT, such as template=loose_packing:20%, context=kitchen:3-5 or axis=temporal:15%"


@dataclass(frozen=True, slots=True)
class Quota:
    """Minimum and maximum amount of tasks or variations with a property.

    For example, at least 20 % of the tasks must use one template.

    Attributes:
        kind: Property, such as "template".
        value: Value of the property, such as the name of a template.
        least: Minimum amount, as a percentage or a count.
        most: Maximum amount in the same unit, or None if there is no maximum.
        in_percent: Whether the amounts are percentages: of all variations for an axis, or of all tasks for any other
            property.
    """

    kind: Kind
    value: str
    least: float
    most: float | None = None
    in_percent: bool = True

    @property
    def name(self) -> str:
        """Property and value, as written in the option ("template=loose_packing")."""
        return f"{self.kind}={self.value}"

    def __str__(self) -> str:
        """Return the quota as it is written in the option ("template=loose_packing:20%")."""
        unit = "%" if self.in_percent else ""
        amounts = [self.least] if self.most is None else [self.least, self.most]
        return f"{self.name}:{'-'.join(f'{amount:g}{unit}' for amount in amounts)}"

    def least_of(self, total: int) -> int:
        """Return the minimum number of tasks or variations that the quota requires, given their total number."""
        return math.ceil(self.least * total / 100.0 - 1e-9) if self.in_percent else int(self.least)

    def most_of(self, total: int) -> int:
        """Return the maximum number of tasks or variations that the quota allows, given their total number."""
        if self.most is None:
            return total
        return math.floor(self.most * total / 100.0 + 1e-9) if self.in_percent else int(self.most)


def parse_quota(text: str, *, where: str = "--quota") -> Quota:
    """Parse a quota such as ``template=loose_packing:20%``, ``context=kitchen:3-5`` or ``axis=temporal:15%``.

    A single amount is the minimum. Two amounts are the minimum and the maximum.

    Raises:
        InvalidInputError: If the text is malformed, or the amounts contradict each other.
        UnknownNameError: If the property or its value does not exist.
    """
    found = re.fullmatch(r"([^=]+)=(.+):([^:]+)", text.strip())
    if found is None:
        raise InvalidInputError(where, f"{one_line(text, most=80)!r} is not a quota", _EXAMPLE)
    kind, value, amount = (part.strip() for part in found.groups())
    if kind not in KINDS:
        raise UnknownNameError("property of a quota", kind, KINDS)
    return _quota(cast("Kind", kind), value, amount, where)


def _quota(kind: Kind, value: str, amount: str, where: str) -> Quota:
    place = f"{where} {kind}={one_line(value, most=80)}"
    found = _AMOUNT.fullmatch(amount.replace(" ", ""))
    if found is None:
        raise InvalidInputError(
            place, f"{one_line(amount, most=80)!r} is not an amount", "Write an amount such as 20%, 10%-30%, 5 or 3-8"
        )
    least, unit, most, other = found.groups()
    if most is not None and unit != other and unit:
        raise InvalidInputError(
            place, f"{amount!r} mixes a percentage and a count", "Write a range such as 10%-30% or 3-8"
        )
    in_percent = bool(unit or other)
    low, high = float(least), None if most is None else float(most)
    if kind == "axis" and not in_percent:
        raise InvalidInputError(place, f"{amount!r} is a count", "Write a percentage of all variations, such as 15%")
    if in_percent and max(low, high or 0.0) > 100.0:
        raise InvalidInputError(place, f"{amount!r} is more than 100%", "Use at most 100%")
    if not in_percent and not (low.is_integer() and (high is None or high.is_integer())):
        raise InvalidInputError(
            place, f"{amount!r} is not a whole number of tasks", "Write a whole number, or a percentage"
        )
    if high is not None and low > high:
        raise InvalidInputError(
            place, f"in {amount!r}, the lower limit is above the upper limit", "Write the lower limit first"
        )
    return Quota(kind, _known(kind, value, place), low, high, in_percent)


def _known(kind: Kind, value: str, place: str) -> str:
    """Return the full name of the value in a quota. Raise UnknownNameError if the value does not exist."""
    if kind == "context":
        _require_context(value, place)
        return value
    if kind == "axis" and value in AXIS_NAMES:
        return AXIS_NAMES[value].value
    known: Mapping[Kind, Collection[str]] = {
        "template": TEMPLATES,
        "difficulty": [level.value for level in Difficulty],
        "axis": [*AXIS_NAMES, *(axis.value for axis in Axis)],
    }
    if value not in known[kind]:
        raise UnknownNameError(kind, value, known[kind])
    return value


def _require_context(value: str, place: str) -> None:
    try:
        plain_text(value)
    except ValueError as error:
        raise InvalidInputError(
            place, f"the context {error}", "Write the context as plain words, such as kitchen"
        ) from error
    if len(value) > LONGEST_NAME:
        raise InvalidInputError(
            place, f"the context has {len(value)} characters", f"Write at most {LONGEST_NAME} characters"
        )


_Amount = Annotated[str, Field(pattern=_AMOUNT_PATTERN)]


@strict_form
@dataclass(frozen=True, slots=True)
class _Quotas:
    template: dict[str, _Amount] = field(default_factory=dict)
    axis: dict[str, _Amount] = field(default_factory=dict)
    context: dict[str, _Amount] = field(default_factory=dict)
    difficulty: dict[str, _Amount] = field(default_factory=dict)


_QUOTAS = TypeAdapter(_Quotas)


def quotas_schema() -> dict[str, Any]:
    """Return the JSON schema of a file with quotas."""
    return json_schema_of(_QUOTAS, title="Quotas")


def quotas_from_form(form: Mapping[str, Any], *, where: str) -> tuple[Quota, ...]:
    """Return the quotas given by the fields of a file, such as ``{"template": {"loose_packing": "20%"}}``.

    Raises:
        InvalidInputError: If a field or an amount is malformed.
        UnknownNameError: If a value does not exist.
    """
    read = read_form(_QUOTAS, form, where=where, cure='Write fields like `template: {loose_packing: "20%"}`')
    return tuple(
        _quota(cast("Kind", part.name), value, amount, where)
        for part in fields(read)
        for value, amount in getattr(read, part.name).items()
    )


class Supply(Protocol):
    """Templates, contexts and number of the scenarios that an author can write."""

    @property
    def templates(self) -> Sequence[str]:
        """Names of the templates that the author can use."""

    def contexts(self) -> Collection[str] | None:
        """Return the contexts of the scenarios, or None if any context is possible."""

    def goals(self, templates: Collection[str], context: str | None = None) -> int | None:
        """Return the number of scenarios with different goals for some templates, or None if it is unlimited."""


def require_consistent(quotas: Sequence[Quota], until: int, supply: Supply, *, best_share: Mapping[str, float]) -> None:
    """Check that quotas are consistent with each other, with the number of tasks, and with the author's supply.

    Args:
        quotas: Quotas to check.
        until: Requested number of tasks.
        supply: Scenarios that the author can write.
        best_share: For each axis, the largest fraction of a task's variations that are on this axis, over all allowed
            templates.

    Raises:
        InvalidInputError: For the first contradiction.
        UnknownNameError: If the author has no scenario for a template or a context.
    """
    _require_each_once(quotas)
    _require_known_to(supply, quotas)
    for kind in KINDS:
        _require_room(kind, [q for q in quotas if q.kind == kind], until, supply)
    _require_supply(quotas, until, supply)
    for quota in quotas:
        if quota.kind == "axis" and quota.least > 100.0 * best_share[quota.value] + 1e-9:
            share = f"{100.0 * best_share[quota.value]:.0f}%"
            problem = f"the variations of the allowed templates have at most {share} on this axis"
            raise InvalidInputError(f"--quota {quota}", problem, f"Request {share} or less")


def _require_each_once(quotas: Sequence[Quota]) -> None:
    for name, count in Counter(quota.name for quota in quotas).items():
        if count > 1:
            both = " and ".join(str(q) for q in quotas if q.name == name)
            raise InvalidInputError("--quota", f"{name} occurs {count} times ({both})", "Use only one of these quotas")


def _require_known_to(supply: Supply, quotas: Sequence[Quota]) -> None:
    contexts = supply.contexts()
    for quota in quotas:
        if quota.kind == "template" and quota.value not in supply.templates:
            raise UnknownNameError("template of this command", quota.value, supply.templates)
        if quota.kind == "context" and contexts is not None and quota.value not in contexts:
            raise UnknownNameError("context of the grammar", quota.value, contexts)


def _require_room(kind: Kind, quotas: Sequence[Quota], until: int, supply: Supply) -> None:
    """Check that the minimums of all values of a property can be met together, and the maximums as well.

    A task or variation has only one value of the property, so the amounts of the values add up.
    """
    listed = ", ".join(map(str, quotas))
    if kind == "axis":
        total, unit = 100, "% of the variations"
        leasts = [q.least for q in quotas]
        mosts = [100.0 if q.most is None else q.most for q in quotas]
        names = len(Axis)
    else:
        total, unit = until, " tasks"
        leasts, mosts = [q.least_of(until) for q in quotas], [q.most_of(until) for q in quotas]
        names = {"template": len(supply.templates), "difficulty": len(Difficulty), "context": -1}[kind]
    if sum(leasts) > total:
        problem = f"these quotas need {sum(leasts):g}{unit}, but there are only {total}: {listed}"
        raise InvalidInputError("--quota", problem, "Lower one of these quotas, or raise --until")
    for quota, least, most in zip(quotas, leasts, mosts, strict=True):
        if least > most:
            problem = f"requires at least {least:g} and at most {most:g} of {until} tasks"
            raise InvalidInputError(f"--quota {quota}", problem, "Widen the range, or raise --until")
    if len(quotas) == names and sum(mosts) < total:
        problem = f"these quotas allow only {sum(mosts):g}{unit}, but there are {total}: {listed}"
        raise InvalidInputError("--quota", problem, "Raise the upper limit of one of these quotas")


def _require_supply(quotas: Sequence[Quota], until: int, supply: Supply) -> None:
    """Check that the author has enough scenarios for each quota and for all tasks."""
    most = {q.value: q.most_of(until) for q in quotas if q.kind == "template"}
    open_templates = [t for t in supply.templates if most.get(t, until) > 0]
    for quota in quotas:
        if quota.kind == "template":
            found = supply.goals([quota.value])
        elif quota.kind == "context":
            found = supply.goals(open_templates, quota.value)
        else:
            continue
        least = quota.least_of(until)
        if found is not None and found < least:
            problem = f"needs {least} tasks, but the offline author has only {found} different goals for it"
            raise InvalidInputError(
                f"--quota {quota}", problem, f"Request {found} tasks or fewer, or use a model with --model"
            )
    limits = [(supply.goals([t]), most.get(t, until)) for t in supply.templates]
    if all(goals is not None for goals, _ in limits):
        total = sum(min(goals or 0, top) for goals, top in limits)
        if total < until:
            problem = f"needs {until} tasks, but the offline author has only {total} different goals for these quotas"
            cure = f"Request {total} tasks or fewer, add --distinct colors, or use a model with --model"
            raise InvalidInputError("--until", problem, cure)
