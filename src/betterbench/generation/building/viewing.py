"""Check of a task's scenes against the framing limits of the suite."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.generation.building.result import Failure
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.framing import framing_faults
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.tasks import Condition, Task

CLAUSE = "view"
"""Name of this requirement on a page; the clauses of the certificate have letters."""
MEANING = "the front camera shows every object of the instruction"


def badly_framed(task: Task, conditions: Sequence[Condition], *, seeds: int) -> tuple[Failure, ...]:
    """Return the conditions whose start the front camera shows worse than the limits allow.

    One trial of each condition is drawn; the conditions take the seeds below ``seeds`` in turn.

    Args:
        task: The task, registered.
        conditions: Its conditions.
        seeds: Number of seeds.
    """
    found = []
    for number, condition in enumerate(conditions):
        seed = number % seeds
        faults = framing_faults(Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=QUALITIES["fast"]))
        if faults:
            found.append(Failure(condition.name, (seed,), CLAUSE, MEANING, "; ".join(faults)))
    return tuple(found)
