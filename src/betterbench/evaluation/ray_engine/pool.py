"""Runs on a Ray cluster, with workers and policy replicas as actors.

No shared file system is needed: workers send finished records to the driver process, which writes all files. If a
worker dies, other workers repeat its unfinished trials.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from betterbench.errors import BetterError, InvalidInputError, PolicyUnavailableError, WorkerError
from betterbench.evaluation.ray_engine.cluster import PLACING_S
from betterbench.evaluation.ray_engine.remote_worker import Delivery, RemoteWorker, Turn, versions_here
from betterbench.evaluation.ray_engine.replicas import Replicas
from betterbench.evaluation.ray_engine.session import (
    TRY_AGAIN,
    RaySession,
    as_better_error,
    cluster_lost,
    first_line,
    kill,
    loss_errors,
)
from betterbench.evaluation.trials.trial import WorkerSettings, broken_entry
from betterbench.evaluation.workers.step_count import StepCount
from betterbench.evaluation.workers.worker import even_share
from betterbench.jobs import RetryLedger, write_durably
from betterbench.jobs.durable import on_disk
from betterbench.records import JournalEntry, RunFolder
from betterbench.tasks.trial import Trial

logger = logging.getLogger(__name__)

_CLOSE_S = 3.0
_WAIT_S = 5.0
_CALLS = 2  # one running and one queued call, so that workers never wait for the driver


def ray_entries(
    session: RaySession,
    run: RunFolder,
    settings: WorkerSettings,
    rounds: Iterable[Sequence[Trial]],
    *,
    served: bool = False,
    steps: StepCount | None = None,
) -> Iterator[JournalEntry]:
    """Run trials on a Ray cluster. Yield each journal entry after the record of the trial has been written.

    Only this process writes to the run folder. The next round of trials is requested when all trials of the current
    round have ended. If ``served`` is True, the policy runs in replicas. ``steps`` counts the control steps that
    workers report.

    Raises:
        InvalidInputError: If the cluster has no free resources, or the software versions on its machines differ from
            those on this machine.
        WorkerError: If workers keep dying or cannot start, or if the cluster is lost.
        BetterError: If an error stops the run, such as a false premise, a full disk or an unreachable policy.
    """
    pool = RayPool(session, run, settings, steps or StepCount())
    try:
        if served:
            pool.start_replicas()
        for trials in rounds:
            yield from pool.entries(trials)
    except loss_errors(session.ray) as error:
        raise cluster_lost(error) from error
    finally:
        pool.close()


@dataclass(slots=True, eq=False)
class _WorkerActor:
    """Worker of the pool, with its calls and its trials."""

    actor: Any
    calls: deque[Any]  # calls that have not returned, the oldest first
    trials: list[Trial] = field(default_factory=list)  # assigned trials that have not ended
    placed: bool = False  # whether the cluster has allocated resources to the worker
    ready: bool = False  # whether the worker has been prepared
    alone: bool = False  # whether the worker runs only one trial, because another worker died while running it
    replica: int | None = None  # index of the policy replica that the worker uses
    broken: list[Trial] = field(default_factory=list)  # trials that ended with an error
    envs: int = 1  # number of simultaneous trials, as last reported by the worker


class RayPool:
    """Pool of the workers that run the trials of a run on a Ray cluster."""

    def __init__(self, session: RaySession, run: RunFolder, settings: WorkerSettings, steps: StepCount) -> None:
        """Create the pool. The arguments are the same as for :func:`ray_entries`."""
        self._steps = steps
        self._ray, self._session, self._run, self._settings = session.ray, session, run, settings
        self._ledger = RetryLedger[Trial]((), workers="workers of the cluster", cure=TRY_AGAIN)
        self._replicas = Replicas(session, settings)
        self._workers: list[_WorkerActor] = []
        self._made = 0
        self._asked_at = 0.0

    def start_replicas(self) -> None:
        """Start the replicas of the policy."""
        self._replicas.start()

    def entries(self, trials: Sequence[Trial]) -> Iterator[JournalEntry]:
        """Run trials, and yield the journal entry of each when it ends. The workers stay alive for further trials."""
        self._ledger.put_back(trials)
        for _ in range(min(self._session.workers, self._ledger.left) - len(self._workers)):
            self._add_worker()
        while self._left:
            for worker in self._workers:
                self._feed(worker)
            calls = {call: worker for worker in self._workers for call in worker.calls}
            done, _ = self._ray.wait(list(calls), num_returns=1, timeout=_WAIT_S)
            for call in done:
                yield from self._take(calls[call], call)
            placed = any(worker.placed for worker in self._workers)
            if not placed and time.monotonic() - self._asked_at > PLACING_S:
                raise InvalidInputError(
                    "--engine ray",
                    f"the cluster has no free CPU core for a worker (free: {self._session.free_text()})",
                    "Wait until other jobs have ended, or add machines",
                )

    def close(self) -> None:
        """End all actors. To run the unfinished trials, run the same command again."""
        with contextlib.suppress(*loss_errors(self._ray)):
            closing = [worker.actor.close.remote() for worker in self._workers if worker.ready]
            if closing:
                self._ray.wait(closing, num_returns=len(closing), timeout=_CLOSE_S)
        kill(self._ray, [worker.actor for worker in self._workers])
        self._workers = []
        self._replicas.close()

    @property
    def _left(self) -> bool:
        return bool(self._ledger.left or any(worker.trials for worker in self._workers))

    def _add_worker(self, replica: int | None = None) -> None:
        """Add a worker.

        If the policy runs in replicas, the worker uses the replica with the given index. By default, workers use the
        replicas in turn.
        """
        settings, addresses = self._settings, self._replicas.addresses
        if addresses:
            replica = self._made % len(addresses) if replica is None else replica
            settings = replace(settings, served_at=addresses[replica])
        settings = replace(settings, turn=self._made)
        self._made += 1
        known = [path.stem for path in sorted((self._run.path / "scenes").glob("*.zip"))]
        description = (self._run.path / "run.json").read_bytes()
        # Ray must not restart the actors itself, because only this process knows which trials were lost.
        remote = self._ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(RemoteWorker)
        actor = remote.remote(settings, description, known)
        calls = deque([actor.__ray_ready__.remote(), actor.prepare.remote(self._replicas.environment)])
        self._workers.append(_WorkerActor(actor, calls, replica=replica, envs=settings.envs))
        self._asked_at = time.monotonic()

    def _feed(self, worker: _WorkerActor) -> None:
        """Send a worker an equal share of the remaining trials.

        While many trials remain, the worker gets one more trial, which waits in the worker's queue.
        """
        if not worker.ready:
            return
        if len(worker.calls) >= _CALLS or (worker.alone and worker.trials):
            new: list[Trial] = []
        elif self._ledger.suspects and not worker.trials:
            new, worker.alone = [self._ledger.take_suspect()], True
        else:
            plenty = self._ledger.waiting > sum(other.envs for other in self._workers)
            left = self._ledger.waiting + sum(len(other.trials) for other in self._workers)
            share = even_share(left, len(self._workers), worker.envs)
            new, worker.alone = self._ledger.take(max(0, share + plenty - len(worker.trials))), False
        worker.trials += new
        while worker.trials and len(worker.calls) < _CALLS:
            worker.calls.append(worker.actor.turn.remote(tuple(new)))
            new = []

    def _take(self, worker: _WorkerActor, call: Any) -> Iterator[JournalEntry]:  # noqa: ANN401 -- a reference of Ray
        """Store the results of a call that a worker has finished, and yield the journal entries in the results."""
        if call not in worker.calls:
            return  # result of a worker that has died in the meantime
        errors = self._ray.exceptions
        try:
            found = self._ray.get(call)
        except errors.RayTaskError as error:  # the worker is alive, but the call raised an error
            if not worker.ready or isinstance(error.cause, BetterError):
                raise as_better_error(error, "A worker on the cluster cannot start") from error
            yield from self._handle_exit(worker, error)
            return
        except errors.RayError as error:  # the worker died, or its machine was lost
            yield from self._handle_exit(worker, error)
            return
        worker.calls.remove(call)
        worker.placed = True
        if isinstance(found, Turn):
            worker.envs = found.envs or worker.envs
            self._steps.add(found.steps)
            for scene, data in found.scenes.items():
                if not self._run.scene_path(scene).exists():
                    self._write(self._run.scene_path(scene), data)
            for delivery in found.deliveries:
                yield self._store(worker, delivery)
            if isinstance(found.problem, PolicyUnavailableError) and self._replace_replicas():
                return
            if found.problem is not None:
                raise found.problem
        elif isinstance(found, Mapping):
            self._accept(worker, found)

    def _store(self, worker: _WorkerActor, delivery: Delivery) -> JournalEntry:
        """Write the record of a finished trial. Return the trial's journal entry."""
        entry = delivery.entry
        if delivery.record is not None:
            self._write(self._run.record_path(entry.task, entry.condition, entry.seed), delivery.record)
        worker.broken += [t for t in worker.trials if t.id == entry.key and entry.status == "error"]
        worker.trials = [t for t in worker.trials if t.id != entry.key]
        self._ledger.item_ended()
        return entry

    def _write(self, path: Path, data: bytes) -> None:
        with on_disk(self._run.path):
            write_durably(path, data)

    def _accept(self, worker: _WorkerActor, versions: Mapping[str, str]) -> None:
        """Mark a worker as ready after checking that it uses the same software versions as this process."""
        here = versions_here()
        other = {name: value for name, value in versions.items() if here.get(name, value) != value}
        if other:
            there = ", ".join(f"{name} {value} (here {here[name]})" for name, value in sorted(other.items()))
            raise InvalidInputError(
                "--engine ray",
                f"a machine in the cluster has different software versions than this machine: {there}",
                "Install the same versions on all machines",
            )
        if "problem" in versions:
            raise WorkerError(f"A worker on the cluster cannot start: {versions['problem']}")
        worker.ready = True

    def _handle_exit(self, worker: _WorkerActor, error: Exception) -> Iterator[JournalEntry]:
        """Replace a worker that was lost.

        The worker's unfinished trials are queued again. After too many attempts, a trial ends with an error instead.
        """
        logger.warning("a worker of the cluster died; other workers take its %d trials", len(worker.trials))
        self._workers.remove(worker)
        kill(self._ray, [worker.actor])
        how = first_line(error)
        for trial in self._ledger.worker_died(worker.trials, how):
            yield broken_entry(trial, self._ledger.reason(how))
        if self._left:
            self._add_worker(worker.replica)

    def _replace_replicas(self) -> bool:
        """Replace the replicas that have died, and the workers that use them.

        Return whether any replica was replaced.
        """
        dead = self._replicas.replace_dead()
        for worker in [w for w in self._workers if w.replica in dead]:
            self._workers.remove(worker)
            kill(self._ray, [worker.actor])
            self._ledger.put_back([*worker.trials, *worker.broken])
            self._add_worker(worker.replica)
        return bool(dead)
