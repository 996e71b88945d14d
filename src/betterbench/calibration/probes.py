"""Blind probes: how often a policy that cannot see or hear succeeds, and on which variations it should not have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from betterbench.diagnosis import ProbeCell, TrialDiagnosis
from betterbench.experts.decisions import Situation
from betterbench.experts.faulty.blind import possible_instructions
from betterbench.interventions import vary
from betterbench.statistics import Rate, chance_p, holm
from betterbench.tasks import Condition, Instruction, get_task


def probe_cells(trials: Sequence[TrialDiagnosis]) -> tuple[ProbeCell, ...]:
    """Return what a probe reaches on every variation on which something has to be done.

    Where the right thing is to do nothing, doing nothing is no knowledge: those variations are left out.
    """
    cells = []
    for task_name, name in dict.fromkeys((t.task, t.variation) for t in trials if t.variation is not None):
        members = [t for t in trials if (t.task, t.variation) == (task_name, name) and t.expected == "succeed"]
        if members:
            rate = Rate(sum(t.success for t in members), len(members))
            chance = chance_of(task_name, name)
            p = chance_p(rate, chance=chance) if chance < 1.0 else 1.0
            cells.append(ProbeCell(members[0].policy, task_name, name, rate.k, rate.n, chance, p))
    corrected = holm([cell.p_value for cell in cells])
    return tuple(replace(cell, p_value=p) for cell, p in zip(cells, corrected, strict=True))


def chance_of(task_name: str, name: str) -> float:
    """Return the success rate of guessing the instruction of a variation among those that make sense in its scene.

    Two instructions that mean the same things and places here, such as "the red mug" and "the bottom mug", count as one
    right guess each.
    """
    task = get_task(task_name)
    condition, _ = vary(task, task.variation(name))
    choices = possible_instructions(Situation(task, condition, 0))
    return sum(_meaning(c, condition) == _meaning(condition.instruction, condition) for c in choices) / len(choices)


def _meaning(instruction: Instruction, condition: Condition) -> object:
    """Return what an instruction asks for in a scene: which objects where, and in which order if that matters."""
    steps = [
        (condition.resolve(g.reference), g.relation, condition.object(g.target).kind, g.region, g.count)
        for g in instruction.subgoals
    ]
    return tuple(steps) if instruction.ordered else frozenset(steps)
