"""Pool of worker processes on this machine, which get their trials through pipes."""

from __future__ import annotations

import contextlib
import itertools
import logging
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from typing import Self

from betterbench.errors import BetterError, PolicyProcessError, WorkerError
from betterbench.evaluation.trials.trial import WorkerSettings, broken_entry
from betterbench.evaluation.workers.step_count import StepCount, StepReport, StepsTaken
from betterbench.evaluation.workers.worker import Worker, even_share
from betterbench.jobs import RetryLedger
from betterbench.jobs.worker_process import SpawnedProcess, interrupts_blocked, prepare_process
from betterbench.records import JournalEntry
from betterbench.sim.graphics import take_device
from betterbench.tasks import TrialId
from betterbench.tasks.trial import Trial

logger = logging.getLogger(__name__)

MAX_FAILED_STARTS = 3
"""Number of consecutive failed starts after which no more processes are started.

The run continues with the processes that are running.
"""

_CURE = "Run the same command again with fewer --workers, or with 1 to see why."
_TURN_S = 0.02
_WATCH_S = 0.5
_END_S = 10.0


class WorkerProcess(SpawnedProcess):
    """Worker process of the pool, with its state."""

    def __init__(self, settings: WorkerSettings) -> None:
        super().__init__(work, settings, name="betterbench-worker")
        self.trials: dict[TrialId, Trial] = {}  # assigned trials that have not ended
        self.alone = False  # whether the process runs only one trial, because another process died while running it
        self.lost = False  # whether the process has closed its end of the pipe
        self.ready = False  # whether the process is ready
        self.turn = settings.turn  # index among the running processes
        self.envs = settings.envs  # number of simultaneous trials, as last reported by the process


@dataclass(frozen=True, slots=True)
class OpenEnvironments:
    """Message from a worker process: the number of trials that it can run at the same time from now on."""

    envs: int


