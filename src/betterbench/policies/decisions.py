"""Decision rules of privileged policies. A rule decides what to do next, and motor skills carry out its decisions."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.interface.state import WorldState
from betterbench.tasks import Condition, Subgoal, Task, stream
from betterbench.tasks.relations import relation
from betterbench.tasks.relations.closed import drawer_to_move


@dataclass(frozen=True, slots=True)
class GraspOffset:
    """Deliberate grasp error of a faulty policy.

    Attributes:
        miss_by_m: Gap between the finger pads and the object when the gripper closes beside the object [m]. If it is
            None, the gripper does not miss.
        drop: Whether the gripper drops the object in mid-air after lifting it.
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
    """Decision to grasp at a slot, even if no object is there."""

    slot: str


@dataclass(frozen=True, slots=True)
class Freeze:
    """Decision to move toward an object and then stop permanently. If no object is given, the robot never moves."""

    toward: str | None


@dataclass(frozen=True, slots=True)
class Wander:
    """Decision to keep moving around without grasping anything."""


@dataclass(frozen=True, slots=True)
class Rest:
    """Decision to stop because there is nothing left to do."""


Decision = Bring | Draw | GraspAt | Freeze | Wander | Rest


@dataclass(frozen=True, slots=True)
class Situation:
    """Facts about the trial that a decision rule knows in addition to the state.

    Attributes:
        task: Task, including its training conditions.
        condition: Condition (training or variation) of the trial.
        seed: Seed of the trial.
    """

    task: Task
    condition: Condition
    seed: int


def carried(goal: Subgoal) -> bool:
    """Return whether a subgoal is reached by carrying its object. Otherwise, it is reached by moving a drawer."""
    return relation(goal.relation).carried


def bring_to(goal: Subgoal, name: str) -> Bring:
    """Return the decision to bring an object to the target of a subgoal."""
    return Bring(name, goal.target, goal.relation, goal.region)


def at_target(state: WorldState, name: str, target: str, relation_name: str, region: str = "") -> bool:
    """Return whether an object has the given relation to a target."""
    return relation(relation_name).holds(state, name, target, region)


def reached(state: WorldState, condition: Condition, index: int) -> bool:
    """Return whether a subgoal is reached, i.e. whether the required number of objects is at its target."""
    goal = condition.instruction.subgoals[index]
    names = condition.resolve(goal.reference)
    return sum(at_target(state, n, goal.target, goal.relation, goal.region) for n in names) >= goal.count


def open_subgoal(state: WorldState, condition: Condition) -> int | None:
    """Return the index of the first subgoal that has not been reached, or None if all have been reached."""
    goals = condition.instruction.subgoals
    return next((i for i in range(len(goals)) if not reached(state, condition, i)), None)


def open_subgoals(state: WorldState, condition: Condition) -> tuple[int, ...]:
    """Return the indices of the subgoals that may be worked on now.

    If the order matters, only the first unreached subgoal is returned. Otherwise, all unreached subgoals are returned,
    except that a drawer is closed only after all objects have been put into it. Subgoals whose object does not exist
    are left out.
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
    """Choose an object for a subgoal, or return None if there is none left.

    The object is chosen at random, with the seed of the trial, among the equivalent objects that are not at the target.
    """
    goals = situation.condition.instruction.subgoals
    goal = goals[index]
    resolve = situation.condition.resolve
    served = {
        n for g in goals for n in resolve(g.reference) if at_target(state, n, g.target, g.relation, g.region)
    }  # objects that already fulfill another subgoal are not taken
    names = [n for n in resolve(goal.reference) if n not in served]
    if not names:
        return None
    names.sort(key=lambda n: situation.condition.layout.get(n, ""))
    pick = stream(situation.task.id, situation.seed, f"choice:{goal.word}").integers(1 << 30)
    return names[int(pick) % len(names)]


class ExpertRule:
    """Decision rule of the expert: follow the instruction in order, and stop when it has been completed."""

    def __init__(self, situation: Situation) -> None:
        """Create the rule for one episode."""
        self.situation = situation

    def decide(self, state: WorldState, history: tuple[Decision, ...]) -> Decision:
        """Return the decision for the first subgoal that has not been reached.

        If all subgoals have been reached, return the decision to stop.
        """
        del history
        index = open_subgoal(state, self.situation.condition)
        return Rest() if index is None else self.bring(state, index)

    def bring(self, state: WorldState, index: int) -> Decision:
        """Return the decision that works toward a subgoal, which may be to open or close a drawer first."""
        goal = self.situation.condition.instruction.subgoals[index]
        name = choose(self.situation, state, index)
        if name is None:
            return Rest()
        if not carried(goal):
            return Draw(name, out=False)
        return self.make_way(state, goal.target) or bring_to(goal, name)

    def make_way(self, state: WorldState, target: str) -> Draw | None:
        """Return the drawer movement that is needed before an object can be put at the target, or None."""
        due = drawer_to_move(self.situation.condition, state, target)
        return None if due is None else Draw(due[0], out=due[1])
