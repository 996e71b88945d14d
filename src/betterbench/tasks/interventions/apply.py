"""Application of interventions to a training condition. The result is the condition of a variation."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.tasks import Changes, Condition, Operation, Task, Variation


def apply(condition: Condition, operations: Sequence[Operation]) -> tuple[Condition, Changes]:
    """Apply operations to a condition, one after the other.

    Returns:
        The changed condition and all changes that the operations declare.

    Raises:
        InvalidInputError: If an operation is impossible for the condition, for example if a slot is already taken.
        UnknownNameError: If the condition does not contain an object that an operation names.
    """
    changes = Changes()
    for operation in operations:
        condition, declared = operation.carry_out(condition)
        changes = changes | declared
    return condition, changes


def vary(task: Task, variation: Variation) -> tuple[Condition, Changes]:
    """Return the test condition of a variation and the changes that the variation declares."""
    condition, changes = apply(task.train(variation.base), variation.interventions)
    condition = condition.with_(
        name=variation.name,
        expected=variation.expected,
        mid_task_look=variation.mid_task_look,
        premise_broken=variation.premise_broken,
        watch_steps=variation.watch_steps,
    )
    return condition, changes
