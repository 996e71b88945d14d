"""A worker: one thread that simulates and renders many trials, while their policy answers in other threads."""

from __future__ import annotations

import itertools
import math
import queue
import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Self

from betterbench.episodes import Question, Reply
from betterbench.errors import BetterError, HandshakeError, InvalidInputError, PolicyUnavailableError
from betterbench.evaluation.planning.plan import Trial
from betterbench.evaluation.trials.policy_factory import PolicyFactory, is_remote, needs_no_thread, runs_apart
from betterbench.evaluation.trials.policy_thread import Answered, PolicyThread, no_answer
from betterbench.evaluation.trials.shared_policy import SharedPolicy
from betterbench.evaluation.trials.trial import RunSettings, TrialRunner, TrialSteps
from betterbench.interface import BatchPolicy, Policy
from betterbench.policies.batching import MAX_BATCH
from betterbench.recording import JournalEntry
from betterbench.tasks import TrialId

USUAL_ENVS = 8
"""Environments per worker for a policy that answers from another process: while some wait, the others are simulated.
With two workers, two cameras and a server that takes 100 ms, a run with 4 environments took 1.49 times as long as the
simulation alone, and with 8 it took 1.03 times as long."""

MOST_WAITING = 32
"""Environments of all workers together unless more are asked for: a server that answers one question at a time, in
0.3 s, then answers the last one in its queue within 10 s, before the deadline."""

MAX_ENVS = 256

LEAVE_S = 2.0
"""How long the threads of the policies may take to end [s]."""


def usual_envs(policies: PolicyFactory) -> int:
    """Return how many environments a worker keeps open unless told otherwise.

    It is 1 for a policy that answers at once, and for a Python policy that answers one observation at a time: each
    environment has an instance of it, and instances may hold weights.
    """
    if needs_no_thread(policies.address):
        return 1
    return USUAL_ENVS if is_remote(policies.address) or policies.takes_batches else 1


