"""Diagnosis of a run: first pass (each trial on its own), second pass (all trials together), and findings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from betterbench.diagnosis.decider import Decider, decider_of
from betterbench.diagnosis.favorite_thing import FavoriteThing, favorite_thing
from betterbench.diagnosis.findings import find_findings, find_notes
from betterbench.diagnosis.instruction_effect import (
    SAME_TARGET,
    SAME_THING,
    effect_findings,
    effect_words,
    tasks_without_effect,
)
from betterbench.diagnosis.labels import decide
from betterbench.diagnosis.libero import BASE
from betterbench.diagnosis.measures.metrics import OF_CAUSES, compute_metrics, twins
from betterbench.diagnosis.readers import OwnReader, Reader, reader_of
from betterbench.diagnosis.ruling import Ruling
from betterbench.diagnosis.second_pass import judge_policy
from betterbench.diagnosis.task_rules import TaskRules
from betterbench.diagnosis.trial import Choice, Reading
from betterbench.diagnosis.until_decided import UntilDecided, decided_of
from betterbench.diagnosis.verdict import Metric, RunDiagnosis, TrialDiagnosis
from betterbench.diagnosis.versions import RecordVersions
from betterbench.errors import InvalidInputError, RecordError
from betterbench.jobs import OnCount
from betterbench.json_form import open_form, read_form
from betterbench.records import Record, RunFolder
from betterbench.statistics import StoppingRule
from betterbench.tasks import THRESHOLDS, TrialId
from betterbench.tasks.labels import Label


@dataclass(slots=True)
class _Trials:
    """Planned trials of a run, with the results of the first pass.

    Attributes:
        plan: Trials that are part of the diagnosis, in the order of the plan.
        readings: Results of the first pass, by trial.
        missing: Reason why a trial has no record, by trial. None if the reason is unknown.
        pending: Trials that a run in progress has not reached yet. They are not part of the diagnosis.
        until_decided: Stopping rule and decisions, or None for a run that executes all planned trials.
    """

    plan: list[TrialId] = field(default_factory=list)
    readings: dict[TrialId, Reading] = field(default_factory=dict)
    missing: dict[TrialId, str | None] = field(default_factory=dict)
    pending: list[TrialId] = field(default_factory=list)
    until_decided: UntilDecided | None = None

    def outcome(self, trial: TrialId) -> bool | None:
        """Return whether a trial succeeded, or None if the trial has no record."""
        return self.readings[trial].diagnosis.success if trial in self.readings else None


def diagnose_run(
    folder: RunFolder | Path,
    *,
    allow_mixed: bool = False,
    whole: bool = False,
    twins_in: RunFolder | None = None,
    on_progress: OnCount | None = None,
) -> RunDiagnosis:
    """Diagnose a run. The result contains every planned trial, finished or not.

    While a process is still writing to the run, the trials that it has not reached yet are pending and are not counted.
    After the process has ended, trials that it did not reach are unfinished: they count in the denominator of every
    rate over planned trials, but not as failures. In a run with ``--until-decided``, this applies to the trials of the
    current round. Trials that are no longer needed because a verdict was reached are left out.

    Args:
        folder: The run, or its folder.
        allow_mixed: Whether to accept records with different versions, engines or policies.
        whole: Whether to count the trials that a run in progress has not reached yet as trials without a record.
        twins_in: For a run in LIBERO-PRO, a run of the base suite. The twin of a trial is the trial of the base run
            with the same number.
        on_progress: Called with the number of processed trials and the number of planned trials.

    Raises:
        RecordError: If the plan or a record cannot be read.
        RunConflictError: If versions, engines or policies are mixed and ``allow_mixed`` is False.
        InvalidInputError: If ``twins_in`` contains no twin of a planned trial.
        UnknownNameError: If the plan names an unknown task, variation or training condition.
    """
    run = folder if isinstance(folder, RunFolder) else RunFolder.open(folder)
    policy, plan, rule = read_plan(run)
    reader = reader_of(run)
    # This is checked before the journal is read, so that a run that ends between the two counts as complete.
    running = run.is_running and not whole
    entries = {TrialId(e.task, e.variation or e.condition, e.seed): e for e in run.entries()}
    trials, versions = _Trials(), RecordVersions(allow_mixed=allow_mixed)
    for number, trial in enumerate(plan):
        if on_progress is not None:
            on_progress(number, len(plan))
        entry = entries.get(trial)
        if entry is None or entry.status != "done":
            continue
        _read_one(run, trial, trials, versions, reader)
    expected = frozenset(plan)
    if rule is not None:
        trials.until_decided = decided_of(rule, plan, trials.outcome)
        expected = trials.until_decided.waiting
    for trial in plan:
        entry = entries.get(trial)
        if entry is None and trial not in expected:
            continue
        if entry is None and running:
            trials.pending.append(trial)
            continue
        trials.plan.append(trial)
        if trial not in trials.readings:
            trials.missing[trial] = None if entry is None else entry.message or "its record is missing"
    if twins_in is not None:
        _take_in_twins(twins_in, trials, versions, reader)
    found = _diagnose(policy, trials, versions.found, reader)
    return replace(found, notes=(*_policy_notes(run.context), *reader.notes(run, found), *found.notes))


def _read_one(run: RunFolder, trial: TrialId, trials: _Trials, versions: RecordVersions, reader: Reader) -> None:
    """Read the record of a finished trial, if the record exists."""
    path = run.record_path(trial.task, trial.condition, trial.seed)
    if path.exists():
        record = run.read_record(trial.task, trial.condition, trial.seed)
        versions.add(record.metadata)
        at = path.relative_to(run.path).as_posix()
        trials.readings[trial] = reader.read(record, path=at)


def _take_in_twins(run: RunFolder, trials: _Trials, versions: RecordVersions, reader: Reader) -> None:
    """Read the training twins of the planned trials from a run of the base suite, and add them to the trials."""
    wanted = {TrialId(t.task, BASE, t.seed) for t in trials.plan if t.condition != BASE}
    found = [TrialId(e.task, e.variation or e.condition, e.seed) for e in run.entries() if e.status == "done"]
    shared = [trial for trial in found if trial in wanted and trial not in trials.plan]
    if not reader.twins_elsewhere or not shared:
        raise InvalidInputError(
            str(run.path),
            "it contains no counterfactual twin of the planned trials",
            "Pass a run of the LIBERO base suite that was made with the same --seed",
        )
    for trial in shared:
        record = run.read_record(trial.task, trial.condition, trial.seed)
        versions.add(record.metadata, but="suite_version")
        trials.plan.append(trial)
        trials.readings[trial] = reader.read(record)


def diagnose_records(records: Sequence[Record], *, allow_mixed: bool = False) -> RunDiagnosis:
    """Diagnose records of one policy without a run folder.

    Raises:
        RunConflictError: If versions, engines or policies are mixed and ``allow_mixed`` is False.
        RecordError: If no record is given, or if a record lacks a predicate of its task.
    """
    if not records:
        raise RecordError("There are no records to diagnose. Pass at least one record.")
    trials, versions, reader = _Trials(), RecordVersions(allow_mixed=allow_mixed), OwnReader()
    for record in records:
        versions.add(record.metadata)
        reading = reader.read(record)
        trials.plan.append(reading.diagnosis.trial_id)
        trials.readings[reading.diagnosis.trial_id] = reading
    return _diagnose(records[0].metadata.policy, trials, versions.found, reader)


def _policy_notes(context: Mapping[str, Any]) -> Iterator[str]:
    """Yield a note for each time that the run was continued with a changed policy."""
    changes = context.get("policy_changes", [])
    for change in changes if isinstance(changes, list) else []:
        if isinstance(change, dict):
            yield (
                f"The policy changed during the run, after {change.get('trials_before', 'some')} trials: "
                f"{change.get('difference', 'it declared something else')}. The numbers combine both versions."
            )


@open_form
@dataclass(frozen=True, slots=True)
class _PlannedForm:
    """Planned trial, as it is stored in a plan file."""

    task: str
    seed: Annotated[int, Field(ge=0)]
    condition: str
    variation: str | None = None


@open_form
@dataclass(frozen=True, slots=True)
class _PlanForm:
    """Fields of a stored plan that the diagnosis reads."""

    policy: str
    trials: list[_PlannedForm]
    until_decided: StoppingRule | None = None


_PLAN = TypeAdapter(_PlanForm)


def read_plan(run: RunFolder) -> tuple[str, tuple[TrialId, ...], StoppingRule | None]:
    """Return the policy, the planned trials and the stopping rule in the plan of a run.

    The stopping rule is None unless the run was started with ``--until-decided``.

    Raises:
        RecordError: If the plan lacks these fields or they are malformed.
    """
    where = f"{run.path / 'run.json'}: plan"
    plan = read_form(_PLAN, run.plan, where=where, cure="Restore the file, or start a new run", raises=RecordError)
    trials = tuple(TrialId(t.task, t.variation or t.condition, t.seed) for t in plan.trials)
    twice = next((trial for trial, times in Counter(trials).items() if times > 1), None)
    if twice is not None:
        raise RecordError(f"{where}: {twice} is planned twice. Remove one of the two entries.")
    return plan.policy, trials, plan.until_decided


def _diagnose(policy: str, trials: _Trials, versions: dict[str, str], reader: Reader) -> RunDiagnosis:
    """Compute the second pass, the metrics, the findings and the notes from the results of the first pass.

    Decision rules are judged in each task separately. In LIBERO, they are judged in each suite, because each task has
    only one instruction.
    """
    group = {t.task: reader.group(t.task) for t in trials.plan}
    choices: dict[str, dict[str, Choice]] = {}
    for trial in trials.plan:
        reading = trials.readings.get(trial)
        if reading is not None and reading.choice is not None:
            choices.setdefault(group[trial.task], {})[str(trial)] = reading.choice
    judged = judge_policy(choices)
    rules = {task: judged[name] for task, name in group.items() if name in judged}
    found = tuple(
        _settled(trial, trials.readings[trial], rules)
        if trial in trials.readings
        else reader.without_record(trial, policy, trials.missing.get(trial))
        for trial in trials.plan
    )
    unused = tasks_without_effect([t for t in found if not t.ambiguous])
    decider = decider_of({task: list(choices[group[task]].values()) for task in unused if group[task] in choices})
    found = tuple(
        _whatever_is_asked(t, trials.readings[t.trial_id], unused[t.task], decider)
        if t.task in unused and t.trial_id in trials.readings
        else t
        for t in found
    )
    favorites = _favorites(found, choices, group) if reader.finds_favorites else {}
    found = tuple(
        _wherever_it_stands(t, trials.readings[t.trial_id], favorites[group[t.task]])
        if group[t.task] in favorites and t.trial_id in trials.readings
        else t
        for t in found
    )
    waiting = tuple(reader.without_record(trial, policy, None) for trial in trials.pending)
    broken = sorted(str(trial) for trial, reason in trials.missing.items() if reason)
    decided = trials.until_decided
    counted = [t for t in found if not t.ambiguous]
    even = None if decided is None else len(twins([t for t in counted if t.seed in decided.first_seeds]))
    notes = find_notes(
        found, judged, broken, len(twins(counted)), pending=len(waiting), even_pairs=even, cure=reader.twins_cure
    )
    diagnosis = RunDiagnosis(
        policy=policy, trials=found, metrics=compute_metrics(found, decided),
        findings=(
            *effect_findings(unused, str(decider)),
            *(favorite.finding(suite) for suite, favorite in favorites.items()),
            *find_findings(counted, rules),
        ),
        notes=(*(() if decided is None else decided.notes()), *notes, *reader.last_notes(found)),
        thresholds=THRESHOLDS.to_json(), versions=versions, waiting=waiting, until_decided=decided,
    )  # fmt: skip
    if diagnosis.causes_judged:
        return diagnosis
    return replace(diagnosis, metrics=tuple(m for m in diagnosis.metrics if m.name not in OF_CAUSES))


def _settled(trial: TrialId, reading: Reading, rules: Mapping[str, TaskRules]) -> TrialDiagnosis:
    """Return the diagnosis of a trial after the ruling of the second pass has been applied to it."""
    found = rules.get(trial.task)
    ruling = None if found is None else found.rulings.get(str(trial))
    if ruling is None:
        return reading.diagnosis
    label, evidence = decide(reading.findings, ruling)
    return replace(reading.diagnosis, label=label, evidence=evidence)


def _whatever_is_asked(trial: TrialDiagnosis, reading: Reading, effect: Metric, decider: Decider) -> TrialDiagnosis:
    """Return the diagnosis of a trial of a policy that has been found not to use the instruction.

    A wrong first attempt that no rule explains is labeled as independent of the instruction. So is an attempt at the
    policy's favorite slot in this task, unless a favorite slot explains the attempts in all tasks.
    """
    if reading.choice is None or reading.choice.correct:
        return trial
    if trial.label is Label.VISUAL_LAYOUT_BIAS and decider.may_be_place:
        return trial
    return _not_by_instruction(trial, reading, SAME_TARGET, f"{effect_words(effect)} The deciding cue is {decider}.")


def _favorites(
    found: Sequence[TrialDiagnosis], choices: Mapping[str, Mapping[str, Choice]], group: Mapping[str, str]
) -> dict[str, FavoriteThing]:
    """Return the policy's favorite kind of object in each suite that has one.

    Suites are left out if a decision rule explains all attempts at this kind of object.
    """
    favorites = {suite: favorite_thing(mine) for suite, mine in choices.items()}
    unexplained = {
        (group[t.task], choices[group[t.task]][str(t.trial_id)].thing)
        for t in found
        if t.label is Label.WRONG_OBJECT and str(t.trial_id) in choices.get(group[t.task], {})
    }
    return {suite: f for suite, f in favorites.items() if f is not None and (suite, f.kind) in unexplained}


def _wherever_it_stands(trial: TrialDiagnosis, reading: Reading, favorite: FavoriteThing) -> TrialDiagnosis:
    if trial.label is not Label.WRONG_OBJECT or reading.choice is None or reading.choice.correct:
        return trial
    if reading.choice.thing != favorite.kind:
        return trial
    return _not_by_instruction(trial, reading, SAME_THING, favorite.words())


def _not_by_instruction(trial: TrialDiagnosis, reading: Reading, rule: str, why: str) -> TrialDiagnosis:
    """Label a wrong first attempt as independent of the instruction, unless a rule explains the attempt."""
    if trial.label not in (Label.WRONG_OBJECT, Label.VISUAL_LAYOUT_BIAS):
        return trial
    label, evidence = decide(reading.findings, Ruling("rejected", place="upheld"))
    if label is not Label.VISUAL_LAYOUT_BIAS:
        return trial
    return replace(trial, label=label, evidence=replace(evidence, rule=rule, text=f"{evidence.text} {why}"))
