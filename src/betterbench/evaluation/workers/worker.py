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
from betterbench.evaluation.trials.policy_factory import PolicyFactory, is_remote, needs_no_thread
from betterbench.evaluation.trials.policy_thread import Answered, PolicyThread, no_answer
from betterbench.evaluation.trials.shared_policy import SharedPolicy
from betterbench.evaluation.trials.trial import RunSettings, TrialRunner, TrialSteps
from betterbench.interface import BatchPolicy, Policy
from betterbench.policies.batching import MAX_BATCH
from betterbench.recording import JournalEntry

USUAL_ENVS = 8
"""Environments per worker for a policy that answers from elsewhere: while some wait, the others are simulated. With two
workers, two cameras and a server of 100 ms, 4 took 1.49 times as long as the simulation alone and 8 take 1.03."""

MOST_WAITING = 32
"""Environments of all workers together, unless told otherwise: a server that answers one question at a time, in 0.3 s,
then still answers the last of a queue within 10 s, well before its deadline."""

MAX_ENVS = 256

LEAVE_S = 2.0
"""How long the threads of the policies are waited for at the end [s]."""


def usual_envs(policies: PolicyFactory) -> int:
    """Return how many environments a worker keeps open unless told otherwise.

    One for a policy that answers at once, and for a Python policy that answers one observation at a time: each
    environment has an instance of it, and instances may hold weights.

    Args:
        policies: Makes the policy.
    """
    if needs_no_thread(policies.address):
        return 1
    return USUAL_ENVS if is_remote(policies.address) or policies.takes_batches else 1


