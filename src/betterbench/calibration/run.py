"""Running a calibration: one run per policy, each resumable, and what they give together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from betterbench.calibration.policies import CalibrationPolicy
from betterbench.calibration.truth import true_label
from betterbench.diagnosis import Calibration, Judged, RunDiagnosis, diagnose_run
from betterbench.evaluation import Plan, Progress, evaluate, make_plan
from betterbench.recording import RunFolder
from betterbench.tasks import TrialId


@dataclass(frozen=True, slots=True)
class CalibrationProgress:
    """How far a calibration is."""

    done: int
    planned: int
    policy: str


def plan_of(entry: CalibrationPolicy, tasks: Sequence[str]) -> Plan:
    """Return the plan of one policy of a calibration."""
    return make_plan(str(entry.address), tasks=tasks, trials=entry.trials, seed=entry.seed, observation="state_only")


def calibrate(
    planned: Sequence[CalibrationPolicy],
    out: Path,
    *,
    tasks: Sequence[str] = (),
    workers: int = 1,
    on_progress: Callable[[CalibrationProgress], None] | None = None,
) -> Calibration:
    """Run the policies, diagnose them from their records, and compare the labels with the true ones.

    Raises:
        RunConflictError: If a folder holds another run.
        InvalidInputError: If a number is out of range.
        RecordError: If a record cannot be read.
    """
    plans = [plan_of(entry, tasks) for entry in planned]
    total = sum(len(plan.trials) for plan in plans)
    before = 0
    runs: list[RunFolder] = []
    for entry, plan in zip(planned, plans, strict=True):

        def told(progress: Progress, entry: CalibrationPolicy = entry, offset: int = before) -> None:
            if on_progress is not None:
                on_progress(CalibrationProgress(offset + progress.done, total, str(entry.address)))

        runs.append(evaluate(plan, out / entry.folder, workers=workers, on_progress=told))
        before += len(plan.trials)
    return assess(runs)


def assess(runs: Sequence[RunFolder]) -> Calibration:
    """Return the calibration that finished runs give, from their records and journals."""
    trials: list[Judged] = []
    versions: dict[str, str] = {}
    for run in runs:
        diagnosis = diagnose_run(run)
        versions |= {k: v for k, v in diagnosis.versions.items() if not k.startswith("policy")}
        trials += _judged(run, diagnosis)
    return Calibration.of(trials, versions=versions)


def _judged(run: RunFolder, diagnosis: RunDiagnosis) -> Iterator[Judged]:
    entries = (e for e in run.entries() if e.status == "done")
    ground_truth = {TrialId(e.task, e.variation or e.condition, e.seed): e.ground_truth for e in entries}
    for trial in diagnosis.trials:
        said = ground_truth.get(trial.trial_id)
        if said is None:
            continue  # it broke down outside the policy; evaluate has said so, and runs it again
        truth = true_label(said, expected=trial.expected, success=trial.success)
        why = trial.evidence
        yield Judged(diagnosis.policy, trial.key, truth, trial.label, said.get("fault", ""), why.rule, why.text)
