"""The form of an intervention: a function on conditions and its declaration of what it changes."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.tasks import Condition


@dataclass(frozen=True, slots=True)
class Changes:
    """What an intervention declares to change; everything else stays bit-identical between a trial and its twin.

    Attributes:
        objects: Names of objects whose presence, identity or place changes.
        language: True if the sentence and what it asks for change.
    """

    objects: frozenset[str] = frozenset()
    language: bool = False

    def __or__(self, other: Changes) -> Changes:
        """Return the changes of both."""
        return Changes(self.objects | other.objects, self.language or other.language)


Operation = Callable[..., tuple[Condition, Changes]]

_OPERATIONS: dict[str, Operation] = {}


def operation(function: Operation) -> Operation:
    """Register an operation under the function's name."""
    _OPERATIONS[function.__name__] = function
    return function


def run_operation(condition: Condition, name: str, arguments: Mapping[str, Any]) -> tuple[Condition, Changes]:
    """Carry out one operation.

    Args:
        condition: The condition to change.
        name: Name of the operation.
        arguments: Its arguments.

    Returns:
        The changed condition and what was declared to change.

    Raises:
        UnknownNameError: If there is no such operation.
        InvalidInputError: If an argument is missing or unknown.
    """
    try:
        function = _OPERATIONS[name]
    except KeyError:
        raise UnknownNameError("intervention", name, _OPERATIONS) from None
    signature = inspect.signature(function)
    try:
        signature.bind(condition, **arguments)
    except TypeError as error:
        wanted = ", ".join(list(signature.parameters)[1:])
        raise InvalidInputError(f"{condition.id} {name}", str(error), f"Give exactly {wanted}") from None
    return function(condition, **arguments)


def operation_names() -> tuple[str, ...]:
    """Return the names of all operations, sorted."""
    return tuple(sorted(_OPERATIONS))