def fair_envs(envs: int, workers: int) -> int:
    """Return how many environments each of several workers keeps open, so that no server has too long a queue.

    Args:
        envs: What one worker alone would keep open.
        workers: Number of workers.
    """
    return max(1, min(envs, MOST_WAITING // workers))


def even_share(left: int, workers: int, envs: int) -> int:
    """Return how many trials a worker is given at once, so that all workers end with the last ones together.

    Trials that were begun together end together. Twelve trials for each worker of eight environments are two times six
    and not eight and four: the first worker with eight free environments would take all that is left.

    Args:
        left: Trials that have not ended, those under way included.
        workers: Number of workers.
        envs: Environments of each.
    """
    share = math.ceil(left / workers)
    return math.ceil(share / math.ceil(share / envs)) if share else 0


@dataclass(slots=True, eq=False)
class _Slot:
    """One environment, and what its trial waits for."""

    respondent: PolicyThread | None = None
    steps: TrialSteps | None = None
    ticket: int = -1  # of the question under way, or -1
    asked_at: float = 0.0
    question: Question | None = None  # the last one
    outcome: Reply | BaseException | None = None  # of the last question, until the trial takes it
    waits: bool = False  # the trial can do nothing before the outcome is there
    figures: Mapping[str, float] = field(default_factory=dict)  # what the policy counts about its connection


class Worker:
    """Runs trials of a plan, several at once, in the thread that calls it.

    Physics and rendering take turns in that thread; questions to the policy are under way in others. Results depend on
    neither: every trial is a pure function of its scene and its policy. A context manager, which closes itself.
    """

    def __init__(self, settings: RunSettings, *, policies: PolicyFactory | None = None) -> None:
        """Prepare, and ask the policy what it needs.

        Args:
            settings: What all trials of the run share.
            policies: Makes the policy; it is taken over. None to make the policy of the settings.

        Raises:
            InvalidInputError: If the number of environments is out of range.
            BetterError: If the policy cannot be made, its server not be reached or the run not be read.
        """
        if not 1 <= settings.envs <= MAX_ENVS:
            raise InvalidInputError("--envs", f"{settings.envs} is out of range", f"Give a number from 1 to {MAX_ENVS}")
        self._setting = settings
        self._trial_runner = TrialRunner(settings, policies=policies)
        self._threaded = not needs_no_thread(settings.asked)
        self._timed = self._threaded and not is_remote(settings.asked)
        self._shared: SharedPolicy | None = None
        self._lock = threading.Lock()
        self._slots = [_Slot() for _ in range(settings.envs)]
        self._ready: deque[_Slot] = deque()
        self._outbox: queue.SimpleQueue[Answered] = queue.SimpleQueue()
        self._numbers = itertools.count()
        self._stop: BetterError | None = None

    def __enter__(self) -> Self:
        """Return the worker itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()

    @property
    def free(self) -> int:
        """Environments that wait for a trial."""
        return sum(slot.steps is None for slot in self._slots)

    def start(self, trial: Trial) -> None:
        """Take a trial; it is run by :meth:`finished`.

        Args:
            trial: The trial.

        Raises:
            InvalidInputError: If no environment is free.
        """
        for slot in self._slots:
            if slot.steps is None:
                slot.steps = self._trial_runner.steps(trial)
                slot.ticket, slot.outcome, slot.waits, slot.figures = -1, None, False, {}
                self._ready.append(slot)
                return
        raise InvalidInputError("trial", "every environment of the worker is taken", "Ask for `free` first")

    def finished(self, timeout_s: float) -> list[JournalEntry]:
        """Go on with the trials until one has ended, or the time is over.

        Args:
            timeout_s: How long to go on [s]; what is begun is not interrupted.

        Returns:
            The lines for the journal of the trials that have ended.

        Raises:
            PremiseError: If a scene does not show what its instruction presupposes.
            StorageError: If the disk is full.
            PolicyUnavailableError: If the policy's server cannot be reached. The call before has returned the trial
                that noticed it, as an error.
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
        """Drop the trials that have not ended, and close the policy; one that hangs is left to its thread."""
        respondents = []
        for slot in self._slots:
            if slot.steps is not None:
                slot.steps.close()
                slot.steps = None
            if slot.respondent is not None:
                slot.respondent.dismiss()
                respondents.append(slot.respondent)
                slot.respondent = None
                if is_remote(self._setting.asked):
                    respondents[-1].cut()
        until = time.perf_counter() + LEAVE_S
        quiet = all([r.join(until - time.perf_counter()) for r in respondents])  # noqa: C419 - each gets its moment
        self._ready.clear()
        with self._lock:
            shared, self._shared = self._shared, None
        if shared is not None and quiet:
            shared.close()
        self._trial_runner.close()

    def _advance(self, slot: _Slot) -> JournalEntry | None:
        """Go on with one trial until it waits, and return its line for the journal when it has ended."""
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
        self._stop = self._stop or stop
        return replace(entry, wall={**entry.wall, **slot.figures}) if slot.figures else entry

    def _collect(self, timeout_s: float) -> None:
        """Take answers out of the box, waiting for the first one, and note which trials can go on."""
        now = time.perf_counter()
        if self._timed:
            due = [s.asked_at for s in self._slots if s.waits]
            timeout_s = min([timeout_s, *(max(0.0, t + self._setting.policy_timeout_s - now) for t in due)])
        try:
            answered = self._outbox.get(timeout=timeout_s) if timeout_s > 0.0 else self._outbox.get_nowait()
            while True:
                self._note(answered)
                answered = self._outbox.get_nowait()
        except queue.Empty:
            pass
        if self._timed:
            self._give_up_on_the_late()

    def _note(self, answered: Answered) -> None:
        for slot in self._slots:
            if slot.ticket == answered.ticket:
                slot.ticket, slot.outcome = -1, answered.outcome
                slot.figures = answered.figures
                if slot.waits:
                    self._ready.append(slot)
                return
        # The answer to a question of a trial that has ended, or that has given up waiting.

    def _ask(self, slot: _Slot, question: Question) -> None:
        """Put a question to the policy, in the thread of the environment."""
        if slot.respondent is None:
            make = self._share if self._trial_runner.policies.takes_batches else self._trial_runner.policies.take
            counts = is_remote(self._setting.asked)
            slot.respondent = PolicyThread(make, self._outbox, lambda: next(self._numbers), counts=counts)
        slot.question, slot.asked_at, slot.outcome = question, time.perf_counter(), None
        slot.ticket = slot.respondent.ask(question.seen)

    def _share(self) -> Policy:
        """Return the instance that all environments ask, as one of them sees it; called in their threads."""
        with self._lock:
            if self._shared is None:
                taken = self._trial_runner.policies.take()
                if not isinstance(taken, BatchPolicy):
                    raise AssertionError("the policy took batches before")
                self._shared = SharedPolicy(taken, MAX_BATCH)
            return self._shared.seat()

    def _give_up_on_the_late(self) -> None:
        """End the trials whose policy hangs; its thread cannot be ended, so it is left alone and replaced."""
        limit = self._setting.policy_timeout_s
        late = [s for s in self._slots if s.waits and s.ticket >= 0 and time.perf_counter() - s.asked_at > limit]
        for slot in late:
            slot.ticket = -1
            slot.outcome = no_answer(limit)
            self._ready.append(slot)
        if not late:
            return
        hang = self._slots if self._trial_runner.policies.takes_batches else late
        with self._lock:
            shared, self._shared = self._shared, None
        if shared is not None:
            # Closing waits for the call that hangs, if it ever ends.
            threading.Thread(target=shared.close, name="farewell", daemon=True).start()
        for slot in hang:
            if slot.respondent is not None:
                slot.respondent.dismiss()
                slot.respondent = None
            if slot.ticket >= 0 and slot.question is not None:
                self._ask(slot, slot.question)  # it waited behind the batch that hangs
