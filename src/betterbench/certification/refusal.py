"""Check that a certificate covers the trials of a run before the run starts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from betterbench.certification.coverage import Coverage, coverage_of, cure_for, load_coverage
from betterbench.errors import InvalidInputError
from betterbench.evaluation.planning.plan import Plan, plan_extent
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.sim.scenes import engine_version
from betterbench.tasks import SUITE_VERSION, Looks, TrialId, get_task, suite_tasks
from betterbench.tasks.demonstrated import demonstrated_if_measured
from betterbench.tasks.user_files import options_for

_NAMED = 5


def require_certified(plan: Plan, certificate: Path | None = None) -> str:
    """Check that a certificate covers every trial of a plan.

    Return a note about trials that are not certified or that the expert did not solve.

    If no path is given, the certificate of the suite is used, which is in the package or in the folder of the suite. If
    this certificate covers only objects and rooms with the appearance of the demonstrations ("seen"), a plan with
    "unseen" looks is still accepted, and the note says that its trials are not certified. The note is empty if all
    trials are certified and were solved by the expert.

    Raises:
        InvalidInputError: If a trial is not covered. The message names the first such trial and the remedy.
    """
    planned = [t.id for t in plan.trials]
    tasks = dict.fromkeys(t.task for t in planned)
    coverage = coverage_of(tasks) if certificate is None else load_coverage(certificate)
    if certificate is None and plan.robot == coverage.versions.robot and plan.looks != coverage.versions.looks:
        looks = coverage.versions.looks
        return f"These trials are not certified: the certificate of the suite covers the {looks} looks."
    seed, trials = plan_extent(plan)
    return require_coverage(
        coverage, planned, seed=seed, trials_per_variation=trials, looks=plan.looks, robot=plan.robot
    )


def require_coverage(
    coverage: Coverage,
    trials: Sequence[TrialId],
    *,
    seed: int,
    trials_per_variation: int,
    looks: Looks = "seen",
    robot: str = USUAL_ROBOT,
) -> str:
    """Check that a certificate covers all planned trials. Return a note about trials that the expert did not solve.

    The note is empty if the expert solved all trials. The message of an error suggests a command, which contains the
    ``seed`` and ``trials_per_variation`` of the run.

    Raises:
        InvalidInputError: If a trial is not covered. The message names the first such trial and the remedy.
    """
    versions = {task: get_task(task).version for task in dict.fromkeys(t.task for t in trials)}
    gap = coverage.gap(trials, suite=SUITE_VERSION, engine=engine_version(), tasks=versions, looks=looks, robot=robot)
    if gap is not None:
        whole = set(versions) == set(suite_tasks("better60"))
        own = [task for task in versions if options_for([task])]
        unmeasured = [t for t in own if demonstrated_if_measured(get_task(t), engine=engine_version()) is None]
        raise InvalidInputError(
            f"the plan: {gap.trial.task}/{gap.trial.condition} seed {gap.trial.seed}",
            f"it is not certified ({gap.reason})",
            cure_for(
                gap,
                tasks=() if whole else versions,
                first=seed,
                trials=trials_per_variation,
                looks=looks,
                robot=robot,
                unmeasured=unmeasured,
            ),
        )
    unsolved = coverage.unsolved(trials)
    if not unsolved:
        return ""
    named = ", ".join(f"{t.task}/{t.condition} seed {t.seed}" for t in unsolved[:_NAMED])
    more = f" and {len(unsolved) - _NAMED} more" if len(unsolved) > _NAMED else ""
    return f"The expert did not solve {len(unsolved)} of the planned trials: {named}{more}."
