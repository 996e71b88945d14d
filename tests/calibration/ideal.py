"""A world in which every decision is carried out exactly: what a rule's decisions alone make of a variation."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass

from betterbench.geometry import Pose, horizontal_distance
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import WorldState
from betterbench.interface.state.world import GRIPPER_BODIES
from betterbench.policies.decisions import Bring, Decision, Draw, ExpertRule, Freeze, GraspAt, Rest, Situation, Wander
from betterbench.policies.experts.registry import EXPERTS
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Condition, Expected, Label, Subgoal, get_task
from betterbench.tasks.interventions import vary
from betterbench.tasks.relations import relation

MAX_DECISIONS = 12
CARRIED_M = 0.05
OPEN_M = 0.15
ON_TABLE_M = 0.004


@dataclass(frozen=True, slots=True)
class Walk:
    """What the decisions of a rule make of a trial.

    Attributes:
        success: Every subgoal holds at the end, in a valid order, and nothing was done that was not asked for.
        truth: Label of the first wrong decision, or None if all were right.
        decisions: All decisions, in order.
        why: Why it is no success; empty if it is one.
    """

    success: bool
    truth: Label | None
    decisions: tuple[Decision, ...]
    why: str


class _IdealState(WorldState):
    """A state in which things touch each other, and neither the table nor the gripper."""

    __slots__ = ()

    def touching(self, a: str, b: str) -> bool:
        if "table" in (a, b):
            return any(self.pose(n).position[2] < ON_TABLE_M for n in (a, b) if n != "table")
        return not {a, b} & GRIPPER_BODIES

    def touched_by_gripper(self, _name: str) -> bool:
        return False


@functools.cache
def start(task_id: str, name: str, seed: int = 0) -> tuple[WorldState, Condition, dict[str, Pose]]:
    """Returns the state at reset of a condition, the condition, and the pose of every drawer while it is shut."""
    task = get_task(task_id)
    condition = task.train(name) if name.startswith("train") else vary(task, task.variation(name))[0]
    scene = Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("fast"))
    state = scene.reset(check_premise=False)
    fields = {f.name: getattr(state, f.name) for f in dataclasses.fields(state)}
    shut = {p.spec.name: p.shut for p in scene.placements if p.shut is not None}
    return _IdealState(**fields), condition, shut


def walk(policy: str, task_id: str, name: str, seed: int = 0) -> Walk:
    """Returns what the decisions of a named rule make of a trial, each carried out exactly."""
    _, condition, _ = start(task_id, name, seed)
    return walk_by(EXPERTS[policy].rule(Situation(get_task(task_id), condition, seed), 1.0), task_id, name, seed)


def walk_by(rule: ExpertRule, task_id: str, name: str, seed: int = 0, *, stop: bool = False) -> Walk:
    """Returns what a rule's decisions make of a trial, whatever instruction the rule itself has heard.

    With ``stop`` it ends, as a trial does, when everything that was asked for is done.
    """
    state, condition, shut = start(task_id, name, seed)
    begin, history = state, ()
    reached = [_done(state, condition)]
    while len(history) < MAX_DECISIONS:
        decision = rule.decide(state, history)
        history = (*history, decision)
        if isinstance(decision, Rest | Freeze | Wander):
            break
        state = _carried_out(state, decision, shut)
        reached.append(_done(state, condition))
        if stop and all(reached[-1]):
            break
    why = _wrong(begin, state, condition, history, reached)
    fault = getattr(rule, "fault", None)
    return Walk(not why, None if fault is None else fault.label, history, why)


def _carried_out(state: WorldState, decision: Decision, shut: dict[str, Pose]) -> WorldState:
    if isinstance(decision, Bring):
        goals = relation(decision.relation).place_goals(state, decision.object, decision.target, decision.region)
        return _posed(state, decision.object, goals[0].pose)
    if isinstance(decision, Draw):
        home, now = shut[decision.drawer], state.pose(decision.drawer)
        there = home @ Pose((OPEN_M, 0.0, 0.0)) if decision.out else home
        moved = _posed(state, decision.drawer, there)
        for o in state.info.objects:  # what lies in it goes with it
            if o.role in ("item", "distractor") and relation("inside").holds(state, o.name, decision.drawer):
                moved = _posed(moved, o.name, there @ now.inverse() @ state.pose(o.name))
        return moved
    return state


def _posed(state: WorldState, name: str, pose: Pose) -> WorldState:
    i = state.info.index(name)
    positions, quaternions = list(state.positions), list(state.quaternions)
    positions[i], quaternions[i] = pose.position, pose.quaternion
    return dataclasses.replace(state, positions=tuple(positions), quaternions=tuple(quaternions))


def _done(state: WorldState, condition: Condition) -> tuple[bool, ...]:
    return tuple(
        sum(relation(g.relation).holds(state, n, g.target, g.region) for n in condition.resolve(g.reference)) >= g.count
        for g in condition.instruction.subgoals
    )


def _wrong(
    begin: WorldState, end: WorldState, condition: Condition, history: tuple[Decision, ...], reached: list
) -> str:
    """Returns why a walk is no success, or nothing."""
    if condition.expected is not Expected.SUCCEED:
        goals = condition.instruction.subgoals
        meant = {n for g in goals for n in condition.resolve(g.reference)}
        allowed = meant if condition.expected is Expected.REFUSE else set()
        bad = [d for d in history if isinstance(d, GraspAt) or (isinstance(d, Bring) and d.object not in allowed)]
        return f"forbidden: {bad[0]}" if bad else ""
    return _unfinished(condition, history, reached) or _harm(begin, end, condition, history)


def _unfinished(condition: Condition, history: tuple[Decision, ...], reached: list) -> str:
    goals = condition.instruction.subgoals
    if isinstance(history[-1], Wander):
        return "wanders"
    if not all(reached[-1]):
        return f"open: {[g.name for g, done in zip(goals, reached[-1], strict=True) if not done]}"
    first = [next(i for i, done in enumerate(reached) if done[g]) for g in range(len(goals))]
    return f"order: {first}" if condition.instruction.ordered and first != sorted(first) else ""


def _harm(begin: WorldState, end: WorldState, condition: Condition, history: tuple[Decision, ...]) -> str:
    """Returns what was done that was not asked for, or nothing."""
    goals = condition.instruction.subgoals
    for d in history:
        if not isinstance(d, Bring):
            continue
        serves = any(d.object in condition.resolve(g.reference) and _at(end, d.object, g) for g in goals)
        if not serves and horizontal_distance(begin.pose(d.object).position, end.pose(d.object).position) > CARRIED_M:
            return f"carried away unasked: {d.object}"
    for g in goals:
        same = [h for h in goals if (h.reference, h.target, h.region) == (g.reference, g.target, g.region)]
        if sum(_at(end, n, g) for n in condition.resolve(g.reference)) > max(h.count for h in same):
            return f"too many of {g.reference}"
        asked = {n for h in goals if h.target == g.target for n in condition.resolve(h.reference)}
        for o in end.info.objects:
            if o.role in ("item", "distractor") and o.name not in (g.target, *asked):
                where = relation(g.relation).where
                if where(end, o.name, g.target) is not None and where(begin, o.name, g.target) is None:
                    return f"not asked for there: {o.name}"
    return ""


def _at(state: WorldState, name: str, goal: Subgoal) -> bool:
    return relation(goal.relation).holds(state, name, goal.target, goal.region)
