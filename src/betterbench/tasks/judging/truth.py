"""Goal state at one control step."""

from __future__ import annotations

from typing import NamedTuple


class Truth(NamedTuple):
    """Goal state at one control step. A named tuple for speed, because every control step builds one.

    Attributes:
        relations: Whether each predicate holds, in the order of :attr:`GoalTracker.relation_names`.
        subgoals: Whether each subgoal is done now (relation true, object released and at rest).
        in_order: Whether no subgoal of an ordered instruction was done too early.
        goal: Whether all subgoals are done in order, and no other object was harmed (see ``judging.harm``).
        forbidden: Whether a forbidden interaction has happened.
        success: Whether the episode has succeeded.
    """

    relations: tuple[bool, ...]
    subgoals: tuple[bool, ...]
    in_order: bool
    goal: bool
    forbidden: bool
    success: bool
