"""One attempt at a demonstration: run the episode, and accept or reject it."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from betterbench.certification.handling import Handling
from betterbench.certification.support import TrainedSupport
from betterbench.demonstrations.making.amplifier import Amplifier, AmplifierSettings
from betterbench.demonstrations.making.failure import FailureKind
from betterbench.demonstrations.making.manner import VariedSkills, draw_manner
from betterbench.demonstrations.making.sources import Library
from betterbench.episodes import TrialContext, run_episode, settled_heap
from betterbench.interface.state import WorldState
from betterbench.json_form import strict_form
from betterbench.policies.decisions import Situation
from betterbench.policies.experts.planner import Planner
from betterbench.policies.experts.privileged import PrivilegedAgent, measured_releases
from betterbench.policies.faulty import BrokenRule
from betterbench.records import Demonstrator, Record, subgoal_segments
from betterbench.sim.robots import robot
from betterbench.sim.scenes import Scene, engine_version
from betterbench.tasks import Condition, Expected, GoalTracker, Support, Task, stream
from betterbench.tasks.demonstrated import demonstrated
from betterbench.tasks.interventions import resolve_condition

LASTING_STEPS = 4
"""Number of control steps after the end of an episode for which the goal must stay met.

These steps take 0.2 s, and follow the dwell time of 0.5 s within the episode.
"""

EXPERT, AMPLIFIED, TELEOPERATED = "demonstrator:expert", "demonstrator:amplified", "demonstrator:teleoperated"
"""Names of the demonstrators, which are the policy names in records of demonstrations."""


@strict_form
@dataclass(frozen=True, slots=True)
class AttemptNote:
    """Outcome of an attempt at a demonstration.

    Attributes:
        number: Index of the attempt at this initial state, from 0.
        failure: Kind of failure; "" if the attempt was accepted.
        reason: Reason for the failure, in one line.
        steps: Number of control steps of the attempt.
        sources: Source demonstrations that the attempt used, one per skill.
        lead: Primary source demonstration, which determined the order of the skills; "" if there is none.
    """

    number: int
    failure: str
    reason: str
    steps: int
    sources: tuple[str, ...] = ()
    lead: str = ""

    @property
    def accepted(self) -> bool:
        """Whether the attempt produced a demonstration."""
        return not self.failure


@dataclass(frozen=True, slots=True)
class DemonstrationAttempt:
    """Attempt at a demonstration: its outcome and its record."""

    note: AttemptNote
    record: Record


@settled_heap()
def collect_attempt(scene: Scene, number: int, *, twins: bool = False) -> DemonstrationAttempt:
    """Run the expert in a random motion style that depends on the scene's seed and the index of the attempt.

    Args:
        scene: The scene.
        number: Index of the attempt at this initial state.
        twins: Whether all conditions with the same seed get the same motion style, so that their demonstrations differ
            only in the instruction.
    """
    draw = stream(scene.task.id, scene.seed, f"twins:{number}") if twins else _stream(scene, "collect", number)
    manner = draw_manner(draw)
    skills = VariedSkills(
        Planner(scene),
        1.0 / scene.control_rate_hz,
        functools.partial(stream, scene.task.id, scene.seed),
        measured_releases(scene),
        manner=manner,
        chance=draw,
    )
    rule = BrokenRule(Situation(scene.task, scene.condition, scene.seed))
    agent = PrivilegedAgent(EXPERT, scene, rule, skills=skills)
    try:
        demonstrator = Demonstrator("expert", "expert", manner.to_json())
        result = run_episode(scene, agent, context=_context(scene, EXPERT, demonstrator))
    finally:
        agent.close()
    mishap = agent.ground_truth["mishap"]
    failure: tuple[FailureKind, str] | None = ("misplaced", mishap) if mishap else None
    return judge_attempt(scene, result.record, result.states, number, failure)


@settled_heap()
def amplify_attempt(scene: Scene, number: int, library: Library, settings: AmplifierSettings) -> DemonstrationAttempt:
    """Transfer source demonstrations to a scene. Each attempt follows a different primary source demonstration."""
    draw = _stream(scene, "amplify", number)
    leads = library.of_condition(scene.condition.name)
    # Each initial state has one random order of the source demonstrations, and each attempt uses the next one as its
    # primary source.
    order = _stream(scene, "leads", 0).permutation(len(leads))
    lead = leads[int(order[number % len(leads)])]
    agent = Amplifier(scene, library, lead, settings, draw)
    demonstrator = Demonstrator("amplified", "amplify", {"speed": lead.speed}, (), settings.action_noise)
    disturb = agent.disturb if settings.action_noise else None
    context = _context(scene, AMPLIFIED, demonstrator)
    try:
        result = run_episode(scene, agent, context=context, disturb=disturb)
    finally:
        agent.close()
    sources = tuple(dict.fromkeys(agent.used))
    record = _said(result.record, replace(demonstrator, sources=sources))
    found = judge_attempt(scene, record, result.states, number, agent.failure)
    return replace(found, note=replace(found.note, sources=tuple(agent.used), lead=lead.name))


def _context(scene: Scene, policy: str, demonstrator: Demonstrator) -> TrialContext:
    found = resolve_condition(scene.task.id, scene.condition.name)
    if found.variation is None:
        return TrialContext(policy, demonstrator=demonstrator)
    operations = tuple(str(i) for i in found.variation.interventions)
    name, base = found.variation.name, found.base
    return TrialContext(policy, name, found.axis, base, operations, demonstrator=demonstrator)


def _stream(scene: Scene, what: str, number: int) -> np.random.Generator:
    return stream(scene.task.id, scene.seed, f"{what}:{scene.condition.name}:{number}")


def _said(record: Record, demonstrator: Demonstrator) -> Record:
    return replace(record, metadata=replace(record.metadata, demonstrator=demonstrator))


def judge_attempt(
    scene: Scene,
    record: Record,
    states: Iterable[WorldState],
    number: int,
    failure: tuple[FailureKind, str] | None,
) -> DemonstrationAttempt:
    """Decide whether an attempt meets all requirements for demonstrations and is accepted.

    Call this function before the scene is changed after the end of the episode.

    Args:
        scene: Scene of the attempt.
        record: Record of the attempt. The subgoal segments are added to it.
        states: State of each record row.
        number: Index of the attempt.
        failure: Kind of failure and reason that the demonstrator reported, if any.
    """
    condition = scene.condition
    record = replace(record, metadata=replace(record.metadata, segments=subgoal_segments(record, condition)))
    found = None if record.outcome.success else _why_not(record, failure)
    found = found or _not_lasting(scene, record) or _outside(scene, states)
    kind, reason = found or ("", "")
    return DemonstrationAttempt(AttemptNote(number, kind, reason, record.n_steps), record)


def _why_not(record: Record, failure: tuple[FailureKind, str] | None) -> tuple[FailureKind, str]:
    """Return the kind of failure of an unsuccessful episode, and the reason."""
    done = record.subgoals[-1]
    if record.metadata.subgoal_names and done.all():
        return "harm", "all subgoals are done, but another object was moved or harmed"
    if failure is not None:
        return failure
    if record.outcome.termination == "policy_error":
        return "breakdown", record.outcome.error or ""
    missing = [n for n, d in zip(record.metadata.subgoal_names, done, strict=True) if not d]
    return "time", f"not done after {record.n_steps} steps: {', '.join(missing)}"


def _not_lasting(scene: Scene, record: Record) -> tuple[FailureKind, str] | None:
    """Continue the simulation after the end of an episode, and return a failure if the goal is then no longer met.

    If the correct behavior is to do nothing, the simulation is not continued, and the result is None.
    """
    if scene.condition.expected is not Expected.SUCCEED:
        return None
    still = np.zeros(scene.action_space.dim)
    tracker = GoalTracker(
        scene.condition, scene.info, template=scene.task.template, control_rate_hz=scene.control_rate_hz
    )
    truth = tracker.update(scene.state())
    for _ in range(LASTING_STEPS):
        scene.step(still)
        truth = tracker.update(scene.state())
    lost = [n for n, done in zip(record.metadata.subgoal_names, truth.subgoals, strict=True) if not done]
    return ("did not last", f"{', '.join(lost)} no longer done {LASTING_STEPS} steps after the end") if lost else None


def _outside(scene: Scene, states: Iterable[WorldState]) -> tuple[FailureKind, str] | None:
    """Return the failure if the episode lies outside the certified training distribution.

    Return None if it lies inside.
    """
    problem = outside_support(states, scene.task, scene.condition)
    return None if problem is None else ("outside support", problem)


def outside_support(states: Iterable[WorldState], task: Task, condition: Condition) -> str | None:
    """Describe the first deviation of an episode from the certified training distribution of its task.

    Return None if there is no deviation, or if the variation is declared to lie outside the training distribution.
    """
    variation = resolve_condition(task.id, condition.name).variation
    if variation is not None and variation.support is Support.NOVEL:
        return None
    support = TrainedSupport.of(task, demonstrated(task, engine=engine_version()))
    handling = Handling(task, condition, finger_moves_m=robot(task.robot).jaw.closing_shift_m)
    for state in states:
        handling.update(state)
    problems = (support.judge(primitive).problem for primitive in handling.finish())
    return next((p for p in problems if p is not None), None)
