"""One trial: from its record to what the record alone proves, and to what the second pass needs to know about it."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

from betterbench.diagnosis.collisions import count_collisions
from betterbench.diagnosis.episode_analysis import AttemptTarget, EpisodeAnalysis, analyze_episode
from betterbench.diagnosis.labels import ALONE, LabelEvidence, Ruling, decide, gather
from betterbench.diagnosis.modes.behavioral_inertia import habit
from betterbench.diagnosis.modes.lexical_kinematic_shortcut import taken_for_another
from betterbench.diagnosis.trace import trace_of
from betterbench.diagnosis.verdict import TrialDiagnosis
from betterbench.interventions import vary
from betterbench.recording import Record
from betterbench.tasks import (
    THRESHOLDS,
    Condition,
    Expected,
    GoalTracker,
    Task,
    TrainingDistribution,
    Truth,
    get_task,
    training_distribution_of,
)


@dataclass(frozen=True, slots=True)
class Choice:
    """Where the first attempt of a trial went, and where each rule would have sent it.

    Attributes:
        layout: What stood in which slot at the start, so that trials of one layout can be compared.
        right: Slots at which the first attempt would have been right; empty where nothing was to be grasped.
        slot: Slot of the first attempt, or None if there was no attempt where none should be.
        correct: Whether the first attempt (or its absence) was right.
        word_slots: Slots to which the word leads by training.
        habit_slots: Slots to which the most frequent first step leads; empty if the regime has none.
        places: Number of slots at which something could be grasped.
    """

    layout: frozenset[tuple[str, str]]
    right: frozenset[str]
    slot: str | None
    correct: bool
    word_slots: frozenset[str]
    habit_slots: frozenset[str]
    places: int


@dataclass(frozen=True, slots=True)
class Reading:
    """What one record says: a diagnosis without a label, all evidence, and the choice for the second pass.

    Attributes:
        diagnosis: The diagnosis under the trial's own evidence.
        findings: All evidence.
        choice: The first attempt for the second pass, or None if it says nothing about a rule.
    """

    diagnosis: TrialDiagnosis
    findings: tuple[LabelEvidence, ...]
    choice: Choice | None


@dataclass(frozen=True, slots=True)
class TrialSetup:
    """The task and the condition of a trial.

    Attributes:
        task: The task.
        condition: The condition in force.
        base: Name of the training condition: its own, or the one that the variation is derived from.
        axis: Axis of the variation, or None.
        trained: Regularities of the training regime.
    """

    task: Task
    condition: Condition
    base: str
    axis: str | None
    trained: TrainingDistribution


@functools.cache
def setup_of(task_name: str, name: str) -> TrialSetup:
    """Return the setting of a variation or training condition.

    Raises:
        UnknownNameError: If there is no such task, variation or training condition.
    """
    task = get_task(task_name)
    trained = training_distribution_of(task)
    if any(c.name == name for c in task.training):
        return TrialSetup(task, task.train(name), name, None, trained)
    variation = task.variation(name)
    condition, _ = vary(task, variation)
    return TrialSetup(task, condition, variation.base, variation.axis.value, trained)


def diagnose_record(record: Record, *, path: str | None = None) -> TrialDiagnosis:
    """Return what one record proves alone.

    Labels that need other trials of the policy (``visual_layout_bias``, ``lexical_kinematic_shortcut``) are not given:
    the label is then ``wrong_object``, and the evidence names the candidates.
    :func:`~betterbench.diagnosis.diagnose_run` settles them.

    Args:
        record: The record.
        path: Its path relative to the run, for the diagnosis.

    Raises:
        UnknownNameError: If its task or condition is unknown.
        RecordError: If it lacks a predicate of its task.
    """
    return read_trial(record, path=path).diagnosis


def read_trial(record: Record, *, path: str | None = None) -> Reading:
    """Return everything that one record says."""
    m = record.metadata
    setting = setup_of(m.task, m.variation or m.condition)
    episode = _course(record, setting)
    findings = gather(record, episode)
    label, evidence = decide(findings, ALONE)
    first = episode.first_attempt
    rows = episode.trace.rows
    diagnosis = TrialDiagnosis(
        task=m.task,
        variation=m.variation,
        condition=setting.base,
        axis=setting.axis,
        seed=m.seed,
        policy=m.policy,
        instruction=m.instruction,
        success=record.outcome.success,
        expected=setting.condition.expected.value,
        label=label,
        first_attempt=None if first is None else first.attempt.object,
        first_slot=None if first is None else first.attempt.slot,
        intended=episode.intended(),
        intention_correct=episode.intention_correct(),
        progress=episode.progress(),
        attempts=tuple(s.attempt for s in episode.steps),
        evidence=evidence,
        collisions=count_collisions(record, episode.trace),
        steps=rows - 1,
        duration_s=float(episode.trace.time[-1]),
        record=path,
    )
    return Reading(diagnosis, findings, _choice(episode))


def settled(reading: Reading, ruling: Ruling) -> LabelEvidence:
    """Return the finding that decides a trial under the ruling of the second pass."""
    return decide(reading.findings, ruling)


def offline_truth(record: Record) -> list[Truth]:
    """Judge every state of a record again with the goal tracker that judged it live.

    Args:
        record: The record.

    Returns:
        One truth per row; its subgoals, goal and forbidden flags equal the recorded ones, bit for bit.
    """
    m = record.metadata
    setting = setup_of(m.task, m.variation or m.condition)
    tracker = GoalTracker(setting.condition, m.scene, template=setting.task.template, control_rate_hz=m.control_rate_hz)
    return [tracker.update(state) for state in record.states()]


def _course(record: Record, setting: TrialSetup) -> EpisodeAnalysis:
    task, condition = setting.task, setting.condition
    trace = trace_of(record, condition, step_limit=task.step_limit(condition))
    return analyze_episode(trace, condition, setting.trained)


def _choice(episode: EpisodeAnalysis) -> Choice | None:
    """Return where the first attempt went; None for look-alikes, which have a label of their own, and for no choice."""
    trace, trained, goals = episode.trace, episode.trained, episode.goals
    target = dict(_standing_at_start(episode))
    first = episode.first_choice
    nothing_asked = episode.condition.expected is Expected.STAY_STILL
    if first is None:
        if not nothing_asked:
            return None
        right: frozenset[str] = frozenset()
        slot, correct, goal = None, True, 0
    else:
        if first.target is AttemptTarget.FOREIGN or first.grasp.slot is None:
            return None
        another = taken_for_another(episode, first)
        right = frozenset(first.asked_slots) - ({first.grasp.slot} if another is not None else set())
        slot, correct = first.grasp.slot, first.target is AttemptTarget.ASKED and another is None
        goal = another if another is not None else first.goal if first.goal is not None else 0
    kind = habit(trained)
    waiting = frozenset(s for s, i in target.items() if episode.kind(i) == kind)
    habit_slots = frozenset() if kind is None else waiting or frozenset(trained.kind_slots.get(kind, ()))
    return Choice(
        layout=frozenset((s, episode.kind(i)) for s, i in target.items()),
        right=right,
        slot=slot,
        correct=correct,
        word_slots=frozenset(trained.word_slots.get(goals[goal].word, ())) if goals else frozenset(),
        habit_slots=habit_slots,
        places=max(2, len(target), len(trace.pick_slots) if slot not in target else 0),
    )


def _standing_at_start(episode: EpisodeAnalysis) -> Iterator[tuple[str, int]]:
    trace = episode.trace
    for i in trace.items:
        slot = trace.slot_near(trace.positions[0, i], THRESHOLDS.slot_reach)
        if slot is not None and not trace.there[0, i]:
            yield slot, i