def fair_envs(envs: int, workers: int) -> int:
    """Return how many environments each of several workers keeps open where one worker alone would keep ``envs``."""
    return max(1, min(envs, MOST_WAITING // workers))


def even_share(left: int, workers: int, envs: int) -> int:
    """Return how many trials a worker is given at once, so that all workers end at about the same time.

    Trials that begin together end together. So twelve trials per worker of eight environments are given as six and six,
    not as eight and four. ``left`` counts the trials that have not ended, those under way included.
    """
    share = math.ceil(left / workers)
    return math.ceil(share / math.ceil(share / envs)) if share else 0


@dataclass(slots=True, eq=False)
class _Slot:
    """One environment, and what its trial waits for."""

    thread: PolicyThread | None = None
    trial: TrialId | None = None
    steps: TrialSteps | None = None
    ticket: int = -1  # of the question under way, or -1
    asked_at: float = 0.0
    question: Question | None = None  # the last one
    outcome: Reply | BaseException | None = None  # of the last question, until the trial takes it
    waits: bool = False  # the trial can do nothing before the outcome is there
    figures: Mapping[str, float] = field(default_factory=dict)  # what the policy counts about its connection


class Worker:
    """Runs trials of a plan, several at once, in the thread that calls it.

    Physics and rendering run in that thread and the policy answers in others. Results do not depend on the order: every
    trial is a pure function of its scene and its policy. A context manager, which closes itself.
    """

    def __init__(self, settings: RunSettings, *, policies: PolicyFactory | None = None) -> None:
        """Prepare, and ask the policy what it needs; the worker closes ``policies``, or makes its own."""
        if not 1 <= settings.envs <= MAX_ENVS:
            raise InvalidInputError("--envs", f"{settings.envs} is out of range", f"Give a number from 1 to {MAX_ENVS}")
        self._settings = settings
        self._trial_runner = TrialRunner(settings, policies=policies)
        self._threaded = not needs_no_thread(settings.asked)
        self._timed = self._threaded and not is_remote(settings.asked)
        # Waiting for an answer can be ended where another process gives it.
        self._cuts = is_remote(settings.asked) or runs_apart(settings.asked)
        self._shared: SharedPolicy | None = None
        self._lock = threading.Lock()
        self._slots = [_Slot() for _ in range(settings.envs)]
        self._ready: deque[_Slot] = deque()
        self._outbox: queue.SimpleQueue[Answered] = queue.SimpleQueue()
        self._numbers = itertools.count()
        self._stop: BetterError | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def free(self) -> int:
        """Number of environments without a trial."""
        return sum(slot.steps is None for slot in self._slots)

    @property
    def problem(self) -> BetterError | None:
        """What the next call of :meth:`finished` raises, as soon as it is known: there may be no trial left for it."""
        return self._stop

    def start(self, trial: Trial) -> None:
        """Take a trial, which :meth:`finished` runs; InvalidInputError if no environment is free."""
        for slot in self._slots:
            if slot.steps is None:
                slot.steps, slot.trial = self._trial_runner.steps(trial), trial.id
                slot.ticket, slot.outcome, slot.waits, slot.figures = -1, None, False, {}
                self._ready.append(slot)
                return
        raise InvalidInputError("trial", "no environment of the worker is free", "Check `free` first")

    def finished(self, timeout_s: float) -> list[JournalEntry]:
        """Go on with the trials until one has ended or so many seconds have passed, and return the journal entries.

        Raises:
            PremiseError: If a scene does not show what its instruction presupposes.
            StorageError: If the disk is full.
            PolicyUnavailableError: If the policy's server cannot be reached. The call before has returned the entry of
                the trial in which that happened.
            HandshakeError: If the policy has become another one, likewise.
        """
        if self._stop is not None:
            raise self._stop
        until = time.perf_counter() + timeout_s
        ended: list[JournalEntry] = []
        while not ended:
            self._collect(0.0)
            if self._ready:
                entry = self._advance(self._ready.popleft())
                ended += [] if entry is None else [entry]
            else:
                left = until - time.perf_counter()
                if left <= 0.0 or self.free == len(self._slots):
                    break
                self._collect(left)
            if time.perf_counter() >= until:
                break
        return ended

    def close(self) -> None:
        """Drop the trials that have not ended, and close the policy, unless it hangs."""
        threads = []
        for slot in self._slots:
            if slot.steps is not None:
                slot.steps.close()
                slot.steps = None
            if slot.thread is not None:
                slot.thread.dismiss()
                threads.append(slot.thread)
                slot.thread = None
                if self._cuts:
                    threads[-1].cut()
        until = time.perf_counter() + LEAVE_S
        ended = [thread.join(until - time.perf_counter()) for thread in threads]
        self._ready.clear()
        with self._lock:
            shared, self._shared = self._shared, None
        if shared is not None and all(ended):
            shared.close()
        self._trial_runner.close()

    def _advance(self, slot: _Slot) -> JournalEntry | None:
        """Go on with one trial until it waits, and return its journal entry when it has ended."""
        steps = slot.steps
        if steps is None:
            return None
        given, slot.outcome, slot.waits = slot.outcome, None, False
        stop: BetterError | None = None
        try:
            while True:
                if isinstance(given, BaseException):
                    stop = given if isinstance(given, PolicyUnavailableError | HandshakeError) else None
                    question = steps.throw(given)
                else:
                    question = steps.send(given)
                given = None
                if question is not None:
                    self._ask(slot, question)
                    if question.wanted_in:
                        continue
                slot.waits = True
                return None
        except StopIteration as end:
            entry: JournalEntry = end.value
        slot.steps, slot.ticket = None, -1
        if entry.message is not None and slot.thread is not None:
            slot.thread.distrust()  # the fault may have been found here, as that of an action of the wrong shape
        self._stop = self._stop or stop
        return replace(entry, wall={**entry.wall, **slot.figures}) if slot.figures else entry

    def _collect(self, timeout_s: float) -> None:
        """Wait for an answer, take all that have come, and note which trials can go on."""
        now = time.perf_counter()
        if self._timed:
            timeout_s = min([timeout_s, *(max(0.0, self._due(s) - now) for s in self._slots if s.waits)])
        try:
            answered = self._outbox.get(timeout=timeout_s) if timeout_s > 0.0 else self._outbox.get_nowait()
            while True:
                self._note(answered)
                answered = self._outbox.get_nowait()
        except queue.Empty:
            pass
        if self._timed:
            self._end_overdue()

    def _note(self, answered: Answered) -> None:
        for slot in self._slots:
            if slot.ticket == answered.ticket:
                slot.ticket, slot.outcome = -1, answered.outcome
                slot.figures = answered.figures
                if slot.waits:
                    self._ready.append(slot)
                return
        # Otherwise the trial of the question has ended, or its deadline has passed.

    def _ask(self, slot: _Slot, question: Question) -> None:
        """Put a question to the policy, in the thread of the environment."""
        if slot.trial is None:
            raise AssertionError("only a trial asks")
        if slot.thread is None:
            make = self._share if self._trial_runner.policies.takes_batches else self._trial_runner.policies.take
            client = is_remote(self._settings.asked)
            slot.thread = PolicyThread(make, self._outbox, lambda: next(self._numbers), client=client)
        slot.question, slot.asked_at, slot.outcome = question, time.perf_counter(), None
        slot.ticket = slot.thread.ask(question.seen, slot.trial)

    def _share(self) -> Policy:
        """Return the shared instance as one environment sees it; called in the threads of the environments."""
        with self._lock:
            if self._shared is None:
                taken = self._trial_runner.policies.take()
                if not isinstance(taken, BatchPolicy):
                    raise AssertionError("the policy took batches before")
                self._shared = SharedPolicy(taken, MAX_BATCH)
            return self._shared.seat()

    def _due(self, slot: _Slot) -> float:
        """Return when the deadline of a question ends, by ``time.perf_counter`` [s].

        It begins when the policy is loaded, which has a deadline of its own.
        """
        ready_at = -math.inf if slot.thread is None else slot.thread.ready_at
        return max(slot.asked_at, ready_at) + self._settings.policy_timeout_s

    def _end_overdue(self) -> None:
        """End the trials whose policy hangs, with the process in which it does, and replace its thread."""
        limit = self._settings.policy_timeout_s
        overdue = [s for s in self._slots if s.waits and s.ticket >= 0 and time.perf_counter() > self._due(s)]
        for slot in overdue:
            slot.ticket = -1
            slot.outcome = no_answer(limit)
            self._ready.append(slot)
        if not overdue:
            return
        hang = self._slots if self._trial_runner.policies.takes_batches else overdue
        with self._lock:
            shared, self._shared = self._shared, None
        if shared is not None:
            shared.cut()  # which ends the call that hangs
        for slot in hang:
            if slot.thread is not None:
                slot.thread.dismiss()
                slot.thread.cut()
                slot.thread = None
            if slot.ticket >= 0 and slot.question is not None:
                self._ask(slot, slot.question)  # it was queued behind the batch that hangs
