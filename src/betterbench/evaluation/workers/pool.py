"""A crew: worker processes of this machine, each fed over a pipe with as many trials as it has environments."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Self

from betterbench.errors import BetterError, WorkerError
from betterbench.evaluation.planning.plan import Trial
from betterbench.evaluation.trials.trial import RunSettings
from betterbench.evaluation.workers.worker import Worker, even_share
from betterbench.recording import JournalEntry
from betterbench.tasks import TrialId

logger = logging.getLogger(__name__)

MAX_DEATHS = 3
"""How often the process of a trial may die before the trial is given up; from the second time on it runs alone."""

MAX_DEATHS_IN_A_ROW = 12
"""How many processes may die, with no trial finished in between, before the run is given up."""

MAX_STILLBORN = 3
"""How many processes may die one after the other while they start, before the run goes on with those it has."""

_TURN_S = 0.02
_WATCH_S = 0.5
_FAREWELL_S = 10.0


@dataclass(eq=False)
class _WorkerProcess:
    """One worker process."""

    process: BaseProcess
    connection: Connection
    trials: dict[TrialId, Trial] = field(default_factory=dict)
    alone: bool = False  # its one trial was in a process that died
    lost: bool = False  # its end of the pipe is closed
    ready: bool = False  # it has loaded what it needs


class WorkerPool:
    """Runs trials in worker processes and does those of a dead one again. A context manager, which ends them all."""

    def __init__(self, settings: RunSettings, workers: int, *, watch: Callable[[], None] | None = None) -> None:
        """Prepare; processes are started when there is work.

        Args:
            settings: What all trials of the run share.
            workers: Worker processes.
            watch: Called about twice a second.
        """
        self._setting, self._workers, self._watch = settings, workers, watch
        self._hands: list[_WorkerProcess] = []
        self._waiting: deque[Trial] = deque()
        self._suspects: deque[Trial] = deque()
        self._deaths: Counter[TrialId] = Counter()
        self._in_a_row = 0
        self._stillborn = 0

    def __enter__(self) -> Self:
        """Return the crew itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End all processes."""
        self.close()

    def entries(self, trials: Iterable[Trial]) -> Iterator[JournalEntry]:
        """Yield the line for the journal of every trial, as they end.

        Args:
            trials: The trials.

        Raises:
            WorkerError: If workers keep dying.
            BetterError: Whatever a worker says has to stop the run.
        """
        self._waiting.extend(trials)
        while self._waiting or self._suspects or any(h.trials for h in self._hands):
            self._start_worker()
            self._hand_out()
            if self._watch is not None:
                self._watch()
            places = {h.connection: h for h in self._hands} | {h.process.sentinel: h for h in self._hands}
            heard = [places[p] for p in wait(list(places), timeout=_WATCH_S)]  # type: ignore[index]
            # A child of a dead worker may hold its pipe and its sentinel open, so neither tells of its death.
            heard += [h for h in self._hands if not h.process.is_alive()]
            for hand in dict.fromkeys(heard):
                ended = list(self._heard(hand))
                self._hand_out()  # before the journal waits for the disk
                yield from ended
                if hand.lost or not hand.process.is_alive():
                    yield from self._handle_worker_exit(hand)
        for hand in self._hands:
            with contextlib.suppress(OSError):
                hand.connection.send(None)
        for hand in self._hands:
            hand.process.join(_FAREWELL_S)

    def close(self) -> None:
        """End all processes at once; what they had not finished is as if it had not begun."""
        hands, self._hands = self._hands, []
        for hand in hands:
            if hand.process.is_alive():
                hand.process.kill()
        for hand in hands:
            hand.process.join()
            hand.connection.close()
            hand.process.close()

    def _start_worker(self) -> None:
        """Start processes as long as there is work for them."""
        for _ in range(min(self._workers - len(self._hands), len(self._waiting) + len(self._suspects))):
            with deaf_to_interrupts():
                self._hands.append(start_worker(self._setting))

    def _hand_out(self) -> None:
        """Give every process an even share of the trials, in turns; a suspect has a process for itself."""
        for hand in self._hands:
            if self._suspects and not hand.trials and not hand.lost:
                hand.alone = True
                self._send(hand, self._suspects.popleft())
        left = len(self._waiting) + sum(len(hand.trials) for hand in self._hands)
        room = even_share(left, max(1, len(self._hands)), self._setting.envs)
        for _ in range(room):
            for hand in self._hands:
                if self._waiting and not hand.alone and not hand.lost and len(hand.trials) < room:
                    self._send(hand, self._waiting.popleft())

    def _send(self, hand: _WorkerProcess, trial: Trial) -> None:
        hand.trials[TrialId(trial.task, trial.condition, trial.seed)] = trial
        try:
            hand.connection.send(trial)
        except OSError:
            hand.lost = True  # its death is noticed in a moment, and the trial is done again

    def _heard(self, hand: _WorkerProcess) -> Iterator[JournalEntry]:
        """Yield what a process has sent.

        Raises:
            BetterError: If it says that the run has to stop.
        """
        try:
            while hand.connection.poll():
                said = hand.connection.recv()
                if isinstance(said, BetterError):
                    raise said
                if said is None:
                    hand.ready, self._stillborn = True, 0
                    continue
                hand.trials.pop(said.key, None)
                hand.alone = False
                self._in_a_row = 0
                yield said
        except (EOFError, OSError):
            hand.lost = True

    def _handle_worker_exit(self, hand: _WorkerProcess) -> Iterator[JournalEntry]:
        """Replace a process that died, and have its trials done again or give them up."""
        yield from self._heard(hand)
        self._hands.remove(hand)
        hand.process.join(_WATCH_S)
        if hand.process.is_alive():
            hand.process.kill()
            hand.process.join()
        how = _how_it_died(hand.process.exitcode)
        hand.connection.close()
        if not hand.ready:
            self._handle_failed_start(hand, how)
            return
        self._in_a_row += 1
        logger.warning("a worker process died (%s); its %d trials are done again", how, len(hand.trials))
        for key, trial in hand.trials.items():
            self._deaths[key] += 1
            if self._deaths[key] < MAX_DEATHS:
                self._suspects.append(trial)
                continue
            message = f"its worker process died {MAX_DEATHS} times ({how}); run the same command again to retry it"
            yield JournalEntry(trial.task, trial.condition, trial.variation, trial.seed, "error", message)
            self._in_a_row = 0
        if self._in_a_row >= MAX_DEATHS_IN_A_ROW:
            raise WorkerError(
                f"{self._in_a_row} worker processes died one after the other ({how}). "
                "Run the same command again with fewer --workers, or with 1 to see why."
            )

    def _handle_failed_start(self, hand: _WorkerProcess, how: str) -> None:
        """Go on without a worker that died before it was ready, which no trial is to blame for.

        Raises:
            WorkerError: If no worker gets ready.
        """
        self._waiting.extendleft(reversed(hand.trials.values()))
        self._stillborn += 1
        if self._stillborn < MAX_STILLBORN:
            logger.warning("a worker process died while it started (%s); another one is started", how)
            return
        if not any(h.ready for h in self._hands):
            raise WorkerError(
                f"{self._stillborn} worker processes died while they started ({how}). What they wrote stands above. "
                "Run the same command again with fewer --workers, or with 1 to see why."
            )
        self._workers = len(self._hands)
        logger.warning("another worker process cannot start (%s); the run goes on with %d", how, self._workers)


def start_worker(settings: RunSettings) -> _WorkerProcess:
    """Start a worker process that is deaf to Ctrl-C: the process that started it decides what happens then.

    Args:
        settings: What all trials of the run share.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=work, args=(settings, theirs), name="betterbench-worker")
    with deaf_to_interrupts():
        process.start()
    theirs.close()
    return _WorkerProcess(process, ours)


