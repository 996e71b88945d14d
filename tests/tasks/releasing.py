"""Where the instruction of a condition puts objects."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from betterbench.tasks import Condition


def ground(condition: Condition, name: str, stacked: Mapping[str, str] = MappingProxyType({})) -> str:
    """The slot above which an object is: its own, or that of what carries it.

    ``stacked`` names what earlier steps put each object on.
    """
    if name in stacked:
        return ground(condition, stacked[name], stacked)
    if name in condition.layout:
        return condition.layout[name]
    place = condition.object(name).mount or condition.preplaced[name]
    return ground(condition, place.target, stacked)


def releases(condition: Condition) -> set[tuple[str, str, str, str]]:
    """Where an instruction puts things: relation, kind of target, place of it, and the slot where the target then is.

    A plate that an earlier step puts on another one stands, as a target, where that other one stands.
    """
    found, stacked = set(), {}
    for goal in condition.instruction.subgoals:
        where = ground(condition, goal.target, stacked)
        found.add((goal.relation, condition.object(goal.target).kind, goal.region, where))
        for name in condition.resolve(goal.reference):
            if condition.object(name).mount is None:
                stacked[name] = goal.target
    return found
