"""A run: every planned trial diagnosed, the second pass over all of them, and what they prove together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from betterbench.diagnosis.findings import find_findings, find_notes
from betterbench.diagnosis.limits import LIMITS
from betterbench.diagnosis.metrics import compute_metrics, twins
from betterbench.diagnosis.modes.policy_error import without_record
from betterbench.diagnosis.second_pass import TaskRules, judge_policy
from betterbench.diagnosis.trial import Choice, Reading, read_trial, settled, setup_of
from betterbench.diagnosis.verdict import RunDiagnosis, TrialDiagnosis
from betterbench.errors import RecordError, RunConflictError
from betterbench.recording import Record, RecordMetadata, RunFolder
from betterbench.tasks import THRESHOLDS
from betterbench.tasks.labels import Label

_SCENE_KEYS = ("model", "scene", "hash")
"""Words in the names of those parts of an engine fingerprint that differ from scene to scene by design."""


@dataclass(frozen=True, slots=True)
class PlannedTrial:
    """One trial of a run's plan.

    Attributes:
        task: Task id.
        name: Name of the variation, or of the training condition.
        variation: Name of the variation, or None.
        seed: Seed.
    """

    task: str
    name: str
    variation: str | None
    seed: int

    @property
    def key(self) -> str:
        """Identifier within a run."""
        return f"{self.task}/{self.name}/{self.seed}"


def diagnose_run(folder: RunFolder | Path, *, allow_mixed: bool = False, whole: bool = False) -> RunDiagnosis:
    """Return what all records of a run prove. Every planned trial appears, finished or not.

    While a process is still writing to the run, the trials that it has not reached are listed as pending and counted
    nowhere. Once nobody writes any more, they are trials without a record.

    Args:
        folder: The run, or its folder.
        allow_mixed: True to diagnose records of several versions, engines or policies together.
        whole: True to count the trials that a running run has not reached as trials without a record, too.

    Raises:
        RecordError: If the plan or a record cannot be read.
        RunConflictError: If versions, engines or policies are mixed and that is not allowed.
        UnknownNameError: If the plan names an unknown task, variation or training condition.
    """
    run = folder if isinstance(folder, RunFolder) else RunFolder.open(folder)
    policy, plan = read_plan(run)
    running = run.is_running and not whole  # asked before the journal is read: a run that ends now has its last lines
    entries = {(e.task, e.variation or e.condition, e.seed): e for e in run.entries()}
    readings: dict[str, Reading] = {}
    missing: dict[str, str | None] = {}
    pending: list[str] = []
    versions = RecordVersions(allow_mixed=allow_mixed)
    for planned in plan:
        entry = entries.get((planned.task, planned.name, planned.seed))
        path = run.record_path(planned.task, planned.name, planned.seed)
        if entry is None and running:
            pending.append(planned.key)
            continue
        if entry is None or entry.status != "done" or not path.exists():
            missing[planned.key] = None if entry is None else entry.message or "its record is not there"
            continue
        record = run.read_record(planned.task, planned.name, planned.seed)
        versions.add(record.metadata)
        readings[planned.key] = read_trial(record, path=path.relative_to(run.path).as_posix())
    waiting = set(pending)
    reached = [planned for planned in plan if planned.key not in waiting]
    found = _diagnose(policy, reached, readings, missing, versions.found, pending=pending)
    return replace(found, notes=(*_policy_notes(run.context), *found.notes))


def diagnose_records(records: Sequence[Record], *, allow_mixed: bool = False) -> RunDiagnosis:
    """Return what several records of one policy prove, without a run folder.

    Args:
        records: The records, in the order in which the trials are listed.
        allow_mixed: True to diagnose records of several versions, engines or policies together.

    Raises:
        RunConflictError: If versions, engines or policies are mixed and that is not allowed.
        RecordError: If there is no record, or one lacks a predicate of its task.
    """
    if not records:
        raise RecordError("There are no records to diagnose. Give at least one.")
    versions = RecordVersions(allow_mixed=allow_mixed)
    plan, readings = [], {}
    for record in records:
        m = record.metadata
        versions.add(m)
        planned = PlannedTrial(m.task, m.variation or m.condition, m.variation, m.seed)
        plan.append(planned)
        readings[planned.key] = read_trial(record)
    return _diagnose(records[0].metadata.policy, plan, readings, {}, versions.found)


def _policy_notes(context: Mapping[str, Any]) -> Iterator[str]:
    """Yield a note for every time that a run went on although its policy had changed."""
    changes = context.get("policy_changes", [])
    for change in changes if isinstance(changes, list) else []:
        if isinstance(change, dict):
            yield (
                f"The policy changed during the run, after {change.get('trials_before', 'some')} trials: "
                f"{change.get('difference', 'it declared something else')}. The numbers are of both together."
            )


def read_plan(run: RunFolder) -> tuple[str, tuple[PlannedTrial, ...]]:
    """Return the policy and the planned trials of a run.

    Raises:
        RecordError: If the plan lacks them or they are malformed.
    """
    policy = run.plan.get("policy")
    listed = run.plan.get("trials", run.plan.get("plan"))
    where = run.path / "run.json"
    if not isinstance(policy, str):
        raise RecordError(f"{where}: plan.policy is missing or no text. Restore the file, or start the run again.")
    if not isinstance(listed, list):
        raise RecordError(f"{where}: plan.trials is missing or no list. Restore the file, or start the run again.")
    trials = tuple(_planned(form, f"{where}: plan.trials[{i}]") for i, form in enumerate(listed))
    keys = [t.key for t in trials]
    if len(set(keys)) < len(keys):
        twice = next(k for i, k in enumerate(keys) if k in keys[:i])
        raise RecordError(f"{where}: {twice} is planned twice. Remove one of the two.")
    return policy, trials


def _planned(form: Any, where: str) -> PlannedTrial:  # noqa: ANN401 -- JSON of a file, checked here
    if not isinstance(form, dict):
        raise RecordError(f"{where} is no object. Restore the file.")
    task, variation, seed = form.get("task"), form.get("variation"), form.get("seed")
    name = form.get("condition") if variation is None else variation
    if not isinstance(task, str) or not isinstance(name, str):
        raise RecordError(f"{where} lacks its task, or both variation and condition. Restore the file.")
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise RecordError(f"{where}.seed is {seed!r}, no integer of at least 0. Restore the file.")
    return PlannedTrial(task, name, variation, seed)


class RecordVersions:
    """The versions found in the records of a run, which must not be mixed silently."""

    def __init__(self, *, allow_mixed: bool) -> None:
        """Begin without any."""
        self._allow_mixed = allow_mixed
        self._seen: dict[str, dict[str, str]] = {}

    @property
    def found(self) -> dict[str, str]:
        """All versions by name; several values of one name are joined by " | ". The policy is checked, but is none."""
        return {
            name: " | ".join(values)
            for name, values in sorted(self._seen.items())
            if name != "policy" or len(values) > 1
        }

    def add(self, metadata: RecordMetadata) -> None:
        """Take in the versions of one record.

        Raises:
            RunConflictError: If one differs from those before and mixing is not allowed.
        """
        trial = f"{metadata.task}/{metadata.condition} seed {metadata.seed}"
        for name, value in _versions(metadata):
            known = self._seen.setdefault(name, {})
            if known and value not in known and not self._allow_mixed:
                other, at = next(iter(known.items()))
                raise RunConflictError(
                    f"{name} is {value!r} in the record of {trial} and {other!r} in that of {at}. "
                    "Run one of them again, or allow mixed versions and read the numbers with care."
                )
            known.setdefault(value, trial)
        wanted = setup_of(metadata.task, metadata.variation or metadata.condition).task.version
        if metadata.task_version != wanted and not self._allow_mixed:
            raise RunConflictError(
                f"{trial} was recorded with version {metadata.task_version} of its task and is judged with version "
                f"{wanted}. Judge it with the betterbench that recorded it, or record it again."
            )


def _versions(metadata: RecordMetadata) -> Iterator[tuple[str, str]]:
    yield "policy", metadata.policy
    yield "package_version", metadata.package_version
    yield "suite_version", metadata.suite_version
    yield "schema_version", str(metadata.schema_version)
    yield f"task_version:{metadata.task}", str(metadata.task_version)
    yield "action_space", metadata.action_space
    yield "control_rate_hz", f"{metadata.control_rate_hz:g}"
    yield "camera_preset", str(metadata.camera_preset)
    yield "render_quality", str(metadata.render_quality)
    for name, value in sorted(metadata.engine.items()):
        if not any(word in name for word in _SCENE_KEYS):
            yield f"engine:{name}", value


def _diagnose(
    policy: str,
    plan: Sequence[PlannedTrial],
    readings: Mapping[str, Reading],
    missing: Mapping[str, str | None],
    versions: dict[str, str],
    *,
    pending: Sequence[str] = (),
) -> RunDiagnosis:
    """Return the diagnosis of a run from the readings of its records: second pass, metrics, findings, notes."""
    choices: dict[str, dict[str, Choice]] = {}
    for planned in plan:
        reading = readings.get(planned.key)
        if reading is not None and reading.choice is not None:
            choices.setdefault(planned.task, {})[planned.key] = reading.choice
    rules = judge_policy(choices)
    trials = tuple(
        _settled(planned, readings[planned.key], rules)
        if planned.key in readings
        else _without_record(planned, policy, missing.get(planned.key))
        for planned in plan
    )
    pairs = len(twins(trials))
    return RunDiagnosis(
        policy=policy,
        trials=trials,
        metrics=compute_metrics(trials),
        findings=find_findings(trials, rules),
        notes=find_notes(trials, rules, sorted(missing), pairs, pending=len(pending)),
        thresholds={**THRESHOLDS.to_json(), **LIMITS.to_json()},
        versions=versions,
        pending=tuple(pending),
    )


def _settled(planned: PlannedTrial, reading: Reading, rules: Mapping[str, TaskRules]) -> TrialDiagnosis:
    found = rules.get(planned.task)
    ruling = None if found is None else found.rulings.get(planned.key)
    if ruling is None:
        return reading.diagnosis
    label, evidence = settled(reading, ruling)
    return replace(reading.diagnosis, label=label, evidence=evidence)


def _without_record(planned: PlannedTrial, policy: str, reason: str | None) -> TrialDiagnosis:
    setting = setup_of(planned.task, planned.name)
    return TrialDiagnosis(
        task=planned.task,
        variation=planned.variation,
        condition=setting.base,
        axis=setting.axis,
        seed=planned.seed,
        policy=policy,
        instruction=setting.condition.instruction.text,
        success=False,
        expected=setting.condition.expected.value,
        label=Label.POLICY_ERROR,
        first_attempt=None,
        first_slot=None,
        intended=None,
        intention_correct=None,
        progress=0.0,
        attempts=(),
        evidence=without_record(reason),
        collisions=None,
        steps=0,
        duration_s=0.0,
        record=None,
    )
