"""Goal state at a control step."""

from __future__ import annotations

from typing import NamedTuple


class Truth(NamedTuple):
    """Goal state at a control step. It is a named tuple for speed, because one is built at every control step.

    Attributes:
        relations: Whether each predicate holds, in the order of :attr:`GoalTracker.relation_names`.
        subgoals: Whether each subgoal is done now, i.e. its relation holds, and the object is released and at rest.
        in_order: Whether no subgoal of an ordered instruction was done too early.
        goal: Whether all subgoals are done in order and no object was harmed (see ``judging.harm``).
        forbidden: Whether a forbidden interaction has happened.
        success: Whether the episode has succeeded.
    """

    relations: tuple[bool, ...]
    subgoals: tuple[bool, ...]
    in_order: bool
    goal: bool
    forbidden: bool
    success: bool
