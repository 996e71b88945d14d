"""Whether a certificate covers the trials of a run, and what to do if it does not."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.certification.coverage import Coverage, cure_for
from betterbench.errors import InvalidInputError
from betterbench.sim.scenes import engine_version
from betterbench.tasks import SUITE_VERSION, Looks, TrialId, get_task, suite_tasks
from betterbench.tasks.demonstrated import demonstrated_if_measured
from betterbench.tasks.user_files import options_for

_NAMED = 5


def require_coverage(
    coverage: Coverage, trials: Sequence[TrialId], *, seed: int, trials_per_variation: int, looks: Looks = "seen"
) -> str:
    """Check that a certificate covers every planned trial, and return a sentence about those the expert did not solve.

    The sentence is empty if it solved all. ``seed``, the first of the run, and ``trials_per_variation`` are for the
    cure.

    Raises:
        InvalidInputError: If a trial is not covered; the text names the first one and the cure.
    """
    versions = {task: get_task(task).version for task in dict.fromkeys(t.task for t in trials)}
    gap = coverage.gap(trials, suite=SUITE_VERSION, engine=engine_version(), tasks=versions, looks=looks)
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
                unmeasured=unmeasured,
            ),
        )
    unsolved = coverage.unsolved(trials)
    if not unsolved:
        return ""
    named = ", ".join(f"{t.task}/{t.condition} seed {t.seed}" for t in unsolved[:_NAMED])
    more = f" and {len(unsolved) - _NAMED} more" if len(unsolved) > _NAMED else ""
    return f"The expert did not solve {len(unsolved)} of the planned trials: {named}{more}."
