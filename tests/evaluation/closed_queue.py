"""Workers, their environments and a policy server on a virtual clock: how long a run takes, without running one."""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from betterbench.evaluation.workers.environment_count import EnvironmentCount
from betterbench.evaluation.workers.worker import even_share


@dataclass
class Server:
    """A policy server.

    Attributes:
        latency_s: Time of an answer, or of a call with many observations [s].
        kind: "free" answers all at once; "serial" one after the other; "batches" takes one call of up to ``batch``
            questions at a time, of one worker at a time.
        first_s: Time of everything that is asked before the first answer, while it compiles its model [s].
    """

    latency_s: float
    kind: Literal["free", "serial", "batches"] = "free"
    batch: int = 16
    first_s: float = 0.0
    busy_until: float = 0.0

    def end_of(self, now: float) -> float:
        """Return when an answer to a call of now comes."""
        if self.first_s:
            self.first_s, begun = 0.0, now + self.first_s
            self.busy_until = begun
        begin = max(now, self.busy_until)
        if self.kind != "free":
            self.busy_until = begin + self.latency_s
        return begin + self.latency_s


@dataclass
class _Worker:
    count: EnvironmentCount
    ready: deque = field(default_factory=deque)  # (trial, question) that can go on
    gathered: list = field(default_factory=list)  # waiting for a call
    calling: bool = False
    returned_at: float = 0.0  # the call before
    waits_until: float = -1.0  # for further questions of a call
    free_at: float = 0.0
    open: int = 0
    worked_s: float = 0.0


@dataclass
class Queue:
    """A run on the virtual clock.

    Attributes:
        envs: Environments of each worker at the beginning, and what a warm-up may choose at most.
        worker_s: Mean time of a chunk [s]; times vary by half of it.
        setup_s: Time in which a worker sets a trial up [s].
        chunks: Questions of the trials, in turn.
        unclean: Answers at the beginning for which a connection is made again.
    """

    server: Server
    trials: int = 72
    workers: int = 2
    envs: tuple[int, int] = (8, 48)
    worker_s: float = 0.015
    setup_s: float = 0.1
    chunks: tuple[int, ...] = (68,)
    unclean: int = 0

    @property
    def questions(self) -> list[int]:
        """Questions of each trial."""
        return [self.chunks[i % len(self.chunks)] for i in range(self.trials)]

    def run(self, seed: int = 0) -> tuple[float, float, list[int]]:
        """Return the time of the run, that of the busier worker [s], and the numbers of environments at the end."""
        self._draw = np.random.default_rng(seed)
        self._events: list = []
        self._order, self._numbers = itertools.count(), itertools.count()
        self._waiting, self._running, self._now = self.trials, 0, 0.0
        questions = self.questions
        workers = [_Worker(EnvironmentCount(*self.envs, left=self._left)) for _ in range(self.workers)]
        while True:
            for worker in workers:
                self._give_trials(worker)
                self._work(worker)
                self._call(worker)
            if not self._running:
                return self._now, max(w.worked_s for w in workers), [w.count.number for w in workers]
            self._now, _, worker, what = heapq.heappop(self._events)
            if isinstance(what, list):
                self._take_answers(worker, what)
            elif what and what[1] < questions[what[0]]:
                worker.gathered.append((*what, self._now))
            elif what:
                worker.open, self._running = worker.open - 1, self._running - 1

    def _left(self) -> int:
        return -(-(self._waiting + self._running) // self.workers)

    def _later(self, time_s, worker, what):
        heapq.heappush(self._events, (time_s, next(self._order), worker, what))

    def _give_trials(self, worker):
        room = even_share(self._waiting + self._running, self.workers, worker.count.number)
        while self._waiting and worker.open < room:
            self._waiting, self._running, worker.open = self._waiting - 1, self._running + 1, worker.open + 1
            worker.ready.append((next(self._numbers), -1))

    def _work(self, worker):
        """Set a trial up, or play a chunk, if the worker is free."""
        if worker.free_at > self._now or not worker.ready:
            return
        trial, chunk = worker.ready.popleft()
        takes_s = self.setup_s if chunk < 0 else float(self._draw.gamma(4.0, self.worker_s / 4.0))
        worker.free_at = self._now + takes_s
        worker.worked_s += takes_s
        worker.count.worked(takes_s, on_setup=chunk < 0)
        self._later(worker.free_at, worker, (trial, chunk + 1))

    def _call(self, worker):
        """Ask what has gathered: in one call at a time of a server of batches, each question by itself otherwise."""
        if self.server.kind != "batches":
            while worker.gathered:
                self._later(self.server.end_of(self._now), worker, [worker.gathered.pop(0)])
        elif worker.gathered and not worker.calling:
            until = max(worker.returned_at, worker.gathered[0][2]) + self.server.latency_s
            if len(worker.gathered) < min(self.server.batch, worker.open) and self._now < until - 1e-9:
                if worker.waits_until != until:
                    worker.waits_until = until
                    self._later(until, worker, ())  # further questions are expected
                return
            some, worker.gathered = worker.gathered[: self.server.batch], worker.gathered[self.server.batch :]
            worker.calling = True
            self._later(self.server.end_of(self._now), worker, some)

    def _take_answers(self, worker, questions):
        worker.calling, worker.returned_at = False, self._now
        for trial, chunk, asked_at in questions:
            worker.ready.append((trial, chunk))
            clean, self.unclean = self.unclean <= 0, self.unclean - 1
            took_s = self._now - asked_at
            worker.count.answered(trial, asked_at=asked_at, now=self._now, took_s=took_s, clean=clean)
