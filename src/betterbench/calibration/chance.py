"""Chance: how often guessing the instruction would solve a variation."""

from __future__ import annotations

from betterbench.experts.decisions import Situation
from betterbench.experts.faulty.blind import possible_instructions
from betterbench.interventions import vary
from betterbench.tasks import Condition, Instruction, get_task


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
