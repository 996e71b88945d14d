"""Intervention operations as typed values, such as ``swap(APPLE, ORANGE)``.

An operation is a pure function that maps a condition to a changed condition and declares the changes.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Concatenate, ParamSpec

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.tasks.condition import Condition, ObjectSpec, Slot, TargetRegion
from betterbench.tasks.subgoal import Instruction


@dataclass(frozen=True, slots=True)
class Changes:
    """Changes that an operation declares.

    Apart from these changes, a trial and its twin (the trial without the operation) have bit-identical initial states.

    Attributes:
        objects: Names of the objects that are added, removed, replaced or moved.
        language: Whether the instruction and its subgoals change.
    """

    objects: frozenset[str] = frozenset()
    language: bool = False

    def __or__(self, other: Changes) -> Changes:
        """Return the union of the changes that the two operations declare."""
        return Changes(self.objects | other.objects, self.language or other.language)


Result = tuple[Condition, Changes]
P = ParamSpec("P")


@dataclass(frozen=True, slots=True)
class Operation:
    """Operation that changes a condition, with its arguments.

    Two operations are equal if their names and arguments are equal.

    Attributes:
        name: Name of the operation.
        arguments: Arguments of the operation, keyed by name.
        carry_out: Function that takes a condition and returns the changed condition and the declared changes.
    """

    name: str
    arguments: Mapping[str, Any]
    carry_out: Callable[[Condition], Result] = field(compare=False, repr=False)

    def __str__(self) -> str:
        """Return a short text for the operation, such as ``do(swap a=burger_1 b=fries)``."""
        shown = (f"{k}={getattr(v, 'text', getattr(v, 'name', v))}" for k, v in self.arguments.items())
        return f"do({' '.join((self.name, *shown))})"


_CONSTRUCTORS: dict[str, Callable[..., Operation]] = {}


def operation_names() -> tuple[str, ...]:
    """Return the names of all operations, sorted."""
    return tuple(sorted(_CONSTRUCTORS))


def operation_named(name: str) -> Callable[..., Operation]:
    """Return the constructor of an operation.

    The constructor's signature shows the condition as the first parameter, but the condition is not passed to the
    constructor.

    Raises:
        UnknownNameError: If there is no such operation.
    """
    if name not in _CONSTRUCTORS:
        raise UnknownNameError("operation", name, _CONSTRUCTORS)
    return _CONSTRUCTORS[name]


def operation(function: Callable[Concatenate[Condition, P], Result]) -> Callable[P, Operation]:
    """Turn a function that changes a condition into a constructor of operations.

    The constructor takes the same arguments as the function, except for the condition.
    """
    signature = inspect.signature(function)
    name = function.__name__

    @functools.wraps(function)
    def make(*args: P.args, **kwargs: P.kwargs) -> Operation:
        given = signature.bind(None, *args, **kwargs).arguments
        arguments = {key: value for key, value in given.items() if key != "condition"}
        return Operation(name, arguments, lambda condition: function(condition, *args, **kwargs))

    _CONSTRUCTORS[name] = make
    return make


@operation
def swap(condition: Condition, a: ObjectSpec, b: ObjectSpec) -> Result:
    """Exchange the slots of two objects."""
    layout = dict(condition.layout)
    for o in (a, b):
        _require_slot(condition, o)
    layout[a.name], layout[b.name] = layout[b.name], layout[a.name]
    return condition.with_(layout=layout), Changes(frozenset({a.name, b.name}))


@operation
def move(condition: Condition, object: ObjectSpec, slot: Slot) -> Result:  # noqa: A002 - the word of do()
    """Move an object from its slot to a free slot."""
    _require_slot(condition, object)
    _require_free(condition, slot.name)
    return condition.with_(layout={**condition.layout, object.name: slot.name}), Changes(frozenset({object.name}))


@operation
def preplace(condition: Condition, object: ObjectSpec, target: ObjectSpec, region: str = "") -> Result:  # noqa: A002
    """Place an object at a target in the initial state. If the target has several regions, ``region`` names one."""
    _require_slot(condition, object)
    condition.object(target.name)
    layout = {name: slot for name, slot in condition.layout.items() if name != object.name}
    preplaced = {**condition.preplaced, object.name: TargetRegion(target.name, region)}
    return condition.with_(layout=layout, preplaced=preplaced), Changes(frozenset({object.name}))


@operation
def draw_out(condition: Condition, drawer: ObjectSpec, distance_m: float) -> Result:
    """Open a drawer by ``distance_m`` in the initial state. A distance of 0 closes it."""
    if condition.object(drawer.name).mount is None:
        raise _refused(condition, drawer, "it is not a drawer", "Use a drawer, i.e. an object with a mount")
    if not distance_m >= 0.0:
        raise InvalidInputError(
            f"{condition.id} distance_m",
            f"{distance_m} m is out of range",
            "Use a distance of at least 0 m (0 closes the drawer)",
        )
    return condition.with_(opened={**condition.opened, drawer.name: distance_m}), Changes(frozenset({drawer.name}))


@operation
def remove(condition: Condition, object: ObjectSpec) -> Result:  # noqa: A002
    """Remove an object from the scene. It must not contain a drawer, and no other object may be placed on or in it."""
    name = condition.object(object.name).name
    guests = [o.name for o in condition.objects if o.mount is not None and o.mount.target == name]
    guests += [guest for guest, place in condition.preplaced.items() if place.target == name]
    if guests:
        raise _refused(condition, object, f"it holds {guests[0]}", "Remove that object first")
    changed = condition.with_(
        objects=tuple(o for o in condition.objects if o.name != name),
        layout={n: slot for n, slot in condition.layout.items() if n != name},
        preplaced={n: place for n, place in condition.preplaced.items() if n != name},
        opened={n: opening for n, opening in condition.opened.items() if n != name},
    )
    return changed, Changes(frozenset({name}))


@operation
def add(condition: Condition, object: ObjectSpec, slot: Slot) -> Result:  # noqa: A002
    """Add an object in a free slot."""
    return _added(condition, object, slot.name)


@operation
def replace(condition: Condition, object: ObjectSpec, by: ObjectSpec) -> Result:  # noqa: A002
    """Replace an object with another object in the same slot."""
    _require_slot(condition, object)
    removed, first = remove(object).carry_out(condition)
    added, second = _added(removed, by, condition.layout[object.name])
    return added, first | second


@operation
def instruct(condition: Condition, instruction: Instruction) -> Result:
    """Change the instruction and leave the scene as it is."""
    return condition.with_(instruction=instruction), Changes(language=True)


@operation
def repeat(condition: Condition, instruction: Instruction) -> Result:
    """Repeat a step of the instruction more often than in training. A subgoal then occurs twice."""
    if len({goal.reference for goal in instruction.subgoals}) == len(instruction.subgoals):
        raise InvalidInputError(
            f"{condition.id} repeat", "no subgoal is repeated", "Use the operation 'chain' or 'instruct' instead"
        )
    return condition.with_(instruction=instruction), Changes(language=True)


@operation
def chain(condition: Condition, instruction: Instruction) -> Result:
    """Replace the instruction with a longer one, which has more steps than that of the training condition."""
    if len(instruction.subgoals) <= len(condition.instruction.subgoals):
        raise InvalidInputError(
            f"{condition.id} chain", "the new instruction is not longer", "Use the operation 'instruct' instead"
        )
    return condition.with_(instruction=instruction), Changes(language=True)


def _added(condition: Condition, spec: ObjectSpec, slot: str) -> Result:
    _require_free(condition, slot)
    if any(o.name == spec.name for o in condition.objects):
        raise _refused(condition, spec, "an object with this name already exists", "Choose a different name")
    layout = {**condition.layout, spec.name: slot}
    return condition.with_(objects=(*condition.objects, spec), layout=layout), Changes(frozenset({spec.name}))


def _require_free(condition: Condition, slot: str) -> None:
    occupant = condition.occupant(slot)
    if occupant is not None:
        what = f"it already contains {occupant}"
        raise InvalidInputError(f"{condition.id} slot {slot!r}", what, "Remove or move that object first")


def _require_slot(condition: Condition, spec: ObjectSpec) -> None:
    condition.object(spec.name)
    if spec.name not in condition.layout:
        raise _refused(condition, spec, "it does not start in a slot", "Use an object that starts in a slot")


def _refused(condition: Condition, spec: ObjectSpec, problem: str, cure: str) -> InvalidInputError:
    return InvalidInputError(f"{condition.id} object {spec.name!r}", problem, cure)
