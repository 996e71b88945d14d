"""Execution of a plan by workers, with a journal of finished trials so that the run can be resumed."""

from __future__ import annotations

import itertools
import logging
import os
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from multiprocessing import current_process
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.evaluation.planning.manifest import run_context, same_policy
from betterbench.evaluation.planning.plan import Plan
from betterbench.evaluation.planning.repeat import require_same_policy
from betterbench.evaluation.planning.schedule import Schedule
from betterbench.evaluation.ray_engine.cluster import ANYWHERE, Cluster, require_ray
from betterbench.evaluation.running.failing_start import FailingStart
from betterbench.evaluation.running.lost import reopen_lost
from betterbench.evaluation.serving.host import Host
from betterbench.evaluation.trials.given_policy import needs_in_run
from betterbench.evaluation.trials.shared_policy import POLICY_TIMEOUT_S
from betterbench.evaluation.trials.trial import WorkerSettings
from betterbench.evaluation.workers.pool import WorkerPool
from betterbench.evaluation.workers.step_count import StepCount, StepReport
from betterbench.evaluation.workers.worker import MAX_ENVS, USUAL_ENVS, Worker, envs_between, even_share, usual_envs
from betterbench.interface import PolicyInfo
from betterbench.jobs.durable import on_disk
from betterbench.policies.description import describe_policy
from betterbench.policies.factory import PolicyFactory
from betterbench.policies.kinds import PolicyNeeds, needs_of
from betterbench.records import Journal, JournalEntry, RunFolder
from betterbench.sim.graphics import require_drawing
from betterbench.statistics import Decisions
from betterbench.tasks.trial import Trial

if TYPE_CHECKING:
    from betterbench.evaluation.ray_engine.session import RaySession

logger = logging.getLogger(__name__)

Engine = Literal["local", "ray"]
"""Kind of workers that run the trials: processes on this machine, or actors on a Ray cluster."""

MAX_WORKERS = 256

MAX_PASSES = 3
"""Maximum number of passes over the trials. A second pass is needed only if records disappear during the run."""

