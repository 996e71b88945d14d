"""Interventions on what is asked: instruct, repeat and chain. They change sentence and goal, never the scene."""

from __future__ import annotations

from betterbench.errors import InvalidInputError
from betterbench.interventions.operation import Changes, operation
from betterbench.tasks import Condition, Instruction

_LANGUAGE = Changes(language=True)


@operation
def instruct(condition: Condition, *, instruction: Instruction) -> tuple[Condition, Changes]:
    """Ask for something else in the same scene."""
    return condition.with_(instruction=instruction), _LANGUAGE


@operation
def repeat(condition: Condition, *, instruction: Instruction) -> tuple[Condition, Changes]:
    """Ask for a trained step more often than in training.

    Raises:
        InvalidInputError: If the new instruction repeats nothing.
    """
    if len({goal.reference for goal in instruction.subgoals}) == len(instruction.subgoals):
        raise InvalidInputError(f"{condition.id} repeat", "no subgoal is repeated", "Use chain or instruct")
    return condition.with_(instruction=instruction), _LANGUAGE


@operation
def chain(condition: Condition, *, instruction: Instruction) -> tuple[Condition, Changes]:
    """Ask for more steps than any demonstration had.

    Raises:
        InvalidInputError: If the new instruction is not longer.
    """
    if len(instruction.subgoals) <= len(condition.instruction.subgoals):
        raise InvalidInputError(f"{condition.id} chain", "the new instruction is not longer", "Use instruct instead")
    return condition.with_(instruction=instruction), _LANGUAGE
