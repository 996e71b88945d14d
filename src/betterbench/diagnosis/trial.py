"""One trial: from its record to what the record alone proves, and to what the second pass needs to know about it."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

from betterbench.diagnosis.collisions import count_collisions
from betterbench.diagnosis.course import Course, Standing, course_of
from betterbench.diagnosis.labels import ALONE, Finding, Ruling, decide, gather
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
    Regime,
    Task,
    Truth,
    get_task,
    regime_of,
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
    findings: tuple[Finding, ...]
    choice: Choice | None


@dataclass(frozen=True, slots=True)
class Setting:
    """The task and the condition of a trial.

    Attributes:
        task: The task.
        condition: The condition in force.
        base: Name of the training condition: its own, or the one that the variation is derived from.
        axis: Axis of the variation, or None.
        regime: Regularities of the training regime.
    """

    task: Task
    condition: Condition
    base: str
    axis: str | None
    regime: Regime


@functools.cache
def setting_of(task_name: str, name: str) -> Setting:
    """Return the setting of a variation or training condition.

    Raises:
        UnknownNameError: If there is no such task, variation or training condition.
    """
    task = get_task(task_name)
    regime = regime_of(task)
    if any(c.name == name for c in task.training):
        return Setting(task, task.train(name), name, None, regime)
    variation = task.variation(name)
    condition, _ = vary(task, variation)
    return Setting(task, condition, variation.base, variation.axis.value, regime)


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
    setting = setting_of(m.task, m.variation or m.condition)
    course = _course(record, setting)
    findings = gather(record, course)
    label, evidence = decide(findings, ALONE)
    first = course.first_attempt
    rows = course.trace.rows
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
        intended=course.intended(),
        intention_correct=course.intention_correct(),
        progress=course.progress(),
        attempts=tuple(s.attempt for s in course.steps),
        evidence=evidence,
        collisions=count_collisions(record, course.trace),
        steps=rows - 1,
        duration_s=float(course.trace.time[-1]),
        record=path,
    )
    return Reading(diagnosis, findings, _choice(course))


def settled(reading: Reading, ruling: Ruling) -> Finding:
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
    setting = setting_of(m.task, m.variation or m.condition)
    tracker = GoalTracker(setting.condition, m.scene, template=setting.task.template, control_rate_hz=m.control_rate_hz)
    return [tracker.update(state) for state in record.states()]


def _course(record: Record, setting: Setting) -> Course:
    task, condition = setting.task, setting.condition
    trace = trace_of(record, condition, step_limit=task.step_limit(condition))
    return course_of(trace, condition, setting.regime)


def _choice(course: Course) -> Choice | None:
    """Return where the first attempt went; None for look-alikes, which have a label of their own, and for no choice."""
    trace, regime, goals = course.trace, course.regime, course.goals
    standing = dict(_standing_at_start(course))
    first = course.first_choice
    nothing_asked = course.condition.expected is Expected.STAY_STILL
    if first is None:
        if not nothing_asked:
            return None
        right: frozenset[str] = frozenset()
        slot, correct, goal = None, True, 0
    else:
        if first.standing is Standing.FOREIGN or first.grasp.slot is None:
            return None
        another = taken_for_another(course, first)
        right = frozenset(first.asked_slots) - ({first.grasp.slot} if another is not None else set())
        slot, correct = first.grasp.slot, first.standing is Standing.ASKED and another is None
        goal = another if another is not None else first.goal if first.goal is not None else 0
    kind = habit(regime)
    waiting = frozenset(s for s, i in standing.items() if course.kind(i) == kind)
    habit_slots = frozenset() if kind is None else waiting or frozenset(regime.kind_slots.get(kind, ()))
    return Choice(
        layout=frozenset((s, course.kind(i)) for s, i in standing.items()),
        right=right,
        slot=slot,
        correct=correct,
        word_slots=frozenset(regime.word_slots.get(goals[goal].word, ())) if goals else frozenset(),
        habit_slots=habit_slots,
        places=max(2, len(standing), len(trace.pick_slots) if slot not in standing else 0),
    )


def _standing_at_start(course: Course) -> Iterator[tuple[str, int]]:
    trace = course.trace
    for i in trace.items:
        slot = trace.slot_near(trace.positions[0, i], THRESHOLDS.slot_reach)
        if slot is not None and not trace.there[0, i]:
            yield slot, i