class WorkerPool:
    """Pool that runs trials in worker processes, and repeats the trials of processes that have died.

    Use the pool as a context manager.
    """

    def __init__(
        self,
        settings: WorkerSettings,
        workers: int,
        *,
        watch: Callable[[], None] | None = None,
        steps: StepCount | None = None,
    ) -> None:
        """Store the settings. Processes are started as soon as there is work for them.

        ``watch`` is called about twice a second. ``steps`` counts the control steps that workers report.
        """
        self._settings, self._workers, self._watch = settings, workers, watch
        self._steps = steps or StepCount()
        self._processes: list[WorkerProcess] = []
        self._ledger: RetryLedger[Trial] = RetryLedger((), workers="worker processes", cure=_CURE)
        self._failed_starts = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def entries(self, rounds: Iterable[Iterable[Trial]]) -> Iterator[JournalEntry]:
        """Run trials, and yield the journal entry of each when it ends.

        The next round of trials is requested when all trials of the current round have ended.

        Raises:
            WorkerError: If workers keep dying.
            BetterError: If an error in a worker must stop the run.
        """
        for trials in rounds:
            self._ledger.put_back(trials)
            while self._ledger.left or any(worker.trials for worker in self._processes):
                self._start_workers()
                self._distribute()
                if self._watch is not None:
                    self._watch()
                for worker in self._wait():
                    ended = list(self._receive(worker))
                    self._distribute()  # gives the workers new trials while the journal is written to disk
                    yield from ended
                    if worker.lost or not worker.process.is_alive():
                        yield from self._handle_worker_exit(worker)
        for worker in self._processes:
            with contextlib.suppress(OSError):
                worker.connection.send(None)
        for worker in self._processes:
            worker.process.join(_END_S)
            for _ in self._receive(worker):
                raise AssertionError("unreachable: every trial has ended")

    def close(self) -> None:
        """End all processes immediately. Trials that have not ended leave no files behind."""
        processes, self._processes = self._processes, []
        for worker in processes:
            worker.process.kill()
        for worker in processes:
            worker.end()

    def _wait(self) -> Iterable[WorkerProcess]:
        """Wait until processes have sent a message or ended, and return these processes.

        Stop waiting when ``watch`` must be called again.
        """
        sources = {w.connection: w for w in self._processes} | {w.process.sentinel: w for w in self._processes}
        found = [sources[source] for source in wait(list(sources), timeout=_WATCH_S)]  # type: ignore[index]
        # A child of a dead worker may keep the worker's pipe and sentinel open, so check for dead workers separately.
        found += [w for w in self._processes if not w.process.is_alive()]
        return dict.fromkeys(found)

    def _start_workers(self) -> None:
        """Start more processes until there are enough for the trials that are left."""
        for _ in range(min(self._workers - len(self._processes), self._ledger.left)):
            taken = {worker.turn for worker in self._processes}
            turn = next(number for number in itertools.count() if number not in taken)
            with interrupts_blocked():  # an interrupt must not leave a process that is not in the list
                self._processes.append(WorkerProcess(replace(self._settings, turn=turn)))

    def _distribute(self) -> None:
        """Distribute the trials evenly among the processes.

        A trial that may have caused the death of a process runs alone in its process.
        """
        for worker in self._processes:
            if self._ledger.suspects and not worker.trials and not worker.lost:
                worker.alone = True
                self._send(worker, self._ledger.take_suspect())
        left = self._ledger.waiting + sum(len(worker.trials) for worker in self._processes)
        rooms = {w: even_share(left, max(1, len(self._processes)), w.envs) for w in self._processes}
        for _ in range(max(rooms.values(), default=0)):
            for worker in self._processes:
                if not worker.alone and not worker.lost and len(worker.trials) < rooms[worker]:
                    for trial in self._ledger.take(1):
                        self._send(worker, trial)

    def _send(self, worker: WorkerProcess, trial: Trial) -> None:
        worker.trials[trial.id] = trial
        try:
            worker.connection.send(trial)
        except OSError:
            worker.lost = True  # the exit is handled in the next iteration, and the trial is repeated

    def _receive(self, worker: WorkerProcess) -> Iterator[JournalEntry]:
        """Handle the messages of a process, and yield the journal entries among them."""
        try:
            while worker.connection.poll():
                message = worker.connection.recv()
                if isinstance(message, BetterError):
                    raise message
                if message is None:
                    worker.ready, self._failed_starts = True, 0
                    continue
                if isinstance(message, OpenEnvironments):
                    worker.envs = message.envs
                    continue
                if isinstance(message, StepsTaken):
                    self._steps.add(message.steps)
                    continue
                worker.trials.pop(message.key, None)
                worker.alone = False
                self._ledger.item_ended()
                yield message
        except (EOFError, OSError):
            worker.lost = True

    def _handle_worker_exit(self, worker: WorkerProcess) -> Iterator[JournalEntry]:
        """Remove a process that has died. Queue its trials again, or end them with an error after too many attempts."""
        yield from self._receive(worker)
        self._processes.remove(worker)
        how = worker.end(_WATCH_S)
        if not worker.ready:
            self._handle_failed_start(worker, how)
            return
        logger.warning("a worker process died (%s); its %d trials are repeated", how, len(worker.trials))
        for trial in self._ledger.worker_died(list(worker.trials.values()), how):
            yield broken_entry(trial, self._ledger.reason(how))

    def _handle_failed_start(self, worker: WorkerProcess, how: str) -> None:
        """Handle a process that died before it was ready. No trial can have caused this."""
        self._ledger.put_back(worker.trials.values())
        self._failed_starts += 1
        if self._failed_starts < MAX_FAILED_STARTS:
            logger.warning("a worker process died during its start (%s); another one is started", how)
            return
        if not any(other.ready for other in self._processes):
            raise WorkerError(
                f"{self._failed_starts} worker processes died during their start ({how}). See their output "
                f"above. {_CURE}"
            )
        self._workers = len(self._processes)
        logger.warning("another worker process cannot start (%s); the run continues with %d", how, self._workers)


def work(settings: WorkerSettings, connection: Connection) -> None:
    """Main function of a worker process: receive trials through a pipe, and send back journal entries.

    The process sends None when it is ready, and receives None when there is no more work. If it sends an error, the run
    stops.
    """
    prepare_process(settings.held)
    take_device(settings.turn)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):  # the run has ended
        try:
            with Worker(settings, on_step=StepReport(lambda steps: _report(connection, steps))) as worker:
                connection.send(None)
                _take_and_send(worker, connection)
        except PolicyProcessError as problem:  # fewer workers may fit into memory
            logger.warning("%s", problem)
            raise SystemExit(1) from None
        except BetterError as problem:
            connection.send(problem)


def _report(connection: Connection, steps: int) -> None:
    with contextlib.suppress(OSError):  # the run has ended; the worker notices this at the end of its trial
        connection.send(StepsTaken(steps))


def _take_and_send(worker: Worker, connection: Connection) -> None:
    envs = worker.envs
    while True:
        while worker.free and connection.poll(0.0 if worker.busy else None):
            trial = connection.recv()
            if trial is None:
                return
            worker.start(trial)
        for entry in worker.finished(_TURN_S):
            connection.send(entry)
        if worker.envs != envs:
            envs = worker.envs
            connection.send(OpenEnvironments(envs))
        if worker.problem is not None:
            raise worker.problem