@contextlib.contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Hold Ctrl-C back in this thread, and for good in processes that are started meanwhile."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def work(settings: RunSettings, connection: Connection) -> None:
    """Take trials from a pipe and send back lines for the journal; this is the main function of a worker process.

    Args:
        settings: What all trials of the run share.
        connection: The pipe. None means that there is no more work; sent back it means that the worker is ready. An
            error sent back stops the run.
    """
    prepare_process()
    with contextlib.suppress(EOFError, BrokenPipeError):
        try:
            with Worker(settings) as worker:
                connection.send(None)  # it is ready
                _take_and_send(worker, settings.envs, connection)
        except BetterError as problem:
            connection.send(problem)


def _take_and_send(worker: Worker, envs: int, connection: Connection) -> None:
    while True:
        while worker.free and connection.poll(None if worker.free == envs else 0.0):
            trial = connection.recv()
            if trial is None:
                return
            worker.start(trial)
        for entry in worker.finished(_TURN_S):
            connection.send(entry)


def prepare_process() -> None:
    """Keep numerical libraries and the software renderer to one thread each, and let nobody outlive the run."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    os.environ.setdefault("LP_NUM_THREADS", "0")
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when the run is killed; it would wait for work for ever, and write into a resumed run."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _how_it_died(exitcode: int | None) -> str:
    if exitcode is None or exitcode >= 0:
        return f"exit status {exitcode}"
    name = signal.Signals(-exitcode).name if -exitcode in set(signal.Signals) else f"signal {-exitcode}"
    return f"{name}, as when memory runs out" if name == "SIGKILL" else name
