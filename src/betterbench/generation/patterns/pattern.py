"""The registry of patterns."""

from collections.abc import Callable
from dataclasses import dataclass

from betterbench.errors import UnknownNameError
from betterbench.generation.cast import Cast
from betterbench.tasks.authoring import Task
from betterbench.tasks.authoring.template import Template
from betterbench.tasks.condition import Condition, Slot


@dataclass(frozen=True, slots=True)
class Unbuilt:
    """Variation that could not be derived from a cast.

    Attributes:
        axis: Letter of the axis ("O").
        title: Difference from training in a few words.
        reason: Reason why it could not be derived, and a remedy.
    """

    axis: str
    title: str
    reason: str


@dataclass(frozen=True, slots=True)
class GeneratedTask:
    """Task derived from a cast by a pattern.

    Attributes:
        task: Task with its training conditions and variations; it has no ``id`` yet.
        confounds: Deliberate regularities of the training conditions, one sentence each.
        balanced: Training conditions without these regularities.
        crossed: Factors that are crossed in ``balanced``, one line each.
        unbuilt: Variations that could not be derived.
        aside: Slots that only conditions of ``balanced`` use; nothing is picked from these slots.
    """

    task: Task
    confounds: tuple[str, ...]
    balanced: tuple[Condition, ...]
    crossed: tuple[str, ...]
    unbuilt: tuple[Unbuilt, ...] = ()
    aside: tuple[Slot, ...] = ()


Pattern = Callable[[Cast], GeneratedTask]
"""Function that makes a task from a cast, and raises InvalidInputError with the reason if the objects do not fit."""

PATTERNS: dict[str, Pattern] = {}
"""Patterns by the name of their template."""


def pattern(template: Template) -> Callable[[Pattern], Pattern]:
    """Register a function as the pattern of a template."""

    def register(make: Pattern) -> Pattern:
        PATTERNS[template.name] = make
        return make

    return register


def pattern_of(template: str) -> Pattern:
    """Return the pattern of a template.

    Raises:
        UnknownNameError: If the template has no pattern.
    """
    if template not in PATTERNS:
        raise UnknownNameError("pattern", template, PATTERNS)
    return PATTERNS[template]
