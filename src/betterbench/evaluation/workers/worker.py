"""Worker that simulates and renders many trials in one thread, while policies run in other threads."""

from __future__ import annotations

import itertools
import logging
import math
import os
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Self

from betterbench.episodes import Question, Reply
from betterbench.errors import BetterError, HandshakeError, InvalidInputError, PolicyUnavailableError, one_line
from betterbench.evaluation.trials.policy_thread import Answered, PolicyThread, no_answer
from betterbench.evaluation.trials.shared_policy import SharedPolicy
from betterbench.evaluation.trials.trial import TrialRunner, TrialSteps, WorkerSettings
from betterbench.evaluation.workers.environment_count import LONGEST_QUEUE_S, EnvironmentCount
from betterbench.evaluation.workers.memory import room_for, used_bytes
from betterbench.interface import BatchPolicy, Observation, Policy
from betterbench.policies.batching import MAX_BATCH
from betterbench.policies.factory import PolicyFactory
from betterbench.records import JournalEntry
from betterbench.sim.worlds import OWN_WORLD, World
from betterbench.tasks import TrialId
from betterbench.tasks.trial import Trial

logger = logging.getLogger(__name__)

USUAL_ENVS = 8
"""Initial number of environments per worker for a policy in another process.

While some environments wait for the policy, others are simulated. A warm-up then chooses a better number
(:mod:`betterbench.evaluation.workers.environment_count`).
"""

MOST_WAITING = 32
"""Maximum initial number of environments of all workers together.

A server that takes 0.3 s per request and processes one request at a time then needs 10 s to answer one request of every
environment, which is less than the deadline.
"""

MOST_CHOSEN = 96
"""Maximum number of environments of all workers that a warm-up may choose. ``better serve`` accepts 128 connections."""

MAX_ENVS = 256

_DISTURBED = ("policy_retries", "policy_reconnects")

LEAVE_S = 2.0
"""Maximum time to wait for the policy threads to end [s]."""


def usual_envs(policies: PolicyFactory) -> int:
    """Return the default number of environments of a worker.

    The number is 1 for a policy that replies immediately, and for a Python policy that processes one observation at a
    time, because each environment would need its own instance of the policy, possibly with large weights.
    """
    needs = policies.needs
    if not needs.thread:
        return 1
    return USUAL_ENVS if needs.server or policies.takes_batches else 1


