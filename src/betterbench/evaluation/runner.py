"""Running a plan: workers, one journal, and a folder from which the same command goes on."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.evaluation.agents import Minds, check_action_space, is_in_process_model, is_remote, needs_no_thread
from betterbench.evaluation.alarm import Alarm
from betterbench.evaluation.cluster import ANYWHERE, Cluster, require_ray
from betterbench.evaluation.crew import Crew
from betterbench.evaluation.host import Host
from betterbench.evaluation.manifest import describe_policy, run_context, same_policy
from betterbench.evaluation.plan import Plan, Trial
from betterbench.evaluation.trial import POLICY_TIMEOUT_S, Setting, on_disk
from betterbench.evaluation.worker import MAX_ENVS, MOST_WAITING, USUAL_ENVS, Worker, usual_envs
from betterbench.interface import PolicyInfo
from betterbench.recording import JournalEntry, RunFolder, TrialKey

logger = logging.getLogger(__name__)

Engine = Literal["local", "ray"]
"""What runs the workers: processes of this machine, or actors of a Ray cluster."""

MAX_WORKERS = 256

_TURN_S = 1.0


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
    plan: Plan,
    out: Path,
    *,
    workers: int | None = 1,
    envs: int | None = None,
    engine: Engine = "local",
    cluster: Cluster = ANYWHERE,
    policy_timeout_s: float = POLICY_TIMEOUT_S,
    allow_changed_policy: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
) -> RunFolder:
    """Run every trial of a plan that is not in the journal yet.

    The policy is asked for its conventions before anything is written. Results depend neither on the number of workers
    and environments nor on the engine.

    Args:
        plan: The plan.
        out: Folder of the run; an unfinished run with the same plan is continued.
        workers: Worker processes; with 1 the trials run in this process. None for one per processor of this machine,
            or of the cluster.
        envs: Environments that each worker keeps open at once, so that a policy's latency is hidden; None for 1 where
            the policy answers at once, and a few where it does not.
        engine: "local" for processes of this machine, "ray" for actors of a Ray cluster.
        cluster: Where the actors are placed.
        policy_timeout_s: Deadline of one answer of a policy that runs in a worker's process [s]. A call that hangs
            cannot be ended: its trial is, and its thread is left alone until the process ends.
        allow_changed_policy: True to resume with a policy that declares other things than when the run began.
        on_progress: Told after every trial.

    Returns:
        The folder of the run.

    Raises:
        RunConflictError: If the folder holds another run or another process writes to it, or the policy has changed.
        PremiseError: If a scene does not show what its instruction presupposes.
        InvalidInputError: If a number is out of range, or the policy answers in another action space.
        UnknownNameError: If there is no such policy.
        PolicyUnavailableError: If the policy's server cannot be reached.
        HandshakeError: If it declares other conventions.
        StorageError: If the disk is full.
        WorkerError: If worker processes keep dying.
    """
    if workers is None and engine == "local":
        workers = min(os.cpu_count() or 1, MAX_WORKERS)
    _check_numbers(workers, envs, engine, policy_timeout_s)
    if engine == "ray":
        require_ray(cluster)
    setting = Setting(
        str(out), plan.policy, plan.action_space, plan.observation, plan.quality, plan.robot, 1, policy_timeout_s
    )
    began = time.perf_counter()
    with ExitStack() as stack:
        hosted = workers not in (None, 1) and engine == "local"
        asked = _ask_policy(plan, stack, hosted=hosted, timeout_s=policy_timeout_s)
        usual = max(1, min(asked.envs, MOST_WAITING // (workers or MOST_WAITING)))
        setting = replace(setting, envs=envs or usual, served_at=asked.host.address if asked.host else None)
        declared = describe_policy(plan.policy, asked.info)
        with on_disk(out):
            context = run_context(
                plan, policy=declared, engine={"name": engine, "workers": workers, "envs": setting.envs}
            )
            run = RunFolder.start(out, plan.to_json(), context=context)
        run = same_policy(run, declared, allow_changed=allow_changed_policy)
        journal = stack.enter_context(run.journal())
        waiting = [t for t in plan.trials if not journal.is_done(TrialKey(t.task, t.condition, t.seed))]
        done = started_with = len(plan.trials) - len(waiting)
        if on_progress is not None:
            on_progress(Progress(done, len(plan.trials), 0.0, started_with, None))
        entries = _entries(run, setting, _by_scene(waiting), workers, engine=engine, cluster=cluster, asked=asked)
        stack.enter_context(closing(entries))
        alarm = None if needs_no_thread(plan.policy) or started_with else Alarm(plan.policy)
        for entry in entries:
            with on_disk(out):
                journal.append(entry)
            done += entry.status == "done"
            if alarm is not None:
                alarm.hear(entry)
            if entry.status == "error":
                logger.error("%s/%s seed %d: %s", entry.task, entry.condition, entry.seed, entry.message)
            if on_progress is not None:
                on_progress(Progress(done, len(plan.trials), time.perf_counter() - began, started_with, entry))
    return run


@dataclass(frozen=True, slots=True)
class _Asked:
    """What came of asking the policy before the run.

    Attributes:
        info: What it says about itself.
        envs: Environments per worker, unless told otherwise.
        minds: Makes it, and may hold what was made to be asked; None where a host holds it.
        host: The process that holds it for all workers, or None.
        serves_many: Whether one instance of it is to serve several workers.
    """

    info: PolicyInfo
    envs: int
    minds: Minds | None
    host: Host | None = None
    serves_many: bool = False


def _ask_policy(plan: Plan, stack: ExitStack, *, hosted: bool, timeout_s: float) -> _Asked:
    """Make the policy, or connect to it, and compare its conventions with those of the run.

    Args:
        plan: The plan.
        stack: Takes what has to be closed at the end of the run.
        hosted: True to put a policy with weights into a process of its own, for several workers.
        timeout_s: Deadline of one answer of such a policy [s].
    """
    address = plan.policy
    if not (hosted and is_in_process_model(address)):
        minds = Minds(address)
        stack.callback(minds.close)
        info = minds.check(plan.action_space, plan.observation)
        within = not needs_no_thread(address) and not is_remote(address)
        serves_many = within and (info.heavy or minds.takes_batches or is_in_process_model(address))
        if not hosted or not serves_many:
            return _Asked(info, usual_envs(minds), minds, serves_many=serves_many)
        minds.close()
    host = stack.enter_context(Host(address, timeout_s=timeout_s))
    check_action_space(address, host.info, plan.action_space)
    return _Asked(host.info, USUAL_ENVS if host.takes_batches else 1, None, host, serves_many=True)


def _check_numbers(workers: int | None, envs: int | None, engine: str, policy_timeout_s: float) -> None:
    if workers is not None and not 1 <= workers <= MAX_WORKERS:
        raise InvalidInputError("--workers", f"{workers} is out of range", f"Give a number from 1 to {MAX_WORKERS}")
    if envs is not None and not 1 <= envs <= MAX_ENVS:
        raise InvalidInputError("--envs", f"{envs} is out of range", f"Give a number from 1 to {MAX_ENVS}")
    if not 0.0 < policy_timeout_s < float("inf"):
        raise InvalidInputError("--policy-timeout", f"{policy_timeout_s:g} s is out of range", "Give more than 0")
    if engine not in get_args(Engine):
        raise UnknownNameError("engine", engine, get_args(Engine))


def _by_scene(trials: list[Trial]) -> list[Trial]:
    """Order trials so that those which share compiled scenes follow each other; results do not depend on it."""
    return sorted(trials, key=lambda t: (t.task, t.seed))


def _entries(
    run: RunFolder,
    setting: Setting,
    trials: list[Trial],
    workers: int | None,
    *,
    engine: Engine,
    cluster: Cluster,
    asked: _Asked,
) -> Generator[JournalEntry, None, None]:
    """Yield the line for the journal of every trial, as they end."""
    if not trials:
        return
    if engine == "local" and asked.minds is not None and (workers == 1 or len(trials) == 1):
        with Worker(setting, minds=asked.minds) as worker:
            yield from _in_this_process(worker, trials)
        return
    if asked.minds is not None:
        asked.minds.close()  # the workers make their own
    if engine == "ray":
        # Loaded when it is needed: Ray is an extra.
        from betterbench.evaluation.ray_engine import ray_entries  # noqa: PLC0415

        served = asked.info.execution if asked.serves_many else None
        yield from ray_entries(run, setting, trials, workers=workers, cluster=cluster, served=served)
        return
    with Crew(setting, workers or 1, watch=asked.host.watch if asked.host else None) as crew:
        yield from crew.entries(trials)


def _in_this_process(worker: Worker, trials: list[Trial]) -> Iterator[JournalEntry]:
    waiting, running = iter(trials), 0
    while True:
        while worker.free and (trial := next(waiting, None)) is not None:
            worker.start(trial)
            running += 1
        if not running:
            return
        for entry in worker.finished(_TURN_S):
            running -= 1
            yield entry
