"""Examination of one trial in the simulator, which checks the five clauses (conditions) of a certificate."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from betterbench.certification.certificate import Clause, TrialCertificate
from betterbench.certification.handling import Handling, Preplaced, Primitive
from betterbench.certification.support import Found, TrainedSupport
from betterbench.errors import PlanningError
from betterbench.geometry import angle_between, distance
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import SceneInfo, WorldState
from betterbench.policies.experts import make_expert
from betterbench.policies.experts.planner import Planner
from betterbench.sim.robots import ArmIK
from betterbench.sim.scenes import Scene, engine_version
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.tasks import (
    THRESHOLDS,
    Condition,
    Expected,
    GoalTracker,
    Looks,
    Support,
    Task,
    TrialId,
    Truth,
    broken_premises,
)
from betterbench.tasks.demonstrated import demonstrated
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.relations import RELATIONS

REST_STEPS = 4
"""Number of control steps for which the robot does not move and the objects must stay at rest: 0.2 s."""
DRIFT_M = 0.001
"""Largest distance that an untouched object may move during these steps [m]."""
PENETRATION_M = 0.0015
"""Largest penetration that is accepted as normal contact, since MuJoCo's constraints are soft [m].

Assets at rest penetrate by less than 0.5 mm.
"""


@dataclass(frozen=True, slots=True)
class InitialRest:
    """Result of clause (c) of a certificate, which requires that all objects are at rest in the initial state.

    The result includes the depth of the largest penetration [mm] and the largest motion of an object [mm].
    """

    clause: Clause
    penetration_mm: float
    drift_mm: float


@dataclass(frozen=True, slots=True)
class _Episode:
    """Results for clause (a) of a certificate (the expert solves the trial) and for the motion primitives."""

    clause: Clause
    steps: int
    found: tuple[Found, ...]
    seconds: float


def examine(trial: TrialId, *, looks: Looks = "seen", robot: str | None = None) -> TrialCertificate:
    """Examine a trial against all clauses of a certificate. Raises UnknownNameError if the trial does not exist."""
    found = resolve_condition(trial.task, trial.condition)
    support = Support.SEEN if found.variation is None else found.variation.support
    training = found.variation is None
    return examine_condition(
        found.task, found.condition, trial.seed, support=support, training=training, looks=looks, robot=robot
    )


def examine_condition(
    task: Task,
    condition: Condition,
    seed: int,
    *,
    support: Support = Support.SEEN,
    training: bool = False,
    looks: Looks = "seen",
    robot: str | None = None,
) -> TrialCertificate:
    """Examine one seed of a condition against all clauses of a certificate.

    The condition does not have to be registered.
    """
    began = time.perf_counter()
    scene = Scene(
        task, condition, seed=seed, action_space=EE_DELTA, quality=QUALITIES["fast"], looks=looks, robot_name=robot
    )
    start = examine_rest(scene)
    state = scene.reset(check_premise=False)
    premise = _premise(condition, state)
    grasps, margin = planned_grasps(scene, state)
    episode = _expert(scene)
    slacks = [f.slack_m for f in episode.found if f.slack_m is not None]
    return TrialCertificate(
        task=task.id,
        condition=condition.name,
        training=training,
        seed=seed,
        clauses={
            "a": episode.clause,
            "b": _inside_support(episode, support),
            "c": start.clause,
            "d": _reach_clause(grasps, episode),
            "e": premise,
        },
        steps=episode.steps,
        step_limit=task.step_limit(condition),
        penetration_mm=start.penetration_mm,
        drift_mm=start.drift_mm,
        joint_margin_rad=None if margin is None else round(margin, 4),
        support_slack_mm=round(1000.0 * min(slacks), 3) if slacks else None,
        watched=condition.expected is not Expected.SUCCEED,
        primitives=tuple(f.text for f in episode.found),
        expert_s=round(episode.seconds, 3),
        total_s=round(time.perf_counter() - began, 3),
    )


def examine_rest(scene: Scene, *, steps: int = REST_STEPS) -> InitialRest:
    """Check clause (c) of a certificate: all objects stay at rest while the arm does not move for ``steps`` steps."""
    before = scene.reset(check_premise=False)
    span = f"in {steps / scene.control_rate_hz:g} s"
    deepest, where = _penetration(scene)
    for _ in range(steps):
        scene.step(np.zeros(EE_DELTA.dim))
    after = scene.state()
    drifts = [distance(a, b) for a, b in zip(before.positions, after.positions, strict=True)]
    drift = max(drifts, default=0.0)
    problems = []
    if deepest > PENETRATION_M:
        problems.append(f"{where} overlap by {1000 * deepest:.2f} mm at the start")
    if drift >= DRIFT_M:
        problems.append(f"{after.info.objects[drifts.index(drift)].name} moves by {1000 * drift:.2f} mm {span}")
    for o, was, now in zip(after.info.objects, before.quaternions, after.quaternions, strict=True):
        if (turned := angle_between(was, now)) > THRESHOLDS.rest_turn:
            problems.append(f"{o.name} turns by {math.degrees(turned):.1f} degrees {span}")
    return InitialRest(
        Clause(not problems, "; ".join(problems)), round(1000.0 * max(deepest, 0.0), 4), round(1000.0 * drift, 4)
    )


def _penetration(scene: Scene) -> tuple[float, str]:
    """Return the depth of the largest penetration between an object and another body [m], and the names of both."""
    contact = scene.data.contact
    names, n = scene.body_names, len(scene.info.objects)
    deepest, where = 0.0, ""
    pairs = scene.compiled.geom_labels[contact.geom].tolist()
    for (a, b), dist in zip(pairs, contact.dist.tolist(), strict=True):
        if a != b and (0 <= a < n or 0 <= b < n) and -dist > deepest:
            deepest = -dist
            where = " and ".join(names[i] if i >= 0 else "the room" for i in (a, b))
    return float(deepest), where


def _premise(condition: Condition, state: WorldState) -> Clause:
    problems = broken_premises(condition, state)
    if problems:
        return Clause(passed=False, text="; ".join(problems))
    if not condition.premise_broken:
        return Clause(passed=True)
    goals = condition.instruction.subgoals
    absent = [g.word for g in goals if len(condition.resolve(g.reference)) < g.count]
    if not absent:
        return Clause(passed=False, text="the premise is declared as broken, but all named objects are present")
    return Clause(passed=True, text=f"broken on purpose: no {', no '.join(absent)} in the scene")


def _to_be_grasped(condition: Condition, state: WorldState) -> tuple[str, ...]:
    """Return the objects named in the instruction that are not at their goal yet."""
    names: dict[str, None] = {}
    for goal in condition.instruction.subgoals:
        for name in condition.resolve(goal.reference):
            if not RELATIONS[goal.relation].holds(state, name, goal.target, goal.region):
                names.setdefault(name)
    return tuple(names)


def _shut_targets(condition: Condition) -> tuple[str, ...]:
    """Return the drawers that are initially closed although an object must be put into them."""
    targets = dict.fromkeys(g.target for g in condition.instruction.subgoals)
    return tuple(t for t in targets if condition.object(t).role == "drawer" and not condition.opened.get(t))


def planned_grasps(scene: Scene, state: WorldState) -> tuple[dict[str, str | None], float | None]:
    """Plan a grasp for each object in the instruction that is not at its goal yet.

    Returns:
        Two values. The first maps the name of each object to the reason why no grasp was found, or to None if one was
        found. Drawers always have a reason, because grasps of their handles are not planned here. The second value is
        the smallest distance between an arm joint and its limit in the planned grasps [rad], or None if there is no
        plan.
    """
    condition = scene.condition
    planner, ik = Planner(scene), ArmIK(scene.compiled.robot)
    low, high = np.asarray(scene.compiled.robot.joint_low), np.asarray(scene.compiled.robot.joint_high)
    reasons: dict[str, str | None] = {}
    margins: list[float] = []
    for drawer in _shut_targets(condition):
        reasons[drawer] = "it is closed and must be opened by its handle first"
    for name in _to_be_grasped(condition, state):
        if state.info.object(name).role == "drawer":
            reasons.setdefault(name, "it is moved by its handle")
            continue
        try:
            plan = planner.plan_pick(state, name)
        except PlanningError as error:
            reasons[name] = str(error)
            continue
        reasons[name] = None
        joints = np.asarray(state.joint_positions, dtype=float)
        for pose in (*plan.way, plan.grasp):
            joints = ik.reach(joints, pose).q
        margins.append(min(float((joints - low).min()), float((high - joints).min())))
    return reasons, min(margins, default=None)


def _reach_clause(reasons: dict[str, str | None], episode: _Episode) -> Clause:
    """Return the result of clause (d) of a certificate: every object can be grasped, or the expert succeeds anyway."""
    if not reasons:
        return Clause(passed=True, text="no object needs to be grasped")
    later = {name: reason for name, reason in reasons.items() if reason is not None}
    if not later:
        return Clause(passed=True)
    told = "; ".join(f"{name}: {reason}" for name, reason in later.items())
    if episode.clause.passed:
        return Clause(passed=True, text=f"shown by the expert's success, not by a plan from the start ({told})")
    return Clause(passed=False, text=told)


@dataclass(frozen=True, slots=True)
class Watched:
    """Result of running the expert in a scene, with the motion primitives of its episode.

    Attributes:
        problem: Reason why the expert failed. Empty if it solved the trial.
        steps: Number of control steps.
        primitives: Motion primitives, in order.
        left: Objects that are at a target when the episode ends.
    """

    problem: str
    steps: int
    primitives: tuple[Primitive, ...]
    left: tuple[Preplaced, ...] = ()


def watch_expert(scene: Scene) -> Watched:
    """Run the expert in a scene, and extract the motion primitives of the episode."""
    task, condition = scene.task, scene.condition
    state = scene.reset(check_premise=False)
    tracker = GoalTracker(condition, scene.info, template=task.template, control_rate_hz=scene.control_rate_hz)
    handling = Handling(task, condition, finger_moves_m=scene.compiled.robot.jaw.closing_shift_m)
    handling.update(state)
    truth = tracker.update(state)
    limit = task.step_limit(condition)
    broke: str | None = None
    agent: object = None
    try:
        agent = expert = make_expert("expert", scene)
        while state.step < limit and not truth.success:
            scene.step(expert.act_on_state(state))
            state = scene.state()
            truth = tracker.update(state)
            handling.update(state)
    except Exception as error:  # noqa: BLE001 - a crash of the expert is listed as an unsolved trial
        broke = f"{type(error).__name__}: {error}"
    problem = "" if truth.success else broke or _why_not(condition, scene.info, tracker, truth, state.step)
    mishap = getattr(agent, "ground_truth", {}).get("mishap")
    if problem and broke is None and mishap:
        problem = f"{problem}; {mishap}"
    return Watched(problem, state.step, handling.finish(), handling.left())


def _expert(scene: Scene) -> _Episode:
    """Run the expert in a scene, and compare its motion primitives with the training distribution."""
    trained = TrainedSupport.of(scene.task, demonstrated(scene.task, engine=engine_version()))
    began = time.perf_counter()
    watched = watch_expert(scene)
    return _Episode(
        Clause(not watched.problem, watched.problem),
        watched.steps,
        trained.judge_all(watched.primitives),
        time.perf_counter() - began,
    )


def _why_not(condition: Condition, info: SceneInfo, tracker: GoalTracker, truth: Truth, steps: int) -> str:
    """Describe the reason why the expert has failed."""
    if condition.expected is not Expected.SUCCEED:
        return f"scored wrong after {steps} steps: {'a forbidden interaction' if truth.forbidden else 'not at rest'}"
    missing = [name for name, done in zip(tracker.subgoal_names, truth.subgoals, strict=True) if not done]
    if condition.instruction.ordered and not truth.in_order:
        missing.append("the order was broken")
    missing += [harm.words(info) for harm in tracker.harm]
    return f"not solved after {steps} steps: {'; '.join(missing) or 'held too short'}"


def _inside_support(episode: _Episode, support: Support) -> Clause:
    problems = [f.problem for f in episode.found if f.problem is not None]
    if support is Support.NOVEL:
        text = "; ".join(problems) or "nevertheless, every pose of the expert is inside"
        return Clause(passed=True, text=f"declared novel: {text}")
    return Clause(not problems, "; ".join(problems))
