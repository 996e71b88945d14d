"""Diagnosis of LIBERO trials: conversion of their records for the detectors, and notes about LIBERO's suites.

LIBERO's tasks have no conditions. The requested objects are read from the goal in the task file, and the initial
positions from the record. The training distribution is read from the files of the base suite
(:mod:`betterbench.tasks.worlds.libero_training`). The regions on the table are those that LIBERO defines. Heights
are measured from the table top, as in betterbench's own scenes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from betterbench.diagnosis.analysis.episode_analysis import analyze_episode
from betterbench.diagnosis.analysis.trace import Trace, Whereabout, finger_forces, touches
from betterbench.diagnosis.labels import decide, gather
from betterbench.diagnosis.modes.policy_error import label_without_record, without_record
from betterbench.diagnosis.thresholds import RESTS_ON_GAP
from betterbench.diagnosis.trial import Reading, choice_of, trial_diagnosis
from betterbench.diagnosis.verdict import Evidence, TrialDiagnosis
from betterbench.errors import RecordError
from betterbench.geometry import conjugate, rotate
from betterbench.interface.state import ObjectInfo, Region, SceneInfo
from betterbench.records import Record, RecordMetadata
from betterbench.tasks import (
    Axis,
    Condition,
    Expected,
    Instruction,
    ObjectSpec,
    Reference,
    Subgoal,
    TrainingDistribution,
    TrialId,
)
from betterbench.tasks.judging.motion import closing_of, graspable
from betterbench.tasks.judging.picked_slots import PickedSlot
from betterbench.tasks.labels import Label
from betterbench.tasks.worlds.libero import SUITES
from betterbench.tasks.worlds.libero_plus import axis_of
from betterbench.tasks.worlds.libero_training import CARRIED, TrainedTask, trained_in, word_of_sentence
from betterbench.wording import listed

AXES = {
    "swap": Axis.SPATIAL_LAYOUT_SHIFT,
    "task": Axis.PRIMITIVE_RECOMPOSITION,
    "object": Axis.ADVERSARIAL_OBJECT_PERTURBATION,
}
"""Variation axis of each change that LIBERO-PRO makes to a task. Paraphrases of the instruction have no axis."""

NOTE = (
    "LIBERO's tasks have one training condition each, and most instructions name one object: habits of order, "
    "skipped steps and correct refusals cannot be observed here. Success is LIBERO's own verdict, and harm to other "
    "objects is not judged. Each LIBERO-PRO suite has its own initial states: a trial and its twin share the task and "
    "the state number, but the robot and object poses differ slightly."
)
"""Note that is added to every diagnosis of a run in LIBERO."""


PLUS_NOTE = (
    "LIBERO-Plus runs each variant once, from the first initial state of its task, so the variants of a task "
    "share one twin. The interval of a gap therefore resamples each twin together with all its variants, and its "
    "p-value exchanges a twin with its variants. Give both runs more initial states (--trials) for more twins."
)
"""Note that is added to every diagnosis of a run in LIBERO-Plus."""

TWINS_CURE = "run the base suite with the same initial-state indices, and pass that run with --twins"

BASE = "base"
"""Name of the only training condition of a task."""


@dataclass(frozen=True, slots=True)
class LiberoRun:
    """Data that the diagnosis of a LIBERO run needs in addition to the records.

    Attributes:
        trained: Training distribution of the base suite.
        instructions: Instructions of the run, by "TASK/CONDITION".
    """

    trained: TrainingDistribution
    instructions: Mapping[str, str]

    @classmethod
    def of(cls, regime: Sequence[TrainedTask], instructions: Mapping[str, str]) -> Self:
        """Compute the training distribution, and return it with the instructions of the run."""
        return cls(trained_in(regime), instructions)

    def read(self, record: Record, *, path: str | None = None) -> Reading:
        """Diagnose a record on its own, without other trials of the policy (first pass).

        Raises:
            RecordError: If the record lacks a field that LIBERO records have.
        """
        here = on_our_table(record)
        goals = _goals(here.metadata)
        if goals is None:
            return Reading(
                by_outcome(here, path, unmet=_joint_unmet(here), axis=_axis(here.metadata.variation)), (), None
            )
        condition = _condition(here.metadata, goals)
        trained = _known_here(self.trained, here.metadata.scene)
        trace = _trace(here, condition, trained)
        episode = analyze_episode(trace, condition, trained)
        findings = gather(here, episode)
        label, evidence = decide(findings)
        diagnosis = trial_diagnosis(
            here, episode, condition="base", axis=_axis(here.metadata.variation), expected=Expected.SUCCEED.value,
            label=label, evidence=evidence, path=path,
        )  # fmt: skip
        return Reading(diagnosis, findings, choice_of(episode))

    def without_record(self, trial: TrialId, policy: str, reason: str | None) -> TrialDiagnosis:
        """Return the diagnosis of a planned trial that has no record."""
        variation = None if trial.condition == "base" else trial.condition
        return TrialDiagnosis(
            task=trial.task, variation=variation, condition="base", axis=_axis(variation), seed=trial.seed,
            policy=policy, instruction=self.instructions.get(f"{trial.task}/{trial.condition}", ""), success=False,
            expected=Expected.SUCCEED.value, label=label_without_record(reason), first_attempt=None,
            first_attempt_kind=None, first_slot=None, intended=None, intended_kind=None, intended_any=(),
            intention_correct=None, progress=0.0, attempts=(), evidence=without_record(reason), collisions=None,
            steps=0, duration_s=0.0, record=None,
        )  # fmt: skip


def untold_by(trials: Sequence[TrialDiagnosis]) -> str:
    """Return advice about the LIBERO-PRO suites that would make the diagnosis more complete than base suites do.

    Return an empty string if the run already contains such a suite.
    """
    if any(trial.variation is not None for trial in trials):
        return ""
    told = [f"{suite}_swap" for suite in dict.fromkeys(suite_of(t.task) for t in trials) if f"{suite}_swap" in SUITES]
    if not told:
        return ""
    each = "it" if len(told) == 1 else "each"
    return f"run {listed(told)} with the same policy, and diagnose {each} with --twins and the run of its base suite"


def suite_of(task: str) -> str:
    """Return the base suite of a LIBERO task ("libero_object-03"). All tasks of a base suite are judged together."""
    return task.rpartition("-")[0]


def on_our_table(record: Record) -> Record:
    """Convert a LIBERO record to betterbench's convention for heights and for names of target regions.

    Raises:
        RecordError: If the record does not name any region on a table.
    """
    m = record.metadata
    if not m.scene.slots:
        raise RecordError(
            f"{m.task}/{m.condition} seed {m.seed}: the record names no regions on the table. Record the trial again."
        )
    height = m.scene.slots[0].position[2]
    lower = np.array([0.0, 0.0, height])
    x, y, z = m.scene.home_position
    info = replace(
        m.scene,
        objects=tuple(map(_with_regions, m.scene.objects)),
        slots=tuple(replace(s, position=(*s.position[:2], s.position[2] - height)) for s in m.scene.slots),
        home_position=(x, y, z - height),
    )
    return replace(
        record,
        metadata=replace(m, scene=info),
        bodies=tuple("table" if body == "floor" else body for body in record.bodies),
        ee_position=record.ee_position - lower,
        commanded_position=record.commanded_position - lower,
        object_positions=record.object_positions - lower,
    )


def _with_regions(thing: ObjectInfo) -> ObjectInfo:
    """Add the target regions for the relations "in" and "on" to an object."""
    inside = [replace(r, name="inside") for r in thing.regions if r.name == "contain_region"]
    half = (0.5 * thing.size_m[0], 0.5 * thing.size_m[1], 0.5 * thing.size_m[2])
    return replace(thing, regions=(*inside, Region("floor", (0.0, 0.0, 0.0), half)))


def _goals(m: RecordMetadata) -> tuple[Subgoal, ...] | None:
    """Return the subgoals of a LIBERO goal, or None if a part of the goal moves a joint, such as a drawer's joint."""
    found = []
    known = {o.name: o for o in m.scene.objects}
    for name in m.subgoal_names:
        relation, _, rest = name.removesuffix(")").partition("(")
        about = rest.split(", ")
        target = next((n for n in known if len(about) == 2 and (about[1] == n or about[1].startswith(f"{n}_"))), None)
        if relation not in CARRIED or target is None or about[0] not in known or known[about[0]].fixed:
            return None
        kind = known[about[0]].kind
        word = word_of_sentence(m.instruction, kind) if len(m.subgoal_names) == 1 else kind
        found.append(Subgoal(name, CARRIED[relation], Reference(kind=kind), target, word))
    return tuple(found)


