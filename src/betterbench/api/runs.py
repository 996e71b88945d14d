"""Functions that evaluate a policy, and open, diagnose and compare runs."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

from betterbench.api.arguments import options_as_arguments
from betterbench.argument_types import checked_arguments
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


@checked_arguments
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

    Each variation is run with the seeds ``seed … seed + trials - 1``. The training conditions of a task together get
    as many trials as its variations. They include the counterfactual twins, which are training trials with the seeds
    of the variations. To evaluate a policy in LIBERO or CALVIN, use the command ``better eval``.

    Args:
        policy: Policy address, such as "expert", "openpi://gpu-box:8000?preset=openpi_libero" or
            "python:my.py:MyPolicy" (see ``better list policies``), or a policy object, which runs in this process.
        tasks: Tasks to run. By default, all tasks of the suite better60.
        variations: Variations to run, such as "L1" or "fast_food/T1". By default, all variations of the tasks.
        trials: Number of trials per variation.
        seed: First seed.
        out: Run folder. By default, ``runs/POLICY``, where POLICY is the name of the policy.
        action_space: Action space of the policy. By default, the action space in the ``info`` of a policy object, and
            ee_delta for a policy address.
        observation: Name of an observation preset.
        quality: Name of a rendering preset.
        looks: Appearance of objects and rooms: "seen" (as in the demonstrations) or "unseen".
        until_decided: Whether to stop running a variation as soon as its verdict is certain. ``trials`` is then the
            maximum number of trials.
        workers: Number of worker processes. It must be 1 if ``policy`` is an object. None starts one worker per CPU
            core. A script that uses several workers must be protected by ``if __name__ == "__main__":``, because each
            worker imports the script.
        policy_timeout_s: Maximum time for a reply of a policy that does not run on a server [s].
        certificate: Certificate written by ``better certify``, or its folder. By default, the packaged certificate.
        uncertified: Whether to run trials that are not certified.
        allow_changed_policy: Whether to resume a run even if the description of the policy has changed.
        on_progress: Function that is called at the start and after each trial.

    Raises:
        InvalidInputError: If an argument is out of range, or a trial is not certified.
        UnknownNameError: If a name is unknown. The message suggests similar names.
        PolicyError: If no trial could be completed, or the policy cannot be reached.
        RunConflictError: If the folder contains a different run, or another process is writing to the folder.
    """
    given = None if isinstance(policy, str) else GivenPolicy(policy)
    if given is not None and workers != 1:
        cure = "Use one worker, or give the address of the policy's class: python:FILE.py:CLASS"
        raise InvalidInputError("workers", "a policy instance can only be used in this process", cure)
    with options_as_arguments():
        plan = make_plan(
            policy if isinstance(policy, str) else policy.info.name,
            tasks=tasks,
            variations=variations,
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


@checked_arguments
def load_run(path: Path | str) -> RunFolder:
    """Open an existing run for reading.

    Raises:
        RecordError: If the folder contains no run, or if the run is damaged or has an unsupported version.
    """
    return RunFolder.open(Path(path))


@checked_arguments
def diagnose(
    run: RunFolder | Path | str,
    *,
    twins: RunFolder | Path | str | None = None,
    allow_mixed: bool = False,
    on_progress: OnCount | None = None,
) -> RunDiagnosis:
    """Diagnose the trials of a run from their records, without writing files.

    Args:
        run: Run, or its folder. The run may be unfinished.
        twins: For a run in LIBERO-PRO, a run of the same policy in the original suite. The trials of the two runs are
            compared in pairs.
        allow_mixed: Whether the records may have different versions, engines or policies.
        on_progress: Function that is called with the number of diagnosed trials and the total number of trials.

    Raises:
        RecordError: If the run or a record cannot be read.
        RunConflictError: If the records have different versions, engines or policies and ``allow_mixed`` is False.
    """
    return diagnose_run(
        _opened(run),
        allow_mixed=allow_mixed,
        twins_in=None if twins is None else _opened(twins),
        on_progress=on_progress,
    )


@checked_arguments
def compare(
    *runs: RunFolder | Path | str,
    names: Sequence[str] = (),
    alpha: float = 0.05,
    sequential: bool = False,
    allow_mixed: bool = False,
) -> Comparison:
    """Compare each pair of policies on the trials that both runs contain.

    Args:
        *runs: Two or more runs, folders of runs, or files written by ``better export``.
        names: Names of the runs, in the same order. By default, the names of the policies.
        alpha: Significance level of the tests. The confidence level of the intervals is 1 - alpha.
        sequential: Whether to add sequential tests, which remain valid if they are repeated while more trials are run.
        allow_mixed: Whether the runs may have different versions or engines.

    Raises:
        InvalidInputError: If an argument is out of range, if the runs have no trials in common, or if they belong to
            different suites.
        RecordError: If a run or a record cannot be read.
        RunConflictError: If versions or engines differ and ``allow_mixed`` is False.
    """
    paths = [run.path if isinstance(run, RunFolder) else Path(run) for run in runs]
    folders = [RunFolder.open(path) for path in paths if path.is_dir()]
    if len(folders) == len(paths) and is_across(folders):
        cure = "Pass the runs to `better compare`, or to world_table and gaps_of of betterbench.comparison.across"
        raise InvalidInputError("runs", "these runs belong to several suites or to CALVIN", cure)
    with options_as_arguments():
        sides = load_sides(paths, names=names, allow_mixed=allow_mixed)
        return compare_sides(sides, alpha=alpha, sequential=sequential, allow_mixed=allow_mixed)


def _opened(run: RunFolder | Path | str) -> RunFolder:
    return run if isinstance(run, RunFolder) else load_run(run)


def _require_certified(plan: Plan, certificate: Path | None) -> None:
    remark = require_certified(plan, certificate)
    if remark:
        logger.warning("%s", remark)
