"""Assign conditions to the cells of the diagnostic matrices, according to the initial states of the objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from betterbench.tasks import Condition, Subgoal, all_tasks
from betterbench.tasks.authoring.condition_matrix import Horizon, State
from betterbench.tasks.interventions.resolve import ResolvedCondition, resolve_condition


@dataclass(frozen=True, slots=True)
class CellPosition:
    """Position of a cell: the matrix, and the initial states that define row and column.

    The row is the state of the first target. The column is the state of the distractor or, in the long-horizon matrix,
    of the second target.
    """

    horizon: Horizon
    row: State
    column: State


def cell_of(setting: ResolvedCondition) -> CellPosition | None:
    """Return the matrix cell of a condition. Return None if the condition is in no matrix.

    If the task defines its own matrices, they list the conditions of each cell. Otherwise, the cell follows from the
    initial states of the objects.
    """
    for matrix in setting.task.matrices:
        cell = matrix.cell_of(setting.condition.name)
        if cell is not None:
            return CellPosition(matrix.horizon, cell.row, cell.column)
    if setting.task.matrices:
        return None
    return position_of(setting.condition, training=setting.axis is None)


def position_of(condition: Condition, *, training: bool) -> CellPosition | None:
    """Return the matrix cell of a condition, according to the initial states of its objects.

    Conditions with one object to pick are in the short-horizon matrix, and conditions with two are in the long-horizon
    matrix. All others are in no matrix (None).
    """
    goals = [goal for goal in condition.instruction.subgoals if _is_pick(condition, goal)]
    if len(goals) == 1:
        cell = CellPosition(Horizon.SHORT, _target_state(condition, goals[0]), _distractor_state(condition, goals[0]))
    elif len(goals) == 2:
        cell = CellPosition(Horizon.LONG, _target_state(condition, goals[0]), _target_state(condition, goals[1]))
    else:
        return None
    standard = cell.row is State.TABLE and cell.column is State.TABLE
    return None if standard and not training else cell


@cache
def known_conditions() -> Mapping[CellPosition, tuple[str, ...]]:
    """Return the conditions of all registered tasks, by cell."""
    found: dict[CellPosition, list[str]] = {}
    for task in all_tasks():
        for name in (*(c.name for c in task.training), *(v.name for v in task.variations)):
            setting = resolve_condition(task.id, name)
            cell = cell_of(setting)
            if cell is not None:
                found.setdefault(cell, []).append(f"{task.id}/{name}")
    return {cell: tuple(ids) for cell, ids in found.items()}


def _is_pick(condition: Condition, goal: Subgoal) -> bool:
    """Return whether a subgoal requires moving an object to a target. Closing a drawer, for example, does not."""
    return all(condition.object(name).role != "drawer" for name in condition.resolve(goal.reference))


def _target_state(condition: Condition, goal: Subgoal) -> State:
    """Return the initial state of the object that a subgoal is about.

    If an instruction contains the same subgoal twice, the second one is about the second object.
    """
    names = condition.resolve(goal.reference)
    if len(names) < goal.count:
        return State.ABSENT
    return State.TARGET if sum(_is_at(condition, name, goal.target) for name in names) >= goal.count else State.TABLE


def _distractor_state(condition: Condition, goal: Subgoal) -> State:
    """Return the initial state of the pickable objects that are not targets.

    It is "on the table" if at least one of them is on the table.
    """
    supports = {goal.target, *(placed.target for placed in condition.preplaced.values())}
    targets = condition.resolve(goal.reference)
    others = [
        o.name
        for o in condition.objects
        if o.role in ("item", "distractor") and o.name not in targets and o.name not in supports
    ]
    if any(name in condition.layout for name in others):
        return State.TABLE
    return State.TARGET if any(_is_at(condition, name, goal.target) for name in others) else State.ABSENT


def _is_at(condition: Condition, name: str, target: str) -> bool:
    """Return whether an object is at a target in the initial state."""
    placed = condition.preplaced.get(name)
    return placed is not None and placed.target == target