def fair_envs(envs: int, workers: int) -> int:
    """Return the initial number of environments per worker: ``envs``, or fewer if there are many workers."""
    return max(1, min(envs, MOST_WAITING // workers))


def envs_between(envs: int, workers: int, *, world: World = OWN_WORLD) -> tuple[int, int]:
    """Return the smallest and the largest number of environments per worker that a warm-up may choose.

    ``envs`` is the default number for a single worker, which the benchmark ``world`` may reduce. For a policy that
    needs one instance per environment, the number is always 1, because instances may be large.
    """
    if envs == 1:
        return 1, 1
    first = fair_envs(world.environments(envs), workers)
    return first, max(first, min(MAX_ENVS, MOST_CHOSEN // workers))


def even_share(left: int, workers: int, envs: int) -> int:
    """Return the number of trials that a worker gets at once, so that all workers finish at about the same time.

    Trials that begin together end at about the same time. For example, twelve trials for a worker with eight
    environments are therefore divided into six and six instead of eight and four. ``left`` is the number of trials that
    have not ended, including the running trials.
    """
    share = math.ceil(left / workers)
    return math.ceil(share / math.ceil(share / envs)) if share else 0


@dataclass(slots=True, eq=False)
class _Slot:
    """Environment of a worker, with the trial that it runs and the pending request to the policy."""

    thread: PolicyThread | None = None
    trial: TrialId | None = None
    steps: TrialSteps | None = None
    ticket: int = -1  # ticket of the pending request, or -1
    asked_at: float = 0.0
    question: Question | None = None  # last request of the trial
    outcome: Reply | BaseException | None = None  # outcome of the last request, until the trial uses it
    waits: bool = False  # whether the trial cannot continue before the outcome arrives
    figures: Mapping[str, float] = field(default_factory=dict)  # numbers of retries and reconnections
    wire_s: float = 0.0  # CPU time spent on messages of the trial
    connecting: bool = False  # whether the environment is new and waits for the connection of its policy


class Worker:
    """Worker that runs several trials of a plan concurrently.

    Physics and rendering run in the calling thread, which switches between the trials, and the policy runs in other
    threads. The order in which the trials are continued does not affect the results, because every trial depends only
    on its scene and its policy. If the worker is used in a ``with`` block, it is closed at the end of the block.
    """

    def __init__(
        self,
        settings: WorkerSettings,
        *,
        policies: PolicyFactory | None = None,
        on_step: Callable[[int], None] | None = None,
    ) -> None:
        """Create the environments.

        ``policies`` is the policy factory, which the worker closes. If it is None, the worker creates a factory.
        ``on_step`` is called after every control step of any trial.
        """
        if not 1 <= settings.envs <= MAX_ENVS:
            raise InvalidInputError("--envs", f"{settings.envs} is out of range", f"Use a number from 1 to {MAX_ENVS}")
        self._settings = settings
        self._trial_runner = TrialRunner(settings, policies=policies, on_step=on_step)
        needs = self._trial_runner.policies.needs
        self._threaded = needs.thread
        self._timed = needs.thread and not needs.server
        # If the policy is in another process, a pending request can be interrupted when the worker is closed.
        self._cuts = needs.server or needs.process
        self._shared: SharedPolicy | None = None
        self._lock = threading.Lock()
        self._slots = [_Slot() for _ in range(settings.envs)]
        self._idle_s = 0.0  # time spent waiting since the last trial ended
        self._ended = 0  # number of trials that have ended
        used = used_bytes() if settings.most_envs > settings.envs else 0
        self._count = EnvironmentCount(
            settings.envs,
            max(settings.envs, settings.most_envs),
            longest_queue_s=min(LONGEST_QUEUE_S, settings.answer_limit_s / 3.0),
            room=lambda envs: room_for(envs, used_before=used, sharing=min(settings.workers, os.cpu_count() or 1)),
            left=lambda: math.ceil(settings.trials / settings.workers) - self._ended,
        )
        self._ready: deque[_Slot] = deque()
        self._outbox: queue.SimpleQueue[Answered] = queue.SimpleQueue()
        self._numbers = itertools.count()
        self._stop: BetterError | None = None
        self._leaving: list[PolicyThread] = []  # threads of environments that were closed

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def envs(self) -> int:
        """Number of environments, which is either fixed or chosen by the warm-up."""
        return self._count.number

    @property
    def busy(self) -> bool:
        """Whether at least one trial is running."""
        return any(slot.steps is not None for slot in self._slots)

    @property
    def free(self) -> int:
        """Number of environments that are free for a new trial."""
        return sum(slot.steps is None and not slot.connecting for slot in self._slots)

    @property
    def problem(self) -> BetterError | None:
        """Error that the next call of :meth:`finished` will raise, or None.

        A caller that has no more trials should check it, because it does not call :meth:`finished` again.
        """
        return self._stop

    def _open_trials(self) -> int:
        return sum(slot.steps is not None for slot in self._slots)

    def start(self, trial: Trial) -> None:
        """Assign a trial to a free environment. The trial is run by :meth:`finished`.

        Raises:
            InvalidInputError: If no environment is free.
        """
        for slot in self._slots:
            if slot.steps is None and not slot.connecting:
                slot.steps, slot.trial = self._trial_runner.steps(trial), trial.id
                slot.ticket, slot.outcome, slot.waits, slot.figures, slot.wire_s = -1, None, False, {}, 0.0
                slot.question = None
                self._ready.append(slot)
                return
        raise InvalidInputError("trial", "no environment of the worker is free", "Check the attribute `free` first")

    def finished(self, timeout_s: float) -> list[JournalEntry]:
        """Run the trials until at least one has ended or ``timeout_s`` [s] has passed. Return the journal entries.

        Raises:
            PremiseError: If a scene violates an assumption of its instruction.
            StorageError: If the disk is full.
            PolicyUnavailableError: If the policy's server cannot be reached. The previous call has already returned the
                journal entry of the trial.
            HandshakeError: If the policy has changed. The previous call has already returned the journal entry of the
                trial.
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
                now = time.perf_counter()
                if until <= now or not self.busy:
                    break
                self._collect(until - now)
                self._idle_s += time.perf_counter() - now
            if time.perf_counter() >= until:
                break
        return ended

    def close(self) -> None:
        """Abandon the trials that have not ended. Close the policy, unless it hangs."""
        threads, self._leaving = self._leaving, []
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
        """Continue a trial until it has to wait. Return its journal entry if it has ended."""
        steps = slot.steps
        if steps is None:
            return None
        given, slot.outcome, slot.waits = slot.outcome, None, False
        began, on_setup = time.perf_counter(), slot.question is None
        try:
            return self._advance_steps(slot, steps, given)
        finally:
            self._count.worked(time.perf_counter() - began, on_setup=on_setup)
            self._resize()

    def _advance_steps(
        self, slot: _Slot, steps: TrialSteps, given: Reply | BaseException | None
    ) -> JournalEntry | None:
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
        self._ended += 1
        if entry.message is not None and slot.thread is not None:
            slot.thread.distrust()  # the policy's process cannot detect errors such as a wrong shape
        self._stop = self._stop or stop
        if not self._threaded:
            return entry
        idle_s, self._idle_s = self._idle_s, 0.0
        loop = {"wire_s": round(slot.wire_s, 6), "idle_s": round(idle_s, 6), "envs": float(self.envs)}
        return replace(entry, wall={**entry.wall, **slot.figures, **loop})

    def _resize(self) -> None:
        """Open or close environments to reach the chosen number."""
        surplus = len(self._slots) - self._count.number
        if surplus > 0:
            for slot in [s for s in self._slots if s.steps is None and not s.connecting][:surplus]:
                self._slots.remove(slot)
                if slot.thread is not None:
                    slot.thread.dismiss()
                    self._leaving.append(slot.thread)
        for _ in range(-surplus):
            slot = _Slot(connecting=True)
            self._slots.append(slot)
            slot.thread = self._new_thread()
            slot.ticket = slot.thread.connect()

    def _connected(self, slot: _Slot, outcome: Reply | BaseException | None) -> None:
        """Start using a new environment or, if the policy rejected its connection, limit the number of environments."""
        slot.connecting = False
        if isinstance(outcome, BaseException):
            logger.warning(
                "the policy accepts no further connection (%s); this worker continues with its existing connections",
                one_line(str(outcome)),
            )
            self._slots.remove(slot)
            if slot.thread is not None:
                slot.thread.dismiss()
                self._leaving.append(slot.thread)
            self._count.limit(sum(not s.connecting for s in self._slots))

    def _collect(self, timeout_s: float) -> None:
        """Wait for a reply. Then take all replies that have arrived, and mark the trials that can continue."""
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
                slot.ticket = -1
                if slot.connecting:
                    self._connected(slot, answered.outcome)
                    return
                clean = not any(answered.figures.get(k, 0.0) > slot.figures.get(k, 0.0) for k in _DISTURBED)
                slot.outcome, slot.figures = answered.outcome, answered.figures
                slot.wire_s += answered.wire_s
                if slot.question is not None and isinstance(slot.question.seen, Observation):
                    self._count_answer(slot, answered.outcome, clean=clean)
                if slot.waits:
                    self._ready.append(slot)
                return
        # If no environment matches, the trial has ended or the deadline has passed, so the reply is ignored.

    def _count_answer(self, slot: _Slot, outcome: Reply | BaseException | None, *, clean: bool) -> None:
        if isinstance(outcome, Reply):
            self._count.answered(
                id(slot), asked_at=slot.asked_at, now=time.perf_counter(), took_s=outcome.took_s, clean=clean
            )

    def _ask(self, slot: _Slot, question: Question) -> None:
        """Send a request to the policy. The thread of the environment waits for the reply."""
        if slot.trial is None:
            raise AssertionError("unreachable: only a trial makes requests")
        if slot.thread is None:
            slot.thread = self._new_thread()
        slot.question, slot.asked_at, slot.outcome = question, time.perf_counter(), None
        slot.ticket = slot.thread.ask(question.seen, slot.trial)

    def _new_thread(self) -> PolicyThread:
        make = self._share if self._trial_runner.policies.takes_batches else self._trial_runner.policies.take
        client = self._trial_runner.policies.needs.server
        return PolicyThread(make, self._outbox, lambda: next(self._numbers), client=client)

    def _share(self) -> Policy:
        """Return a policy object for one environment that uses the shared instance.

        Each environment calls this method in its own thread.
        """
        with self._lock:
            if self._shared is None:
                taken = self._trial_runner.policies.take()
                if not isinstance(taken, BatchPolicy):
                    raise AssertionError("unreachable: the policy accepted batches before")
                self._shared = SharedPolicy(
                    taken,
                    MAX_BATCH,
                    expected=self._open_trials,
                    client=self._trial_runner.policies.needs.server,
                )
            return self._shared.seat()

    def _due(self, slot: _Slot) -> float:
        """Return the deadline of a request [s], as measured by ``time.perf_counter``.

        The time for loading the policy is not included, because there is a separate deadline for loading.
        """
        ready_at = -math.inf if slot.thread is None else slot.thread.ready_at
        return max(slot.asked_at, ready_at) + self._settings.policy_timeout_s

    def _end_overdue(self) -> None:
        """End the trials for which the policy has missed the deadline, and replace the policy's process and thread."""
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
            shared.cut()  # ends the call that hangs
        for slot in hang:
            if slot.thread is not None:
                slot.thread.dismiss()
                slot.thread.cut()
                slot.thread = None
            if slot.ticket >= 0 and slot.question is not None:
                self._ask(slot, slot.question)  # send the request again, which was waiting for the batch that hangs
