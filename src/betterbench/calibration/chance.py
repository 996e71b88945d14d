"""Chance level of a variation: the success rate of a policy that guesses the instruction."""

from __future__ import annotations

from betterbench.policies.decisions import Situation
from betterbench.policies.faulty.blind import possible_instructions
from betterbench.tasks import Condition, Instruction, Subgoal, get_task
from betterbench.tasks.condition import TargetRegion
from betterbench.tasks.interventions import vary


def chance_of(task_name: str, name: str) -> float:
    """Return the success rate of a policy that guesses the instruction of a variation.

    The policy chooses one of the instructions that are possible in the scene, each with the same probability. A guess
    is correct if it refers to the same objects and targets as the instruction, even if the wording differs, such as
    "the red mug" and "the bottom mug". A guess with additional steps at the end is also correct, because the trial
    succeeds before these steps begin. Steps that are already done in the initial state are ignored.
    """
    task = get_task(task_name)
    condition, _ = vary(task, task.variation(name))
    choices = possible_instructions(Situation(task, condition, 0))
    asked = _open_steps(condition.instruction, condition)
    begins = [_open_steps(choice, condition)[: len(asked) or None] for choice in choices]
    if not condition.instruction.ordered:
        return sum(set(steps) == set(asked) for steps in begins) / len(choices)
    return sum(steps == asked for steps in begins) / len(choices)


def _open_steps(instruction: Instruction, condition: Condition) -> list[object]:
    """Return the steps of an instruction that are not done in the initial state, in order.

    Each step is a tuple of the objects, the relation, the kind of the target, the target region and the count.
    """
    return [
        (condition.resolve(g.reference), g.relation, condition.object(g.target).kind, g.region, g.count)
        for g in instruction.subgoals
        if not _is_done(g, condition)
    ]


def _is_done(goal: Subgoal, condition: Condition) -> bool:
    there = TargetRegion(goal.target, goal.region)
    return sum(condition.preplaced.get(name) == there for name in condition.resolve(goal.reference)) >= goal.count
