"""Registry of patterns, which derive tasks from casts (scenarios with chosen assets)."""

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
        title: Short description of the difference from training.
        reason: Reason why the variation could not be derived, with a remedy.
    """

    axis: str
    title: str
    reason: str


@dataclass(frozen=True, slots=True)
class GeneratedTask:
    """Task that a pattern derived from a cast.

    Attributes:
        task: Task with training conditions and variations, without an ``id``.
        confounds: Deliberate confounds of the training conditions, one sentence each.
        balanced: Additional training conditions without these confounds.
        crossed: Factors that vary independently in ``balanced``, one line each.
        unbuilt: Variations that could not be derived.
        aside: Slots that are used only in ``balanced``. Nothing is picked from them.
    """

    task: Task
    confounds: tuple[str, ...]
    balanced: tuple[Condition, ...]
    crossed: tuple[str, ...]
    unbuilt: tuple[Unbuilt, ...] = ()
    aside: tuple[Slot, ...] = ()


Pattern = Callable[[Cast], GeneratedTask]
"""Function that makes a task from a cast, or raises InvalidInputError if the objects do not fit."""

PATTERNS: dict[str, Pattern] = {}
"""Patterns by the name of their template."""


def pattern(template: Template) -> Callable[[Pattern], Pattern]:
    """Decorator that registers a function as the pattern of a template."""

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
