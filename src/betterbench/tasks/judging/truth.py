"""Truth of a goal at one control step."""

from __future__ import annotations

from typing import NamedTuple


class Truth(NamedTuple):
    """Goal state at one control step. A named tuple, because one is built at every control step.

    Attributes:
        relations: Whether each predicate holds, in the order of :attr:`GoalTracker.relation_names`.
        subgoals: Whether each subgoal is done now (related, released and at rest).
        in_order: False once a subgoal was done before one that comes earlier in an ordered instruction.
        goal: All subgoals done in order, and no harm done to anything else (see ``tasks.harm``).
        forbidden: An interaction happened so far that the condition forbids.
        success: The episode has succeeded.
    """

    relations: tuple[bool, ...]
    subgoals: tuple[bool, ...]
    in_order: bool
    goal: bool
    forbidden: bool
    success: bool
