"""The 34 subtasks of CALVIN as data: instruction, category, preconditions, changes and success rule."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from betterbench.errors import UnknownNameError
from betterbench.json_form import read_form, strict_form

SymbolValue = str | int
"""Value in a symbolic state: "table", "open", 0, 1."""

SymbolicState = Mapping[str, SymbolValue]
"""Symbolic state of the scene.

The keys are led, lightbulb, slider, drawer, red_block, blue_block, pink_block and grasped.
"""


@strict_form
@dataclass(frozen=True, slots=True)
class Change:
    """Symbolic effect of a subtask.

    Attributes:
        when: Values that the state must have for this effect. Each is a single value or a list of alternatives.
        then: Values that the state has afterward.
    """

    when: dict[str, SymbolValue | list[SymbolValue]]
    then: dict[str, SymbolValue]

    def allowed(self, state: SymbolicState) -> bool:
        """Return whether a state has the values that this change requires before it can happen."""
        return all(
            state[key] in wanted if isinstance(wanted, list) else state[key] == wanted
            for key, wanted in self.when.items()
        )


@strict_form
@dataclass(frozen=True, slots=True)
class Rotate:
    """Success rule: the block was rotated about the vertical axis by more than ``degrees`` (positive to the left).

    The block must not be tilted and must have stayed in place.
    """

    kind: Literal["rotate"]
    block: str
    degrees: float


@strict_form
@dataclass(frozen=True, slots=True)
class Push:
    """Success rule: the block moved along x by more than ``along_x_m`` (positive to the right) and kept its support."""

    kind: Literal["push"]
    block: str
    along_x_m: float


@strict_form
@dataclass(frozen=True, slots=True)
class MoveDoor:
    """Success rule: a joint moved by more than ``by_m``, in the direction given by the sign of ``by_m``."""

    kind: Literal["move_door"]
    door: str
    by_m: float


@strict_form
@dataclass(frozen=True, slots=True)
class Lift:
    """Success rule: the block was on a table link, is now more than ``by_m`` higher, and touches only the robot."""

    kind: Literal["lift"]
    block: str
    by_m: float
    link: str


@strict_form
@dataclass(frozen=True, slots=True)
class Place:
    """Success rule: the block touched only the robot, and now touches a link of the table but not the robot."""

    kind: Literal["place"]
    link: str


@strict_form
@dataclass(frozen=True, slots=True)
class PushInto:
    """Success rule: the block touched only one link of the table, and now touches a different link."""

    kind: Literal["push_into"]
    from_link: str
    link: str


@strict_form
@dataclass(frozen=True, slots=True)
class StackBlocks:
    """Success rule: a block touched no other block before. Now it touches only blocks, and is at rest."""

    kind: Literal["stack"]


@strict_form
@dataclass(frozen=True, slots=True)
class UnstackBlocks:
    """Success rule: a block was at rest and touched only other blocks before. Now it touches no other block."""

    kind: Literal["unstack"]


@strict_form
@dataclass(frozen=True, slots=True)
class Switch:
    """Success rule: a light changed from one given state to the other."""

    kind: Literal["switch"]
    light: str
    before: int
    after: int


Rule = Rotate | Push | MoveDoor | Lift | Place | PushInto | StackBlocks | UnstackBlocks | Switch


@strict_form
@dataclass(frozen=True, slots=True)
class Subtask:
    """Subtask of CALVIN, with its instruction, success rule and symbolic changes.

    Attributes:
        name: CALVIN's name ("open_drawer").
        instruction: Instruction used in the evaluation. It is the first one in ``new_playtable_validation.yaml``.
        category: Category of the subtask. A chain never has two subtasks of the same category.
        rule: Success rule.
        changes: Possible changes of the state. A chain contains only subtasks with exactly one possible change.
    """

    name: str
    instruction: str
    category: int
    rule: Annotated[Rule, Field(discriminator="kind")]
    changes: list[Change]

    def after(self, state: SymbolicState) -> SymbolicState | None:
        """Return the state after this subtask. The result is None if no change or more than one change is possible."""
        ways = [change for change in self.changes if change.allowed(state)]
        return MappingProxyType({**state, **ways[0].then}) if len(ways) == 1 else None


@strict_form
@dataclass(frozen=True, slots=True)
class _File:
    source: str
    subtasks: list[Subtask]


@cache
def subtasks() -> tuple[Subtask, ...]:
    """Return all subtasks in CALVIN's order. The order determines which chains are drawn."""
    text = resources.files("betterbench.tasks.worlds.calvin").joinpath("data/subtasks.json").read_bytes()
    return tuple(read_form(TypeAdapter(_File), text, where="subtasks.json", cure="Install betterbench again").subtasks)


@cache
def _by_name() -> Mapping[str, Subtask]:
    return MappingProxyType({subtask.name: subtask for subtask in subtasks()})


def subtask_named(name: str) -> Subtask:
    """Return a subtask by its name.

    Raises:
        UnknownNameError: If CALVIN has no subtask with this name.
    """
    if name not in _by_name():
        raise UnknownNameError("CALVIN subtask", name, _by_name())
    return _by_name()[name]