def _condition(m: RecordMetadata, goals: tuple[Subgoal, ...]) -> Condition:
    objects = tuple(ObjectSpec(o.name, o.kind, o.category, role=o.role, fixed=o.fixed) for o in m.scene.objects)  # type: ignore[arg-type]
    layout = {o.name: o.slot for o in m.scene.objects if o.slot is not None}
    return Condition(m.task, m.condition, objects, layout, Instruction(m.instruction, goals))


def _known_here(trained: TrainingDistribution, info: SceneInfo) -> TrainingDistribution:
    """Return a copy of the training distribution that contains only the regions that exist in a scene."""
    here = {slot.name for slot in info.slots}

    def only(places: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
        return {name: tuple(slot for slot in slots if slot in here) for name, slots in places.items()}

    standing = {slot: kinds for slot, kinds in trained.standing_kinds.items() if slot in here}
    return replace(
        trained, word_slots=only(trained.word_slots), kind_slots=only(trained.kind_slots), standing_kinds=standing
    )


def _trace(record: Record, condition: Condition, trained: TrainingDistribution) -> Trace:
    """Return the trace of a record. LIBERO's own verdict decides whether a requested relation holds."""
    info, rows = record.metadata.scene, len(record)
    goals = condition.instruction.subgoals
    asked = [name.partition("(")[2].partition(",")[0] for name in record.metadata.subgoal_names]
    meant = tuple((info.index(name),) for name in asked)
    targets = tuple(info.index(goal.target) for goal in goals)
    left, right, hand, arm = touches(record, rows, ("left_finger", "right_finger", "hand", "arm"))
    whereabouts = _whereabouts(record, goals, targets)
    there = np.zeros((rows, len(info.objects)), dtype=np.bool_)
    for w in whereabouts:
        there[:, w.object] |= w.rows
    serves = np.zeros((rows, len(goals), len(info.objects)), dtype=np.bool_)
    for g, (i,) in enumerate(meant):
        serves[:, g, i] = record.subgoals[:, g]
    width, rate_hz = record.finger_width, record.metadata.control_rate_hz
    return Trace(
        info=info, rate_hz=rate_hz, time=record.time, touched=left | right | hand,
        by_arm=arm, tool=record.ee_position, width=width,
        closing=closing_of(record.gripper_command, width, (left | right).any(axis=1), rate_hz=rate_hz),
        positions=record.object_positions, quaternions=record.object_quaternions, left=left, right=right,
        held=record.held, force=finger_forces(record, rows), whereabouts=whereabouts, there=there,
        picked=_picked_slots(info, trained), serves=serves, done=record.subgoals, meant=meant, targets=targets,
        drawers=(),
    )  # fmt: skip


def _picked_slots(info: SceneInfo, trained: TrainingDistribution) -> tuple[PickedSlot, ...]:
    """Return the regions from which objects are picked up in the base suite.

    The regions do not include the points where the gripper closes, because LIBERO's files do not state them.
    """
    names = {slot for slots in trained.kind_slots.values() for slot in slots}
    at = {slot.name: (slot.position[0], slot.position[1]) for slot in info.slots if slot.name in names}
    return tuple(PickedSlot(name, (x, y), ((x, y, 0.0),)) for name, (x, y) in at.items())


def _whereabouts(record: Record, goals: Sequence[Subgoal], targets: Sequence[int]) -> tuple[Whereabout, ...]:
    """Return the rows of the trace where each object was in or on a target of the instruction."""
    info = record.metadata.scene
    found = []
    for goal, t in dict.fromkeys((g.relation, t) for g, t in zip(goals, targets, strict=True)):
        target = info.objects[t]
        for i in graspable(info):
            thing = info.objects[i]
            middle = np.array([0.0, 0.0, 0.5 * thing.size_m[2]])
            apart = record.object_positions[:, i] + middle - record.object_positions[:, t]
            turns = record.object_quaternions[:, t].tolist()
            local = np.array([rotate(conjugate((w, x, y, z)), a) for (w, x, y, z), a in zip(turns, apart, strict=True)])
            box = next((r for r in target.regions if r.name == "inside" and goal == "inside"), target.regions[-1])
            half = np.array(box.half_size)
            over = (np.abs(local[:, :2] - np.array(box.position[:2])) <= half[:2]).all(axis=1)
            top = target.size_m[2] + 0.5 * thing.size_m[2] + (0.0 if goal == "inside" else RESTS_ON_GAP)
            rows = over & (local[:, 2] >= 0.0) & (local[:, 2] <= top)
            found.append(Whereabout(i, goal, t, "", rows))
    return tuple(found)


def _joint_unmet(record: Record) -> tuple[Label, Evidence]:
    """Return the label and the evidence of a failed trial whose goal includes moving a joint."""
    end = float(record.time[-1])
    text = (
        f"The goal {', '.join(record.metadata.subgoal_names)} is not met at the step limit. Part of the goal moves a "
        "joint, and betterbench does not judge the cause of such failures in LIBERO."
    )
    return Label.TIMEOUT, Evidence("joint_not_judged", text, end, end)


def by_outcome(
    record: Record,
    path: str | None,
    *,
    unmet: tuple[Label, Evidence],
    axis: str | None,
    condition: str = BASE,
) -> TrialDiagnosis:
    """Return a diagnosis that uses only the outcome of a trial.

    Args:
        record: Record of the trial.
        path: Path of the record, as it is stored in the diagnosis.
        unmet: Label and evidence to use if the trial did not succeed.
        axis: Variation axis of the trial, or None.
        condition: Name of the training condition.
    """
    m, outcome, end = record.metadata, record.outcome, float(record.time[-1])
    if outcome.success:
        label, evidence = Label.SUCCESS, Evidence("goal", "The goal is met.", end, end)
    elif outcome.termination in ("policy_error", "interrupted"):
        label = Label.POLICY_ERROR
        evidence = Evidence(
            outcome.termination, f"The episode ended early: {outcome.error or 'no reason recorded'}", end, end
        )
    else:
        label, evidence = unmet
    done = record.subgoals.any(axis=0)
    return TrialDiagnosis(
        task=m.task, variation=m.variation, condition=condition, axis=axis, seed=m.seed, policy=m.policy,
        instruction=m.instruction, success=outcome.success, expected=Expected.SUCCEED.value, label=label,
        first_attempt=None, first_attempt_kind=None, first_slot=None, intended=None, intended_kind=None,
        intended_any=(), intention_correct=None, progress=float(done.mean()) if done.size else 0.0, attempts=(),
        evidence=evidence, collisions=None, steps=len(record) - 1, duration_s=end, record=path,
    )  # fmt: skip


def _axis(variation: str | None) -> str | None:
    axis = AXES.get(variation or "")
    return axis_of(variation) if axis is None else axis.value
