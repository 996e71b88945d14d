"""Check that the front camera shows the objects of a task's scenes within the framing limits of the suite."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.generation.building.result import Failure
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.framing import framing_faults
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.tasks import Condition, Task

CLAUSE = "view"
"""Name of the framing requirement on report pages, where it is listed next to the clauses of the certificate."""
MEANING = "the front camera shows every object of the instruction"


def badly_framed(task: Task, conditions: Sequence[Condition], *, seeds: int) -> tuple[Failure, ...]:
    """Return the conditions with an initial scene that the front camera does not show within the framing limits.

    Args:
        task: Registered task.
        conditions: Conditions of the task.
        seeds: Number of trials of each condition, with seeds from 0.
    """
    found = []
    for condition in conditions:
        faults = {seed: _faults(task, condition, seed) for seed in range(seeds)}
        bad = tuple(seed for seed, text in faults.items() if text)
        if bad:
            found.append(Failure(condition.name, bad, CLAUSE, MEANING, faults[bad[0]]))
    return tuple(found)


def _faults(task: Task, condition: Condition, seed: int) -> str:
    scene = Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=QUALITIES["fast"])
    return "; ".join(framing_faults(scene))
