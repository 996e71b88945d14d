"""Execution of a calibration: evaluation of all policies, and comparison of the diagnosis with the ground truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from betterbench.calibration.policies import CalibrationPolicy
from betterbench.calibration.truth import true_label
from betterbench.diagnosis import Calibration, Judged, RunDiagnosis, diagnose_run
from betterbench.evaluation import Plan, Progress, evaluate, make_plan
from betterbench.records import RunFolder
from betterbench.tasks import TrialId


@dataclass(frozen=True, slots=True)
class CalibrationProgress:
    """Progress of a calibration: number of finished trials, total number of trials, and the current policy."""

    done: int
    planned: int
    policy: str


def plan_of(entry: CalibrationPolicy, tasks: Sequence[str]) -> Plan:
    """Return the plan for the run of one policy in a calibration."""
    return make_plan(str(entry.address), tasks=tasks, trials=entry.trials, seed=entry.seed, observation="state_only")


def calibrate(
    planned: Sequence[CalibrationPolicy],
    out: Path,
    *,
    tasks: Sequence[str] = (),
    workers: int = 1,
    on_progress: Callable[[CalibrationProgress], None] | None = None,
) -> Calibration:
    """Run the policies, diagnose their records, and compare the labels of the diagnosis with the true labels.

    The same call resumes an interrupted calibration.

    Raises:
        RunConflictError: If a folder contains a different run.
        InvalidInputError: If a number is out of range.
        RecordError: If a record cannot be read.
    """
    plans = {entry.folder: plan_of(entry, tasks) for entry in planned}
    return assess(run_plans(plans, out, workers=workers, on_progress=on_progress))


def run_plans(
    plans: Mapping[str, Plan],
    out: Path,
    *,
    workers: int = 1,
    on_progress: Callable[[CalibrationProgress], None] | None = None,
) -> tuple[RunFolder, ...]:
    """Run several plans, each in the folder inside ``out`` that has the key of the plan as its name.

    The same call resumes interrupted runs.

    Raises:
        RunConflictError: If a folder contains a different run.
    """
    total = sum(len(plan.trials) for plan in plans.values())
    before = 0
    runs: list[RunFolder] = []
    for folder, plan in plans.items():

        def told(progress: Progress, policy: str = plan.policy, offset: int = before) -> None:
            if on_progress is not None:
                on_progress(CalibrationProgress(offset + progress.done, total, policy))

        runs.append(evaluate(plan, out / folder, workers=workers, on_progress=told))
        before += len(plan.trials)
    return tuple(runs)


def assess(runs: Sequence[RunFolder]) -> Calibration:
    """Compute the accuracy of the diagnosis from the records and journals of finished runs."""
    trials: list[Judged] = []
    versions: dict[str, str] = {}
    left_out = 0
    for run in runs:
        diagnosis = diagnose_run(run)
        versions |= {k: v for k, v in diagnosis.versions.items() if not k.startswith("policy")}
        said = _said(run)
        left_out += sum(bool(truth.get("left_out")) for truth in said.values())
        trials += _judged(diagnosis, said)
    return Calibration.of(trials, versions=versions, left_out=left_out)


def _said(run: RunFolder) -> dict[TrialId, Mapping[str, str]]:
    """Return the ground truth that the faulty policy reported for each finished episode."""
    done = (e for e in run.entries() if e.status == "done")
    return {TrialId(e.task, e.variation or e.condition, e.seed): e.ground_truth for e in done}


def _judged(diagnosis: RunDiagnosis, said: Mapping[TrialId, Mapping[str, str]]) -> Iterator[Judged]:
    for trial in diagnosis.trials:
        truth = said.get(trial.trial_id)
        # A trial that ended with an error outside the policy has no ground truth. The run reports such trials, and
        # repeats them when it is resumed.
        if truth is None or truth.get("left_out"):
            continue
        why = trial.evidence
        yield Judged(
            diagnosis.policy,
            trial.key,
            true_label(truth, expected=trial.expected, success=trial.success),
            trial.label,
            truth.get("fault", ""),
            why.rule,
            why.text,
            grasped=any(a.object is not None or a.slot is not None for a in trial.attempts),
            honest=truth.get("stated") == "honest" or diagnosis.policy == "expert",
            debatable=truth.get("debatable", ""),
        )