_TURN_S = 1.0


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a run.

    Attributes:
        done: Number of finished trials.
        planned: Number of trials in the plan. With ``--until-decided``, the run may need fewer trials.
        elapsed_s: Time since this process started to run trials [s].
        started_with: Number of trials that were already finished when this process started.
        last: Journal entry of the trial that ended last, or None.
        decisions: Verdicts on the variations after the last round of a run with ``--until-decided``, or None.
    """

    done: int
    planned: int
    elapsed_s: float
    started_with: int
    last: JournalEntry | None
    decisions: Decisions | None = None


def evaluate(
    plan: Plan,
    out: Path,
    *,
    workers: int | None = 1,
    envs: int | None = None,
    engine: Engine = "local",
    cluster: Cluster = ANYWHERE,
    policy_timeout_s: float = POLICY_TIMEOUT_S,
    allow_changed_policy: bool = False,
    repeats: Path | None = None,
    policies: PolicyFactory | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    on_steps: Callable[[int], None] | None = None,
) -> RunFolder:
    """Run all unfinished trials of a plan, and return the run folder.

    If the plan has ``until_decided``, only the trials that are needed for the verdicts are run. Finished trials whose
    record is missing or damaged are run again. The conventions of the policy are checked before anything is written.
    Results do not depend on the engine or on the number of workers and environments.

    Args:
        plan: Plan of the run. An unfinished run with the same plan is resumed.
        out: Run folder.
        workers: Number of worker processes. If 1, the trials run in this process, but a user's policy always runs in a
            separate process. If None, there is one worker per CPU core of this machine or cluster, or a single worker
            if each worker would have to load large weights of the policy.
        envs: Number of environments per worker. If None, policies that answer immediately get one environment. For
            other policies, a warm-up measures the durations of policy calls and simulation, and chooses the number
            within the limits of the free memory.
        engine: "local" for processes on this machine, or "ray" for actors on a Ray cluster.
        cluster: Ray cluster to use.
        policy_timeout_s: Maximum time for one answer of a policy that runs in a worker process [s]. If the answer takes
            longer, the trial ends with a policy error.
        allow_changed_policy: Whether a run may be resumed even if the description of the policy has changed since the
            run began.
        repeats: Earlier run that this run repeats, or None. Unless ``allow_changed_policy`` is True, the earlier run
            must have the same policy.
        policies: Factory for a policy object that has no address. It requires a single worker. If None, the policy
            address in the plan is used.
        on_progress: Function that is called once at the start and after every trial.
        on_steps: Function that is called about twice a second with the number of control steps that were executed since
            this process started.

    Raises:
        RunConflictError: If the folder contains a different run, if another process writes to it, or if the policy has
            changed.
        PremiseError: If a scene violates an assumption of its instruction.
        InvalidInputError: If a number is out of range, or if the policy uses a different action space than the run.
        UnknownNameError: If no policy has this address.
        PolicyUnavailableError: If the policy's server cannot be reached.
        HandshakeError: If the policy's server declares different conventions.
        StorageError: If the disk is full.
        WorkerError: If worker processes keep dying.
    """
    _check_numbers(workers, envs, engine, policy_timeout_s)
    if engine == "ray":
        require_ray(cluster)
    began, steps, needs = time.perf_counter(), StepCount(on_steps), needs_in_run(plan.policy)
    with ExitStack() as stack:
        processors = min(os.cpu_count() or 1, MAX_WORKERS)
        alone = engine == "local" and (workers or processors) == 1
        asked = _ask_policy(plan, stack, policies, alone=alone, engine=engine, timeout_s=policy_timeout_s)
        _check_policy(plan, asked.info, engine)
        if workers is None and asked.one_worker:
            workers = 1
        session = stack.enter_context(_ray_session(cluster, workers)) if engine == "ray" else None
        count = session.workers if session else workers or processors
        settings = WorkerSettings.of(plan, out, policy_timeout_s=policy_timeout_s)
        settings = _with_policy(settings, asked, needs, workers=count, envs=envs)
        declared = describe_policy(plan.policy, asked.info)
        if repeats is not None and not allow_changed_policy:
            require_same_policy(repeats, declared)
        with on_disk(out):
            context = run_context(plan, policy=declared, engine=_engine_form(engine, settings))
            run = RunFolder.start(out, plan.to_json(), context=context)
            run = same_policy(run, declared, allow_changed=allow_changed_policy)
            journal = stack.enter_context(run.journal(renews=True))
            reopen_lost(run, journal)
        settings = replace(settings, trials=sum(not journal.is_done(t.id) for t in plan.trials))
        for left in reversed(range(MAX_PASSES)):
            schedule = Schedule(plan, is_done=journal.is_done, succeeded=lambda t: run.succeeded(t, journal.entry(t)))
            found = _entries(run, settings, schedule, asked=asked, session=session, steps=steps)
            with closing(found) as entries:
                _record(schedule, journal, out, entries, needs=needs, began=began, on_progress=on_progress)
            if not (_restored(run, journal, needs) and left):
                break
    return run


def _check_policy(plan: Plan, info: PolicyInfo, engine: str) -> None:
    """Log the assumptions made about a policy, and check that this machine can render images if the policy needs them.

    Without this check, every trial would fail for the same reason.
    """
    if "assumed" in info.metadata:
        logger.warning("%s", info.metadata["assumed"])
    if engine == "local" and not plan.world.drawn_by and info.needs_images and plan.observation != "state_only":
        require_drawing()


def _restored(run: RunFolder, journal: Journal, needs: PolicyNeeds) -> bool:
    """Restore files of the run that were removed.

    Return whether trials must be repeated because their records are lost.
    """
    with on_disk(run.path):
        changed = [run.restore(), journal.restore()]
        return (any(changed) or needs.process) and reopen_lost(run, journal) > 0


def _record(
    schedule: Schedule,
    journal: Journal,
    out: Path,
    entries: Iterable[JournalEntry],
    *,
    needs: PolicyNeeds,
    began: float,
    on_progress: Callable[[Progress], None] | None,
) -> None:
    """Append journal entries as they arrive, and report the progress."""
    plan = schedule.plan
    planned = len(plan.trials)
    done = started_with = sum(journal.is_done(t.id) for t in plan.trials)
    if on_progress is not None:
        on_progress(Progress(done, planned, 0.0, started_with, None, schedule.decisions))
    failing = FailingStart(plan.policy) if needs.thread and not started_with else None
    for entry in entries:
        with on_disk(out):
            journal.append(entry)
        done += entry.status == "done"
        if failing is not None:
            failing.add(entry)
        if entry.status == "error":
            logger.error("%s/%s seed %d: %s", entry.task, entry.condition, entry.seed, entry.message)
        else:
            logger.info("%s: %d of %d trials done", entry.key, done, planned)
        if on_progress is not None:
            elapsed_s = time.perf_counter() - began
            on_progress(Progress(done, planned, elapsed_s, started_with, entry, schedule.decisions))


@dataclass(frozen=True, slots=True)
class _Asked:
    """Facts about the policy that are determined before the run starts."""

    info: PolicyInfo
    envs: int  # default number of environments per worker
    policies: PolicyFactory | None = None  # factory, perhaps with an instance; None if a host serves it
    host: Host | None = None  # process that serves the policy to all workers
    shared: bool = False  # whether one instance serves several workers
    one_worker: bool = False  # whether each additional worker would load the weights again


def _ask_policy(
    plan: Plan, stack: ExitStack, given: PolicyFactory | None, *, alone: bool, engine: Engine, timeout_s: float
) -> _Asked:
    """Create the policy or connect to it, and compare the conventions of policy and run.

    When ``stack`` is closed, the resources of the policy are released.
    """
    if given is not None:
        return _Asked(given.check(plan.action_space, plan.observation, rate_hz=plan.world.control_rate_hz), 1, given)
    address, world, rate_hz = plan.policy, plan.world.dialect, plan.world.control_rate_hz
    needs = needs_of(address)
    if alone or needs.server or not needs.thread:
        policies = PolicyFactory(address, apart=True, timeout_s=timeout_s, world=world)
        stack.callback(policies.close)
        info = policies.check(plan.action_space, plan.observation, rate_hz=rate_hz)
        return _Asked(info, usual_envs(policies), policies)
    with ExitStack() as own:
        # A user's policy may have large weights. It is created in a separate process, which ends before the workers
        # load the weights, so that this process never contains them.
        run = (plan.action_space, plan.observation)
        host = own.enter_context(Host(address, run=run, timeout_s=timeout_s, world=world, rate_hz=rate_hz))
        info, envs = host.info, USUAL_ENVS if host.takes_batches else 1
        if not (info.heavy or host.takes_batches):
            return _Asked(info, envs, PolicyFactory(address, apart=True, timeout_s=timeout_s, world=world))
        one_worker = not host.takes_batches
        if engine == "ray":
            return _Asked(info, envs, PolicyFactory(address, world=world), shared=True, one_worker=one_worker)
        stack.enter_context(own.pop_all())
        return _Asked(info, envs, host=host, shared=True, one_worker=one_worker)


def _with_policy(
    settings: WorkerSettings, asked: _Asked, needs: PolicyNeeds, *, workers: int, envs: int | None
) -> WorkerSettings:
    """Return a copy of the settings, completed with facts about the policy and with the number of environments."""
    first, most = (envs, envs) if envs else envs_between(asked.envs, workers, world=settings.world)
    return replace(
        settings,
        envs=first,
        most_envs=most,
        workers=workers,
        served_at=asked.host.address if asked.host else None,
        known=asked.info if needs.server else None,
    )


def _engine_form(engine: Engine, settings: WorkerSettings) -> dict[str, str | int]:
    """Return the description of the execution engine, in the form that is stored in ``run.json``."""
    form: dict[str, str | int] = {"name": engine, "workers": settings.workers, "envs": settings.envs}
    if settings.most_envs > settings.envs:
        form["most_envs"] = settings.most_envs  # the warm-up chooses the number, which is stored in the journal
    return form


def _check_numbers(workers: int | None, envs: int | None, engine: str, policy_timeout_s: float) -> None:
    if workers is not None and not 1 <= workers <= MAX_WORKERS:
        raise InvalidInputError("--workers", f"{workers} is out of range", f"Use a number from 1 to {MAX_WORKERS}")
    if workers != 1 and current_process().daemon:
        problem = "this process is a worker of a multiprocessing.Pool, which cannot start processes"
        raise InvalidInputError("--workers", problem, "Use one worker, or a concurrent.futures.ProcessPoolExecutor")
    if envs is not None and not 1 <= envs <= MAX_ENVS:
        raise InvalidInputError("--envs", f"{envs} is out of range", f"Use a number from 1 to {MAX_ENVS}")
    if not 0.0 < policy_timeout_s < float("inf"):
        raise InvalidInputError(
            "--policy-timeout", f"{policy_timeout_s:g} s is out of range", "Use a number greater than 0"
        )
    if engine not in get_args(Engine):
        raise UnknownNameError("engine", engine, get_args(Engine))


def _ray_session(cluster: Cluster, workers: int | None) -> RaySession:
    # This is imported here because Ray is an optional dependency.
    from betterbench.evaluation.ray_engine.session import RaySession  # noqa: PLC0415

    return RaySession(cluster, workers)


def _entries(
    run: RunFolder,
    settings: WorkerSettings,
    schedule: Schedule,
    *,
    asked: _Asked,
    session: RaySession | None,
    steps: StepCount,
) -> Generator[JournalEntry, None, None]:
    """Run the trials of the schedule, and yield the journal entry of each trial when it ends."""
    workers = settings.workers
    last = 2 * workers * max(settings.envs, settings.most_envs)  # at least two per environment
    later = (settings.world.in_order(trials, last=last) for trials in schedule.rounds())
    first = next(later, [])
    if not first:
        return
    rounds = itertools.chain([first], later)
    alone = workers == 1 or (len(first) == 1 and schedule.decisions is None)
    if session is None and asked.policies is not None and alone:
        with Worker(settings, policies=asked.policies, on_step=StepReport(steps.add)) as worker:
            for trials in rounds:
                yield from _in_this_process(worker, trials)
        return
    if asked.policies is not None:
        asked.policies.close()  # each worker creates its own policy
    if session is not None:
        from betterbench.evaluation.ray_engine.pool import ray_entries  # noqa: PLC0415 - as above

        yield from ray_entries(session, run, settings, rounds, served=asked.shared, steps=steps)
        return
    with WorkerPool(settings, workers, watch=asked.host.watch if asked.host else None, steps=steps) as pool:
        yield from pool.entries(rounds)


def _in_this_process(worker: Worker, trials: list[Trial]) -> Iterator[JournalEntry]:
    waiting, running = deque(trials), 0
    while True:
        while worker.free and running < even_share(len(waiting) + running, 1, worker.envs) and waiting:
            worker.start(waiting.popleft())
            running += 1
        if not running:
            if worker.problem is not None:
                raise worker.problem  # it was raised by the last trial
            return
        for entry in worker.finished(_TURN_S):
            running -= 1
            yield entry
