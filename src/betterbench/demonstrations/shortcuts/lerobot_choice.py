"""Choose the gripper and position components of a LeRobot data set by their names.

If the names are ambiguous, the data set is rejected. The error message names the option for choosing a component.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from betterbench.demonstrations.shortcuts.numbers import (
    NamedNumber,
    NumberRole,
    arm_in,
    named_numbers,
    parts_of,
    tokens,
)
from betterbench.errors import InvalidInputError, one_line

MOST_SHOWN = 8
STEPS = "+"
"""Prefix of a ``--place`` component that is a displacement per step.

The positions are the sums of these displacements.
"""

_ACTIONS = ("action", "actions")
_STATES = ("observation.state", "state")
_NO_STATE = {"environment", "env", "images", "image", "goal", "target", "object", "depth"}


@dataclass(frozen=True, slots=True)
class Columns:
    """Components of a data set's columns, and the role of each component.

    Attributes:
        numbers: Components of each column.
        parts: Roles of the components of each column.
        where: File that contains the names of the components.
        steps: Whether the actions are known to be displacements of the tool, so that their sums are positions.
    """

    numbers: Mapping[str, tuple[NamedNumber, ...]]
    parts: Mapping[str, Sequence[NumberRole]]
    where: str
    steps: bool = False

    @classmethod
    def of(cls, numbers: Mapping[str, tuple[NamedNumber, ...]], where: str, *, steps: bool) -> Columns:
        """Determine the role of each component from its name."""
        return cls(numbers, {name: parts_of(found) for name, found in numbers.items()}, where, steps)

    @property
    def actions(self) -> list[str]:
        """Action columns. Columns with the complete action come before columns with a part of it."""
        other = [name for name in self.numbers if name.startswith(("action.", "actions."))]
        return [name for name in _ACTIONS if name in self.numbers] + sorted(other)

    @property
    def states(self) -> list[str]:
        """Proprioception columns. Columns with the complete state come before columns with a part of it."""
        usual = [name for name in _STATES if name in self.numbers]
        left = self.numbers.keys() - {*usual, *self.actions, "timestamp"}
        return usual + sorted(name for name in left if not _NO_STATE & set(tokens(name)))

    def pairs(self, column: str) -> list[tuple[NamedNumber, NumberRole]]:
        """Return the components of a column, each with its role."""
        return list(zip(self.numbers[column], self.parts[column], strict=True))


@dataclass(frozen=True, slots=True)
class Grip:
    """Component that measures the gripper opening of an arm, with the reason for choosing this component."""

    arm: str
    number: NamedNumber
    by: str


@dataclass(frozen=True, slots=True)
class ArmPlace:
    """Components of an arm's position, with the source of their names.

    Attributes:
        arm: Name of the arm; "" if unknown.
        numbers: The components.
        space: Kind of the values, see ``PlaceReading``.
        by: Source of the names that identified the components.
    """

    arm: str
    numbers: tuple[NamedNumber, ...]
    space: str
    by: str


def choose_grippers(columns: Columns, named: Sequence[str]) -> tuple[Grip, ...]:
    """Choose one gripper component per arm, either as specified by the user or by its name.

    Raises:
        InvalidInputError: If no component is recognized as a gripper, or an arm has two gripper components.
        UnknownNameError: If a component named by the user does not exist.
    """
    if named:
        return _named_grippers(columns, named)
    found: dict[str, Grip] = {}
    for kind, pool in itertools.product(("gripper", "finger"), (columns.actions, columns.states)):
        for column in () if found else pool:
            for grip in _grippers_in(columns, column, kind):
                found.setdefault(grip.arm, grip)
    if not found:
        raise InvalidInputError(columns.where, _why_no_gripper(columns), _cure_gripper(columns))
    if len(found) > 1 and "" in found:
        problem = f"only some grippers name their arm: {', '.join(grip.number.shown for grip in found.values())}"
        raise InvalidInputError(columns.where, problem, "Choose one component per arm with --gripper")
    return tuple(found[arm] for arm in sorted(found))


def _named_grippers(columns: Columns, named: Sequence[str]) -> tuple[Grip, ...]:
    found = []
    for text in named:
        numbers = named_numbers("--gripper", text, columns.numbers)
        if len(numbers) != 1:
            problem = f"{one_line(text, most=80)} has {len(numbers)} components"
            which = ", ".join(str(n.index) for n in numbers[:MOST_SHOWN]) + (
                ", ..." if len(numbers) > MOST_SHOWN else ""
            )
            cure = f"Choose one of them as COLUMN[N], where N is its index ({which})" if which else "Write an index"
            raise InvalidInputError("--gripper", problem, cure)
        found.append(Grip(_arm(numbers[0]), numbers[0], "--gripper"))
    if len({grip.arm for grip in found}) < len(found):
        found = [Grip(str(i), grip.number, grip.by) for i, grip in enumerate(found, start=1)]
    return tuple(found)


def _arm(number: NamedNumber) -> str:
    return next((arm for label in (*number.labels, number.column) if (arm := arm_in(label))), "")


def _grippers_in(columns: Columns, column: str, kind: str) -> list[Grip]:
    """Return the grippers in a column, one per arm. Raises InvalidInputError if an arm has two grippers.

    Args:
        columns: Components of the data set.
        column: Name of the column.
        kind: Role to look for, ``gripper`` or ``finger``.
    """
    by_arm: dict[str, list[tuple[NamedNumber, NumberRole]]] = {}
    hands = {part.arm for part in columns.parts[column] if part.kind == "hand"}
    for number, part in columns.pairs(column):
        if part.kind == kind and not (kind == "finger" and part.arm in hands):
            by_arm.setdefault(part.arm, []).append((number, part))
    found = []
    for arm, group in by_arm.items():
        bases = {re.sub(r"[\W_]*\d+\]?$", "", number.labels[0].lower()) for number, _ in group}
        if kind == "finger" and len(group) > 2:
            continue  # more than two finger components belong to a hand, not to a gripper
        # The two fingers of a gripper are adjacent and have the same name with two indices.
        apart = (
            len({number.labels[0] for number, _ in group}) < len(group) or group[-1][0].index > group[0][0].index + 1
        )
        if len(group) > 2 or (len(group) == 2 and (len(bases) > 1 or apart)):
            shown = ", ".join(f"{number.name} ({number.index})".strip() for number, _ in group[:MOST_SHOWN])
            problem = f"{len(group)} components of {column} are named like a gripper: {shown}"
            cure = f"Choose one with --gripper '{column}[N]', where N is its index in brackets"
            raise InvalidInputError(columns.where, problem, cure)
        number, part = group[0]
        _require_agreement(columns, number, part)
        found.append(Grip(arm, number, part.by + (", the first of two fingers" if len(group) == 2 else "")))
    return found


def _require_agreement(columns: Columns, number: NamedNumber, part: NumberRole) -> None:
    """Raise InvalidInputError if a component has several names that disagree on whether it is a gripper."""
    for label, by, kind in zip(number.labels, number.by, part.kinds, strict=True):
        if kind in ("body", "hand", "x", "y", "z") or (kind == "joint" and part.kinds[0] == "gripper"):
            problem = (
                f"{number.column}[{number.index}] is a gripper according to {part.by}, but "
                f"{one_line(label, most=80)!r} according to {by}"
            )
            raise InvalidInputError(
                columns.where, problem, "Correct one of these names, or choose the gripper with --gripper"
            )


def _why_no_gripper(columns: Columns) -> str:
    """Explain why no component is recognized as a gripper."""
    pool = columns.actions or columns.states
    if not pool:
        return "the dataset has no column action and no proprioception"
    numbers = columns.numbers[pool[0]]
    hands = [n.shown for n, part in columns.pairs(pool[0]) if part.kind in ("hand", "finger")]
    if hands:
        shown = ", ".join(hands[:3]) + (" and more" if len(hands) > 3 else "")
        return f"no component has the name of a gripper; {shown} belong to hands with several joints"
    unnamed = not any(n.name for n in numbers)
    tail = "its components have no names" if unnamed else f"none of its {len(numbers)} names is that of a gripper"
    return f"no component has the name of a gripper; {pool[0]} was searched first, and {tail}"


def _cure_gripper(columns: Columns) -> str:
    pool = columns.actions or columns.states
    column = pool[0] if pool else "COLUMN"
    counted = f" ({_span(len(columns.numbers[column]))})" if pool else ", counted from 0"
    told = f"--gripper '{column}[N]', where N is the index of the component that closes the gripper{counted}"
    return f"Choose the gripper with {told}, or with --gripper '{column}:NAME'"


def _span(count: int) -> str:
    return f"0 to {count - 1}"


def choose_places(columns: Columns, grips: Sequence[Grip], named: Sequence[str]) -> tuple[ArmPlace, ...]:
    """Choose the position components of each arm.

    If the user does not specify any, the position of the end effector is used. If the data set does not contain this
    position, the joint angles are used.

    Raises:
        InvalidInputError: If an arm has no position components, or several sets of position components.
        UnknownNameError: If a component named by the user does not exist.
    """
    if named:
        return _named_places(columns, grips, named)
    return tuple(_place_of(columns, grip, alone=len(grips) == 1) for grip in grips)


def _named_places(columns: Columns, grips: Sequence[Grip], named: Sequence[str]) -> tuple[ArmPlace, ...]:
    sums = {text.startswith(STEPS) for text in named}
    if len(sums) > 1:
        raise InvalidInputError(
            "--place",
            "only some components have the prefix +, which marks displacements",
            "Write + before all of them or before none",
        )
    numbers = [n for text in named for n in named_numbers("--place", text.removeprefix(STEPS), columns.numbers)]
    each, rest = divmod(len(numbers), len(grips))
    if rest or each < 2:
        problem = f"the number of components ({len(numbers)}) does not fit the number of grippers ({len(grips)})"
        raise InvalidInputError("--place", problem, "Name two or three components (x, y, z) for each gripper, in order")
    space = "steps" if sums == {True} else "position" if each <= 3 else "numbers"
    cut = [tuple(numbers[i * each : (i + 1) * each]) for i in range(len(grips))]
    return tuple(ArmPlace(grip.arm, some, space, "--place") for grip, some in zip(grips, cut, strict=True))


def _place_of(columns: Columns, grip: Grip, *, alone: bool) -> ArmPlace:
    """Choose the position components of one arm.

    Args:
        columns: Components of the data set.
        grip: Gripper of the arm.
        alone: Whether the data set has only this gripper.
    """
    states = columns.states
    for column in states:
        for arm in _arms(columns, column, "xyz", grip.arm, alone=alone):
            found = _axes(columns, column, arm)
            if found is not None:
                return ArmPlace(grip.arm, found[0], "position", found[1])
    for column in states:
        for arm in _arms(columns, column, ("joint",), grip.arm, alone=alone):
            joints = [(n, part) for n, part in columns.pairs(column) if part.kind == "joint" and part.arm == arm]
            if len(joints) >= 2:
                return ArmPlace(grip.arm, tuple(n for n, _ in joints), "joints", joints[0][1].by)
    if columns.steps and not states:
        for column in columns.actions:
            found = _axes(columns, column, grip.arm)
            if found is not None:
                return ArmPlace(
                    grip.arm, found[0], "steps", "names in meta/info.json; meta/betterbench.json says steps"
                )
    return _unnamed(columns, grip, alone=alone)


def _arms(columns: Columns, column: str, kinds: Sequence[str], arm: str, *, alone: bool) -> tuple[str, ...]:
    """Return the arm of a gripper, chosen from the arms with position components in a column.

    The result is a tuple with one name. It is empty if the column has no such components, or if the choice is
    ambiguous.

    Args:
        columns: Components of the data set.
        column: Column with position components.
        kinds: Roles of the position components.
        arm: Arm of the gripper; "" if unknown.
        alone: Whether the data set has only this gripper.
    """
    there = {part.arm for part in columns.parts[column] if part.kind in kinds}
    if arm in there and not (arm == "" and len(there) > 1):
        return (arm,)
    if alone and len(there) == 1 and (arm == "" or there == {""}):
        return tuple(there)
    return ()


def _axes(columns: Columns, column: str, arm: str) -> tuple[tuple[NamedNumber, ...], str] | None:
    """Return the components x, y and, if present, z of an arm, with the source of their names.

    Return None if x or y is missing. Raises InvalidInputError if an axis occurs twice.
    """
    found = {
        axis: [(n, part) for n, part in columns.pairs(column) if part.kind == axis and part.arm == arm]
        for axis in "xyz"
    }
    if not found["x"] or not found["y"]:
        return None
    for axis, numbers in found.items():
        if len(numbers) > 1:
            shown = ", ".join(f"{column}[{n.index}]" for n, _ in numbers[:MOST_SHOWN])
            of = f" of the {arm} arm" if arm else ""
            problem = f"{len(numbers)} components{of} have the name {axis}: {shown}"
            raise InvalidInputError(columns.where, problem, "Choose the components with --place, first x, then y")
    return tuple(n for axis in "xyz" for n, _ in found[axis]), found["x"][0][1].by


def _unnamed(columns: Columns, grip: Grip, *, alone: bool) -> ArmPlace:
    """Use all components of a state column as the position.

    The components must have no names, and there must be a single gripper.

    Raises InvalidInputError if there are several grippers, if some components have names, or if there is no state
    column.
    """
    syntax = "with your column and the indices of x, y and z, counted from 0"
    cure = f"Choose the position of the gripper with --place 'COLUMN[0,1,2]', {syntax}"
    if not columns.states:
        problem = "the dataset has no proprioception (observation.state)"
        more = f", or --place '+COLUMN[0,1,2]', {syntax}, if each action is a displacement of the tool"
        raise InvalidInputError(columns.where, problem, "Use a dataset with proprioception" + more)
    column = next((name for name in _STATES if name in columns.numbers), columns.states[0])
    pairs = columns.pairs(column)
    left = [n for n, part in pairs if part.kind not in ("gripper", "finger") and n != grip.number]
    if not left:
        raise InvalidInputError(
            columns.where, f"all components of {column} belong to the gripper", "Correct the names of these components"
        )
    telling = [(n, part) for n, part in pairs if part.kind in ("x", "y", "z", "joint", "body", "hand")]
    if not alone or telling:
        of = f"the {grip.arm} arm" if grip.arm else "the gripper"
        problem = f"no component has a name for the position of {of} ({grip.number.shown} is its gripper)"
        own = [n for n, part in telling if part.arm in (grip.arm, "") or not grip.arm]
        if own:
            problem += f"; {column} has {', '.join(n.shown for n in own[:MOST_SHOWN])}"
        raise InvalidInputError(columns.where, problem, cure)
    return ArmPlace(grip.arm, tuple(left), "numbers", f"{column} has no usable names")


def polarity_of(number: NamedNumber) -> tuple[str, str] | None:
    """Return the closed end of a gripper's range (``low`` or ``high``) according to the gripper's name, and the reason.

    Return None if the name does not imply either end.
    """
    for label in number.labels:
        words = set(tokens(label))
        opened = words & {"open", "opened", "opening", "openness", "width", "aperture", "gap", "distance"}
        closed = words & {"close", "closed", "closing", "closure", "closedness"}
        if bool(opened) != bool(closed):
            word = min(opened or closed)
            return ("low" if opened else "high"), f"its name has “{word}”"
    return None
