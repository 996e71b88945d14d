"""First pass of the diagnosis, in which each trial is diagnosed from its record alone.

The first pass also prepares the input of the second pass.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from betterbench.diagnosis.analysis.collisions import count_collisions
from betterbench.diagnosis.analysis.episode_analysis import AttemptTarget, EpisodeAnalysis, analyze_episode
from betterbench.diagnosis.analysis.harm import find_harm
from betterbench.diagnosis.analysis.trace import Trace, trace_of
from betterbench.diagnosis.instruction_effect import scene_of
from betterbench.diagnosis.labels import LabelEvidence, decide, gather
from betterbench.diagnosis.modes.behavioral_inertia import inertia_in
from betterbench.diagnosis.modes.lexical_kinematic_shortcut import taken_for_another, words_of
from betterbench.diagnosis.verdict import Attempt, Evidence, TrialDiagnosis
from betterbench.errors import RecordError
from betterbench.geometry import horizontal_distance
from betterbench.records import Record, RecordMetadata
from betterbench.tasks import (
    THRESHOLDS,
    Expected,
    GoalTracker,
    TrainingDistribution,
    Truth,
    get_task,
    training_distribution_of,
)
from betterbench.tasks.interventions.resolve import ResolvedCondition, resolve_condition
from betterbench.tasks.labels import Label


@dataclass(frozen=True, slots=True)
class Choice:
    """First attempt of a trial, with its slot and the slots that each rule predicts.

    If slots of two layouts are at the same position, both get the name of the slot in the first layout.

    Attributes:
        layout: Slots that contained an object at the start, each with the kind of this object. Trials with the same
            layout are compared.
        right: Slots where the first attempt would be correct. Empty if no object should be grasped.
        slot: Slot of the first attempt, or None if there was no attempt.
        correct: Whether the first attempt was correct, or whether the policy correctly made no attempt.
        word_slots: Slots where training picked up the object that the relevant word of the instruction refers to.
        habit_slots: Slots of the most frequent first step in training. Empty if no first step is most frequent.
        later_slots: Slots of the objects of later steps. Empty if the instruction leaves the order free.
        places: Number of slots with a graspable object.
        thing: Kind of the object in the slot of the first attempt, or "" if there is none.
        color: Color of that object.
        nearest: Slot of the object that was nearest to the gripper at the start. Empty if no slot contained an object.
        favorite_slots: Slot that the policy may prefer in trials with the same occupied slots. The second pass sets it.
        step_slots: For each later step, in order, the slots of its objects.
        replaced: Whether the usual first step in training was at the slot of the first attempt, but this slot now
            contained a different object. If so, a single trial does not show a habit.
    """

    layout: frozenset[tuple[str, str]]
    right: frozenset[str]
    slot: str | None
    correct: bool
    word_slots: frozenset[str]
    habit_slots: frozenset[str]
    later_slots: frozenset[str]
    places: int
    thing: str = ""
    color: str = ""
    nearest: str = ""
    favorite_slots: frozenset[str] = frozenset()
    step_slots: tuple[frozenset[str], ...] = ()
    replaced: bool = False

    @property
    def stocked(self) -> frozenset[str]:
        """Slots that contained an object at the start of the trial."""
        return frozenset(slot for slot, _ in self.layout)


@dataclass(frozen=True, slots=True)
class Reading:
    """Diagnosis of a record on its own (first pass), with the input for the second pass.

    Attributes:
        diagnosis: Diagnosis of the trial on its own.
        findings: All evidence in the trial.
        choice: First attempt, as input for the second pass. None if the attempt is not evidence for any rule.
    """

    diagnosis: TrialDiagnosis
    findings: tuple[LabelEvidence, ...]
    choice: Choice | None


@functools.cache
def _trained(task: str) -> TrainingDistribution:
    return training_distribution_of(get_task(task))


def diagnose_record(record: Record, *, path: str | None = None) -> TrialDiagnosis:
    """Diagnose a record on its own, without other trials of the policy.

    Labels that need other trials (``visual_layout_bias``, ``lexical_kinematic_shortcut``) are not assigned. The label
    is then ``wrong_object``, and the evidence names the labels that remain possible.
    :func:`~betterbench.diagnosis.diagnose_run` decides between them.

    Raises:
        UnknownNameError: If the task or condition of the record is unknown.
        RecordError: If the record lacks a predicate of its task.
    """
    return read_trial(record, path=path).diagnosis


def read_trial(record: Record, *, path: str | None = None) -> Reading:
    """Diagnose a record on its own (first pass), and collect the input for the second pass."""
    m = record.metadata
    resolved = resolved_of(m)
    task, condition = resolved.task, resolved.condition
    missing = {s.name for s in task.slots} - {s.name for s in m.scene.slots}
    if missing:
        text = f"{m.task}/{m.condition} seed {m.seed}: the record has no slot {min(missing)}. Record the trial again."
        raise RecordError(text)
    trace = trace_of(record, condition, step_limit=task.step_limit(condition))
    harm = () if record.outcome.success else find_harm(record, trace, condition)
    episode = analyze_episode(trace, condition, _trained(task.id), harm=harm, state=record.state)
    findings = gather(record, episode)
    label, evidence = decide(findings)
    diagnosis = replace(
        trial_diagnosis(
            record, episode, condition=resolved.base, axis=resolved.axis, expected=condition.expected.value,
            label=label, evidence=evidence, path=path,
        ),
        harm=episode.harm_words(), needless=tuple(inertia_in(episode)) if record.outcome.success else (),
    )  # fmt: skip
    return Reading(diagnosis, findings, choice_of(episode))


def trial_diagnosis(
    record: Record,
    episode: EpisodeAnalysis,
    *,
    condition: str,
    axis: str | None,
    expected: str,
    label: Label,
    evidence: Evidence,
    path: str | None,
) -> TrialDiagnosis:
    """Return the diagnosis of an analyzed trial in any world, without harm and needless steps."""
    m, trace, first, intended = record.metadata, episode.trace, episode.first_attempt, episode.intended()
    at = None if first is None else first.grasp.object
    return TrialDiagnosis(
        task=m.task, variation=m.variation, condition=condition, axis=axis, seed=m.seed, policy=m.policy,
        instruction=m.instruction, success=record.outcome.success, expected=expected, label=label,
        first_attempt=None if at is None else episode.name(at),
        first_attempt_kind=None if at is None else episode.kind(at),
        first_slot=None if first is None else first.attempt.slot,
        intended=episode.name(intended[0]) if intended else None,
        intended_kind=episode.kind(intended[0]) if intended else None,
        intended_any=tuple(episode.name(i) for i in intended), intention_correct=episode.intention_correct(),
        progress=episode.progress(), attempts=_attempts(episode), evidence=evidence,
        collisions=count_collisions(record, trace), steps=trace.rows - 1, duration_s=float(trace.time[-1]), record=path,
        scene=scene_of(record),
    )  # fmt: skip


def offline_truth(record: Record) -> list[Truth]:
    """Judge all states of a record again, with the same goal tracker as during the trial.

    Returns:
        One goal state for each row of the record. Its flags for subgoals, goal and forbidden events are identical to
        the recorded flags.
    """
    m = record.metadata
    resolved = resolved_of(m)
    template = resolved.task.template
    tracker = GoalTracker(resolved.condition, m.scene, template=template, control_rate_hz=m.control_rate_hz)
    return [tracker.update(state) for state in record.states()]


def resolved_of(metadata: RecordMetadata) -> ResolvedCondition:
    """Return the condition of the trial in a record."""
    return resolve_condition(metadata.task, metadata.variation or metadata.condition)


def _attempts(episode: EpisodeAnalysis) -> tuple[Attempt, ...]:
    """Return the grasp attempts of an episode in chronological order.

    Attempts in which the gripper closed far from all objects are included.
    """
    time = episode.trace.time
    far = (
        Attempt(float(time[g.start]), float(time[g.end]), None, None, "null", secured=False) for g in episode.on_nothing
    )
    return tuple(sorted((*(s.attempt for s in episode.steps), *far), key=lambda a: a.start_s))


def choice_of(episode: EpisodeAnalysis) -> Choice | None:
    """Return the first attempt as input for the second pass, or None.

    The result is None if there was no attempt although one was expected, or if the attempt does not show a preference
    for a slot. It is also None if the attempt was at a look-alike, because such an attempt has its own label.
    """
    trace, trained = episode.trace, episode.trained
    standing = dict(_standing_at_start(episode))
    first = episode.first_choice
    right: frozenset[str] = frozenset()
    slot, correct = None, True
    if first is None:
        if episode.condition.expected is not Expected.STAY_STILL:
            return None
    elif first.target is AttemptTarget.FOREIGN or first.grasp.slot is None or first.between is not None:
        return None
    else:
        another = taken_for_another(episode, first)
        right = frozenset(first.asked_slots) - ({first.grasp.slot} if another is not None else set())
        slot, correct = first.grasp.slot, first.target is AttemptTarget.ASKED and another is None
    kind = trained.habit
    waiting = frozenset(s for s, i in standing.items() if episode.kind(i) == kind)
    place = {s.name: trace.place_of(s.name) for s in trace.info.slots}
    word_slots = [slot for word in words_of(episode, first) for slot in trained.word_slots.get(word, ())]
    habit_slots = () if kind is None else waiting or trained.kind_slots.get(kind, ())
    free = {place[s] for s in right}
    steps = [frozenset({place[s] for s in slots} - free) for slots in _slots_of_later_steps(episode, standing)]
    return Choice(
        layout=frozenset((s, episode.kind(i)) for s, i in standing.items()),
        right=frozenset(place[s] for s in right), slot=None if slot is None else place[slot], correct=correct,
        word_slots=frozenset(place[s] for s in word_slots), habit_slots=frozenset(place[s] for s in habit_slots),
        later_slots=frozenset().union(*steps), step_slots=tuple(steps),
        places=max(2, len(standing), len(set(place.values())) if slot not in standing else 0),
        thing="" if slot not in standing else episode.kind(standing[slot]),
        color="" if slot not in standing else trace.info.objects[standing[slot]].color,
        replaced=slot in standing and slot in habit_slots and slot not in waiting,
        nearest=place[min(standing, key=lambda s: _distance_at_start(trace, standing[s]))] if standing else "",
    )  # fmt: skip


def _distance_at_start(trace: Trace, item: int) -> float:
    """Return the horizontal distance between an object and the gripper in the initial state [m]."""
    return horizontal_distance(trace.positions[0, item].tolist(), trace.tool[0].tolist())


def _slots_of_later_steps(episode: EpisodeAnalysis, standing: Mapping[str, int]) -> Iterator[set[str]]:
    """Yield the slots of the objects of each later step.

    Nothing is yielded if the instruction leaves the order free.
    """
    for g in episode.open_goals(0)[1:] if episode.instruction.ordered else ():
        yield {slot for slot, i in standing.items() if i in episode.meant[g]}


def _standing_at_start(episode: EpisodeAnalysis) -> Iterator[tuple[str, int]]:
    trace = episode.trace
    for i in trace.items:
        slot = trace.slot_near(trace.positions[0, i], THRESHOLDS.slot_reach)
        if slot is not None and not trace.there[0, i]:
            yield slot, i
