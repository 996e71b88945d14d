"""Minds decide what to do next; the skills carry it out. The expert's mind reads the truth and is right."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from betterbench.state import WorldState
from betterbench.tasks import Condition, Task, stream
from betterbench.tasks.predicates import relation


@dataclass(frozen=True, slots=True)
class Bring:
    """Decision to bring an object to a target."""

    object: str
    target: str
    relation: str
    place: str = ""


@dataclass(frozen=True, slots=True)
class GraspAt:
    """Decision to grasp at a slot, whatever is or is not there."""

    slot: str


@dataclass(frozen=True, slots=True)
class Freeze:
    """Decision to start towards an object and then stop for good; without an object, never to start."""

    towards: str | None


@dataclass(frozen=True, slots=True)
class Rest:
    """Decision that nothing is left to do."""


Decision = Bring | GraspAt | Freeze | Rest


@dataclass(frozen=True, slots=True)
class Situation:
    """What a mind knows besides the state.

    Attributes:
        task: The task, with its training regime.
        condition: The condition in force.
        seed: Seed of the trial.
    """

    task: Task
    condition: Condition
    seed: int


class Mind(Protocol):
    """Decides step by step."""

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision.

        Args:
            state: State now.
            history: Decisions already carried out in this episode.
        """


def at_target(state: WorldState, name: str, target: str, relation_name: str, place: str = "") -> bool:
    """Tell whether an object is where a subgoal wants it."""
    return relation(relation_name).holds(state, name, target, place)


def open_subgoal(state: WorldState, condition: Condition) -> int | None:
    """Return the index of the first subgoal that is not reached, or None."""
    for i, goal in enumerate(condition.instruction.subgoals):
        names = condition.resolve(goal.reference)
        if sum(at_target(state, n, goal.target, goal.relation, goal.place) for n in names) < goal.count:
            return i
    return None


def choose(situation: Situation, state: WorldState, index: int) -> str | None:
    """Return the object to take for a subgoal: one that is not at the target yet, any of several alike by the seed."""
    goals = situation.condition.instruction.subgoals
    goal = goals[index]
    resolve = situation.condition.resolve
    served = {
        n for g in goals for n in resolve(g.reference) if at_target(state, n, g.target, g.relation, g.place)
    }  # an object that serves another subgoal already is left there
    names = [n for n in resolve(goal.reference) if n not in served]
    if not names:
        return None
    names.sort(key=lambda n: situation.condition.layout.get(n, ""))
    pick = stream(situation.task.id, situation.seed, f"choice:{goal.word}").integers(1 << 30)
    return names[int(pick) % len(names)]


class ExpertMind:
    """Does what the instruction asks for, in order, and stops when it is done."""

    def __init__(self, situation: Situation) -> None:
        """Prepare for an episode."""
        self.situation = situation

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        del history
        index = open_subgoal(state, self.situation.condition)
        return Rest() if index is None else self.bring(state, index)

    def bring(self, state: WorldState, index: int) -> Decision:
        """Return the decision that serves a subgoal."""
        goal = self.situation.condition.instruction.subgoals[index]
        name = choose(self.situation, state, index)
        return Rest() if name is None else Bring(name, goal.target, goal.relation, goal.place)
