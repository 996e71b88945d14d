"""Turning a variation into the condition it describes."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.interventions.operation import Changes, operation_names, run_operation
from betterbench.tasks import Condition, Intervention, Task, Variation


def operations() -> tuple[str, ...]:
    """Return the names of all operations."""
    return operation_names()


def apply(condition: Condition, interventions: Sequence[Intervention]) -> tuple[Condition, Changes]:
    """Carry out interventions one after the other.

    Args:
        condition: The condition to start from; it is not changed.
        interventions: Operations as data.

    Returns:
        The changed condition and everything that was declared to change.
    """
    changes = Changes()
    for intervention in interventions:
        condition, declared = run_operation(condition, intervention.operation, intervention.arguments)
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
