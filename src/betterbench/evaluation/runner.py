"""Running a plan: worker processes, one journal, and a folder from which the same command goes on."""

from __future__ import annotations

import logging
import multiprocessing
import os
import platform
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

from betterbench.errors import InvalidInputError
from betterbench.evaluation.agents import check_policy
from betterbench.evaluation.plan import Plan, Trial
from betterbench.evaluation.trial import Setting, run_trial
from betterbench.recording import JournalEntry, RunFolder, TrialKey

logger = logging.getLogger(__name__)

MAX_RESTARTS = 5
"""How often a broken pool of workers is replaced before the run gives up."""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is.

    Attributes:
        done: Trials in the journal.
        planned: Trials in the plan.
        elapsed_s: Time since this process began [s].
        started_with: Trials that were in the journal when this process began.
        last: The trial that has just ended, or None.
    """

    done: int
    planned: int
    elapsed_s: float
    started_with: int
    last: JournalEntry | None


def evaluate(
    plan: Plan, out: Path, *, workers: int = 1, on_progress: Callable[[Progress], None] | None = None
) -> RunFolder:
    """Run every trial of a plan that is not in the journal yet.

    Args:
        plan: The plan.
        out: Folder of the run; an unfinished run with the same plan is continued.
        workers: Worker processes; with 1 the trials run in this process.
        on_progress: Told after every trial.

    Returns:
        The folder of the run.

    Raises:
        RunConflictError: If the folder holds another run or another process writes to it.
        PremiseError: If a scene does not show what its instruction presupposes.
        InvalidInputError: If the number of workers is out of range, or the policy answers in another action space.
        UnknownNameError: If there is no such policy.
    """
    if not 1 <= workers <= 256:
        raise InvalidInputError("--workers", f"{workers} is out of range", "Give a number from 1 to 256")
    check_policy(plan.policy, action_space=plan.action_space)
    run = RunFolder.start(out, plan.to_json(), context=_context())
    setting = Setting(str(out), plan.policy, plan.action_space, plan.observation, plan.quality, plan.robot)
    began = time.perf_counter()
    with run.journal() as journal:
        waiting = [t for t in plan.trials if not journal.is_done(TrialKey(t.task, t.condition, t.seed))]
        done = started_with = len(plan.trials) - len(waiting)
        if on_progress is not None:
            on_progress(Progress(done, len(plan.trials), 0.0, started_with, None))
        for entry in _entries(setting, _by_scene(waiting), workers):
            journal.append(entry)
            done += entry.status == "done"
            if entry.status == "error":
                logger.error("%s/%s seed %d: %s", entry.task, entry.condition, entry.seed, entry.message)
            if on_progress is not None:
                on_progress(Progress(done, len(plan.trials), time.perf_counter() - began, started_with, entry))
    return run


def _by_scene(trials: list[Trial]) -> list[Trial]:
    """Order trials so that those which share compiled scenes follow each other; results do not depend on it."""
    return sorted(trials, key=lambda t: (t.task, t.seed))


def _entries(setting: Setting, trials: list[Trial], workers: int) -> Iterator[JournalEntry]:
    if workers == 1 or len(trials) <= 1:
        for trial in trials:
            yield run_trial(setting, trial)
        return
    left = list(trials)
    for attempt in range(MAX_RESTARTS + 1):
        try:
            for trial, entry in _pooled(setting, left, workers):
                yield entry
                left.remove(trial)
        except BrokenProcessPool:
            logger.warning("a worker process died; %d trials are left and go to new workers", len(left))
            if attempt == MAX_RESTARTS:
                break
        else:
            return
    for trial in left:
        yield JournalEntry(
            trial.task,
            trial.condition,
            trial.variation,
            trial.seed,
            "error",
            f"worker processes died {MAX_RESTARTS + 1} times; run the same command again, with fewer --workers",
        )


def _pooled(setting: Setting, trials: list[Trial], workers: int) -> Iterator[tuple[Trial, JournalEntry]]:
    """Yield finished trials; never more than two per worker are handed out, so that little is lost."""
    waiting = iter(list(trials))
    pending: dict[Future[JournalEntry], Trial] = {}
    with ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare_worker
    ) as pool:
        try:
            while True:
                while len(pending) < 2 * workers and (trial := next(waiting, None)) is not None:
                    pending[pool.submit(run_trial, setting, trial)] = trial
                if not pending:
                    return
                finished, _ = wait(pending, return_when=FIRST_COMPLETED)
                for future in finished:
                    yield pending.pop(future), future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _prepare_worker() -> None:
    """Keep numerical libraries and the software renderer to one thread each: workers are the parallelism."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    os.environ.setdefault("LP_NUM_THREADS", "0")
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker when the run is killed; it would wait for work for ever, and write into a resumed run."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _context() -> dict[str, str]:
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processors": str(os.cpu_count()),
        "command": " ".join(sys.argv[:1] and [Path(sys.argv[0]).name, *sys.argv[1:]]),
        "started_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
