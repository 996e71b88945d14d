"""Decision rules of privileged policies. Motor skills execute the decisions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from betterbench.interface.state import WorldState
from betterbench.tasks import Condition, Subgoal, Task, stream
from betterbench.tasks.relations import relation
from betterbench.tasks.relations.closed import drawer_to_move


@dataclass(frozen=True, slots=True)
class GraspOffset:
    """Deliberate grasp error, for faulty policies.

    Attributes:
        miss_by_m: Gap between the finger pads and the object when the gripper closes beside it [m], or None for a good
            grasp.
        drop: Whether to open the gripper in mid-air after the lift.
    """

    miss_by_m: float | None = None
    drop: bool = False


@dataclass(frozen=True, slots=True)
class Bring:
    """Decision to bring an object to a target."""

    object: str
    target: str
    relation: str
    region: str = ""


@dataclass(frozen=True, slots=True)
class Draw:
    """Decision to open or close a drawer."""

    drawer: str
    out: bool


@dataclass(frozen=True, slots=True)
class GraspAt:
    """Decision to grasp at a slot, even if it is empty."""

    slot: str


@dataclass(frozen=True, slots=True)
class Freeze:
    """Decision to move toward an object and then stop permanently. Without an object, the decision is never to move."""

    toward: str | None


@dataclass(frozen=True, slots=True)
class Wander:
    """Decision to move around forever without grasping."""


@dataclass(frozen=True, slots=True)
class Rest:
    """Decision to stop because nothing is left to do."""


Decision = Bring | Draw | GraspAt | Freeze | Wander | Rest


@dataclass(frozen=True, slots=True)
class Situation:
    """Facts about the trial that a decision rule gets in addition to the state.

    Attributes:
        task: The task, with its training conditions.
        condition: The trial's condition.
        seed: Trial seed.
    """

    task: Task
    condition: Condition
    seed: int


class DecisionRule(Protocol):
    """Decision rule of a privileged policy."""

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision.

        Args:
            state: Current state.
            history: Decisions already executed in this episode.
        """


def carried(goal: Subgoal) -> bool:
    """Return whether a subgoal requires carrying its object, rather than moving a drawer."""
    return relation(goal.relation).carried


def bring_to(goal: Subgoal, name: str) -> Bring:
    """Return the decision to bring an object to a subgoal's target."""
    return Bring(name, goal.target, goal.relation, goal.region)


def at_target(state: WorldState, name: str, target: str, relation_name: str, region: str = "") -> bool:
    """Return whether an object is at a subgoal's target."""
    return relation(relation_name).holds(state, name, target, region)


def reached(state: WorldState, condition: Condition, index: int) -> bool:
    """Return whether a subgoal's required number of objects are at its target."""
    goal = condition.instruction.subgoals[index]
    names = condition.resolve(goal.reference)
    return sum(at_target(state, n, goal.target, goal.relation, goal.region) for n in names) >= goal.count


def open_subgoal(state: WorldState, condition: Condition) -> int | None:
    """Return the index of the first subgoal that is not reached, or None."""
    goals = condition.instruction.subgoals
    return next((i for i in range(len(goals)) if not reached(state, condition, i)), None)


def open_subgoals(state: WorldState, condition: Condition) -> tuple[int, ...]:
    """Return the subgoals that may be executed now.

    These are the first open one or, if the order is free, all open ones.

    A drawer is closed only after its contents are inside. If a requested object does not exist, other objects may be
    handled.
    """
    goals = condition.instruction.subgoals
    left = [i for i in range(len(goals)) if not reached(state, condition, i) and condition.resolve(goals[i].reference)]
    if condition.instruction.ordered:
        return tuple(left[:1])
    return tuple(
        i
        for i in left
        if carried(goals[i]) or not any(goals[j].target in condition.resolve(goals[i].reference) for j in left if j < i)
    )


def choose(situation: Situation, state: WorldState, index: int) -> str | None:
    """Return the object to take for a subgoal, drawn by seed among equal objects not yet at the target."""
    goals = situation.condition.instruction.subgoals
    goal = goals[index]
    resolve = situation.condition.resolve
    served = {
        n for g in goals for n in resolve(g.reference) if at_target(state, n, g.target, g.relation, g.region)
    }  # do not take objects that already fulfill another subgoal
    names = [n for n in resolve(goal.reference) if n not in served]
    if not names:
        return None
    names.sort(key=lambda n: situation.condition.layout.get(n, ""))
    pick = stream(situation.task.id, situation.seed, f"choice:{goal.word}").integers(1 << 30)
    return names[int(pick) % len(names)]


class ExpertRule:
    """Expert rule: follow the instruction in order, and stop when it is done."""

    def __init__(self, situation: Situation) -> None:
        """Make the rule for one episode."""
        self.situation = situation

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the next decision."""
        del history
        index = open_subgoal(state, self.situation.condition)
        return Rest() if index is None else self.bring(state, index)

    def bring(self, state: WorldState, index: int) -> Decision:
        """Return the decision for a subgoal."""
        goal = self.situation.condition.instruction.subgoals[index]
        name = choose(self.situation, state, index)
        if name is None:
            return Rest()
        if not carried(goal):
            return Draw(name, out=False)
        return self.make_way(state, goal.target) or bring_to(goal, name)

    def make_way(self, state: WorldState, target: str) -> Draw | None:
        """Return the drawer action required before an object can be put into the target, or None."""
        due = drawer_to_move(self.situation.condition, state, target)
        return None if due is None else Draw(due[0], out=due[1])
