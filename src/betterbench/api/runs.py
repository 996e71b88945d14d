"""Evaluate a policy, and open, diagnose and compare runs."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

from betterbench.api.arguments import options_as_arguments
from betterbench.certification.refusal import require_certified
from betterbench.comparison import Comparison, load_sides
from betterbench.comparison import compare as compare_sides
from betterbench.comparison.across import is_across
from betterbench.diagnosis import RunDiagnosis, diagnose_run
from betterbench.errors import InvalidInputError
from betterbench.evaluation import Plan, Progress, make_plan
from betterbench.evaluation import evaluate as run_plan
from betterbench.evaluation.running.summary import require_a_trial
from betterbench.evaluation.trials.given_policy import GivenPolicy
from betterbench.evaluation.trials.shared_policy import POLICY_TIMEOUT_S
from betterbench.interface import Policy
from betterbench.jobs import OnCount
from betterbench.quoting import default_name
from betterbench.records import RunFolder

logger = logging.getLogger(__name__)


def evaluate(
    policy: str | Policy,
    *,
    tasks: str | Sequence[str] = (),
    variations: str | Sequence[str] = (),
    trials: int = 20,
    seed: int = 0,
    out: Path | str | None = None,
    action_space: str | None = None,
    observation: str = "default",
    quality: str = "standard",
    looks: str = "seen",
    until_decided: bool = False,
    workers: int | None = 1,
    policy_timeout_s: float = POLICY_TIMEOUT_S,
    certificate: Path | str | None = None,
    uncertified: bool = False,
    allow_changed_policy: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
) -> RunFolder:
    """Evaluate a policy, like ``better eval``, and return the run. The same call resumes an unfinished run.

    Every variation runs with the seeds ``seed … seed + trials - 1``. The training conditions together run the same
    number of trials, which include the counterfactual twins. Suites of LIBERO and CALVIN are evaluated by ``better
    eval``.

    Args:
        policy: Policy address ("expert", "openpi://gpu-box:8000?preset=openpi_libero", "python:my.py:MyPolicy";
            see ``better list policies``), or your own instance, which answers in this process.
        tasks: Tasks to run; default: all of better60.
        variations: Variations to run ("L1", "fast_food/T1"); default: all.
        trials: Trials per variation.
        seed: First seed.
        out: Run folder; ``runs/POLICY`` if not given.
        action_space: Action space of the policy; if not given, from its ``info``, or ee_delta for an address.
        observation: Observation preset.
        quality: Render preset.
        looks: Appearance of objects and rooms: "seen" (in demonstrations) or "unseen".
        until_decided: Whether to stop a variation as soon as its verdict is certain; ``trials`` is then the maximum.
        workers: Number of worker processes, for an address; None for one per CPU core. A script with more than one
            worker needs ``if __name__ == "__main__":``, because each worker imports it again.
        policy_timeout_s: Deadline for an answer from a policy that does not run on a server [s].
        certificate: Certificate written by ``better certify``, or its folder; default: the packaged certificate.
        uncertified: Whether to run trials without a certificate as well.
        allow_changed_policy: Whether to resume even if the policy's declarations have changed since the run began.
        on_progress: Called at the start and after every trial.

    Raises:
        InvalidInputError: If an argument is out of range, or a trial is not certified.
        UnknownNameError: If a name is unknown; the message lists the closest ones.
        PolicyError: If no trial could be run to its end, or the policy cannot be reached.
        RunConflictError: If the folder contains another run, or another process writes to it.
    """
    given = None if isinstance(policy, str) else GivenPolicy(policy)
    if given is not None and workers != 1:
        cure = "Give one worker, or the address of its class: python:FILE.py:CLASS"
        raise InvalidInputError("workers", "a policy instance can only be used in this process", cure)
    with options_as_arguments():
        plan = make_plan(
            policy if isinstance(policy, str) else policy.info.name,
            tasks=_names(tasks),
            variations=_names(variations),
            trials=trials,
            seed=seed,
            action_space=action_space or (given.info.action_space if given else None),
            observation=observation,
            quality=quality,
            looks=looks,
            until_decided=until_decided,
        )
        if not uncertified:
            _require_certified(plan, None if certificate is None else Path(certificate))
        run = run_plan(
            plan,
            Path("runs") / default_name(plan.policy, otherwise="policy") if out is None else Path(out),
            workers=workers,
            policy_timeout_s=policy_timeout_s,
            allow_changed_policy=allow_changed_policy,
            policies=given,
            on_progress=on_progress,
        )
    require_a_trial(run)
    return run


def load_run(path: Path | str) -> RunFolder:
    """Open an existing run for reading, from Python or from the command line.

    Raises:
        RecordError: If the folder contains no run, or the run is damaged or of another version.
    """
    return RunFolder.open(Path(path))


def diagnose(
    run: RunFolder | Path | str,
    *,
    twins: RunFolder | Path | str | None = None,
    allow_mixed: bool = False,
    on_progress: OnCount | None = None,
) -> RunDiagnosis:
    """Diagnose every trial of a run from its records, without writing any files.

    Args:
        run: The run, or its folder. An unfinished run can be diagnosed too.
        twins: Run of the base suite by the same policy, for a run in LIBERO-PRO; its trials are the twins.
        allow_mixed: Whether to diagnose records with different versions, engines or policies together.
        on_progress: Called with the number of processed trials and the number of planned trials.

    Raises:
        RecordError: If the run or a record cannot be read.
        RunConflictError: If versions, engines or policies are mixed and that is not allowed.
    """
    return diagnose_run(
        _opened(run),
        allow_mixed=allow_mixed,
        twins_in=None if twins is None else _opened(twins),
        on_progress=on_progress,
    )


def compare(
    *runs: RunFolder | Path | str,
    names: Sequence[str] = (),
    alpha: float = 0.05,
    sequential: bool = False,
    allow_mixed: bool = False,
) -> Comparison:
    """Compare policies pairwise, on the trials that their runs share.

    Args:
        *runs: Two or more runs, their folders, or files of ``better export``.
        names: Run names, in the same order; by default the policy names.
        alpha: Level of the tests; intervals have confidence 1 - alpha.
        sequential: Whether to add tests that remain valid no matter how often you look at unfinished runs.
        allow_mixed: Whether to compare runs even if their versions or engines differ.

    Raises:
        InvalidInputError: If an argument is out of range, the runs have no common trials, or the runs belong to
            different suites.
        RecordError: If a run or a record cannot be read.
        RunConflictError: If versions or engines differ and that is not allowed.
    """
    paths = [run.path if isinstance(run, RunFolder) else Path(run) for run in runs]
    folders = [RunFolder.open(path) for path in paths if path.is_dir()]
    if len(folders) == len(paths) and is_across(folders):
        cure = "Give the runs to `better compare`, or to world_table and gaps_of of betterbench.comparison.across"
        raise InvalidInputError("runs", "these runs belong to several suites or to CALVIN", cure)
    with options_as_arguments():
        sides = load_sides(paths, names=names, allow_mixed=allow_mixed)
        return compare_sides(sides, alpha=alpha, sequential=sequential, allow_mixed=allow_mixed)


def _opened(run: RunFolder | Path | str) -> RunFolder:
    return run if isinstance(run, RunFolder) else load_run(run)


def _names(given: str | Sequence[str]) -> Sequence[str]:
    return (given,) if isinstance(given, str) else given


def _require_certified(plan: Plan, certificate: Path | None) -> None:
    remark = require_certified(plan, certificate)
    if remark:
        logger.warning("%s", remark)
