"""Lookup of conditions by name. All other modules find conditions by calling these functions."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from betterbench.errors import UnknownNameError
from betterbench.tasks import Changes, Condition, Task, Variation, get_task
from betterbench.tasks.interventions.apply import vary
from betterbench.tasks.interventions.balanced import with_slots_of
from betterbench.tasks.interventions.listed_regimes import every_listed_condition

NO_CHANGES = Changes()


@dataclass(frozen=True, slots=True)
class ResolvedCondition:
    """Condition of a task, with the variation that created it.

    Attributes:
        task: The task, including any extra slots that the condition uses.
        condition: The condition itself.
        variation: Variation that created the condition. None for a training condition or a condition of a listed
            regime.
        changes: Changes that the interventions of the variation declare. Empty if there is no variation.
    """

    task: Task
    condition: Condition
    variation: Variation | None = None
    changes: Changes = NO_CHANGES

    @property
    def base(self) -> str:
        """Name of the condition of the counterfactual twin.

        For a variation, this is the training condition that it is made from. Otherwise, it is the condition itself.
        """
        return self.condition.name if self.variation is None else self.variation.base

    @property
    def axis(self) -> str | None:
        """Axis of the variation, or None if the condition does not come from a variation."""
        return None if self.variation is None else self.variation.axis.value


def condition_names(task: Task) -> tuple[str, ...]:
    """Return the names of all conditions of a task: first the training conditions, then the variations."""
    return (*(c.name for c in task.training), *(v.name for v in task.variations))


@functools.lru_cache(maxsize=1024)
def resolve_condition(task_id: str, name: str) -> ResolvedCondition:
    """Return a condition by the id of its task and its own name ("train1", "L3", "balanced5", "diverse5").

    Raises:
        UnknownNameError: If the task or the condition does not exist.
    """
    task = get_task(task_id)
    for condition in (*task.training, *every_listed_condition(task.id)):
        if condition.name == name:
            return ResolvedCondition(with_slots_of(task, condition), condition)
    for variation in task.variations:
        if variation.name == name:
            condition, changes = vary(task, variation)
            return ResolvedCondition(task, condition, variation, changes)
    raise UnknownNameError(f"condition of {task.id}", name, condition_names(task))
