"""Carrying out interventions: the condition that a variation describes."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.tasks import Changes, Condition, Operation, Task, Variation


def apply(condition: Condition, operations: Sequence[Operation]) -> tuple[Condition, Changes]:
    """Carry out operations one after the other.

    Returns:
        The changed condition and everything that was declared to change.

    Raises:
        InvalidInputError: If an operation makes no sense on the condition, for example a slot that is taken.
        UnknownNameError: If it names an object that the condition does not have.
    """
    changes = Changes()
    for operation in operations:
        condition, declared = operation.carry_out(condition)
        changes = changes | declared
    return condition, changes


def vary(task: Task, variation: Variation) -> tuple[Condition, Changes]:
    """Return the test condition of a variation and what it declares to change."""
    condition, changes = apply(task.train(variation.base), variation.interventions)
    condition = condition.with_(
        name=variation.name,
        expected=variation.expected,
        mid_task_look=variation.mid_task_look,
        premise_broken=variation.premise_broken,
    )
    return condition, changes
