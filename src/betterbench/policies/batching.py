"""Batching of policy calls: one call answers all requests that several threads make at the same time."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

QuestionT = TypeVar("QuestionT")
AnswerT = TypeVar("AnswerT")

MAX_BATCH = 16
"""Default for the maximum number of requests answered in one call."""

_PAUSE_S = 0.01  # interval at which a waiting call checks whether further requests are still expected


@dataclass
class _PendingQuestion(Generic[QuestionT, AnswerT]):
    """Pending request of one thread, together with the answer to it or the exception that the request caused."""

    question: QuestionT
    done: threading.Event = field(default_factory=threading.Event)
    answer: AnswerT | None = None
    problem: BaseException | None = None


class BatchCollector(Generic[QuestionT, AnswerT]):
    """Collector of requests from many threads. One separate thread answers the requests in batches.

    Requests that arrive during a call form the next batch, so a busy policy gets large batches, and an idle policy
    answers immediately. If further requests are expected, the collector waits for them before the next call, but no
    longer than the shortest call so far has taken. Without this wait, two groups of callers could take turns forever,
    so that each batch contains only one of the groups. If a batch fails, the requests in it are sent again one by one,
    so that each caller gets only the error caused by its own request.
    """

    def __init__(
        self,
        answer: Callable[[Sequence[QuestionT]], Sequence[AnswerT]],
        *,
        limit: int = MAX_BATCH,
        expected: Callable[[], int] = lambda: 0,
    ) -> None:
        """Start the thread that calls ``answer``.

        ``expected`` returns how many requests may be pending at the same time, including those already received. It is
        called in this new thread.
        """
        self._answer, self._limit, self._expected = answer, max(1, limit), expected
        self._shortest_s = math.inf  # duration of the shortest call
        self._waiting: queue.SimpleQueue[_PendingQuestion[QuestionT, AnswerT] | None] = queue.SimpleQueue()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="collector", daemon=True)
        self._thread.start()

    def ask(
        self,
        question: QuestionT,
        *,
        timeout_s: float | None = None,
        ready_at: Callable[[], float] = lambda: -math.inf,
    ) -> AnswerT:
        """Return the answer to a request, or raise the exception that ``answer`` raised for it.

        The timeout [s] includes the time that the request waits in the queue. If ``ready_at`` returns a time after this
        call (as measured by ``time.perf_counter``), the timeout starts at that time. Raises TimeoutError if no answer
        arrives in time, although the call of ``answer`` itself continues. Raises RuntimeError if the collector is
        closed.
        """
        if self._closed:
            raise RuntimeError("the policy is being shut down")
        pending: _PendingQuestion[QuestionT, AnswerT] = _PendingQuestion(question)
        self._waiting.put(pending)
        began = time.perf_counter()

        def left_s() -> float:
            return math.inf if timeout_s is None else max(began, ready_at()) + timeout_s - time.perf_counter()

        while not pending.done.wait(min(1.0, max(0.0, left_s()))):
            if not self._thread.is_alive():
                raise RuntimeError("the policy has been shut down")
            if left_s() <= 0.0:
                raise TimeoutError
        if pending.problem is not None:
            raise pending.problem
        return pending.answer  # type: ignore[return-value]

    def close(self, *, timeout_s: float | None = None) -> bool:
        """Answer the pending requests, then end the thread.

        Return whether the thread has ended within the timeout. A call that hangs is not interrupted.
        """
        self._closed = True
        self._waiting.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        while True:
            waiting = self._gathered()
            asked = [t for t in waiting if t is not None]
            if asked:
                began = time.perf_counter()
                self._serve(asked)
                self._shortest_s = min(self._shortest_s, time.perf_counter() - began)
            if len(asked) < len(waiting):
                return

    def _gathered(self) -> list[_PendingQuestion[QuestionT, AnswerT] | None]:
        """Wait for requests, and return those that the next call answers.

        If the collector has been closed, the last element of the list is None.
        """
        waiting = [self._waiting.get()]
        until = time.perf_counter() + (self._shortest_s if math.isfinite(self._shortest_s) else 0.0)
        while len(waiting) < self._limit and waiting[-1] is not None:
            left_s = until - time.perf_counter() if len(waiting) < self._expected() else 0.0
            try:
                # The expected number can decrease while waiting, so it is read again in each round.
                waiting.append(
                    self._waiting.get(timeout=min(left_s, _PAUSE_S)) if left_s > 0.0 else self._waiting.get_nowait()
                )
            except queue.Empty:
                if left_s <= 0.0:
                    break
        return waiting

    def _serve(self, waiting: list[_PendingQuestion[QuestionT, AnswerT]]) -> None:
        try:
            answers = list(self._answer([t.question for t in waiting]))
            if len(answers) != len(waiting):
                raise ValueError(f"the policy returned {len(answers)} answers to {len(waiting)} observations")  # noqa: TRY301
        except BaseException as problem:  # noqa: BLE001 - it is raised again in the thread that asked
            if len(waiting) > 1:
                for pending in waiting:
                    self._serve([pending])
                return
            waiting[0].problem = problem
        else:
            for pending, answer in zip(waiting, answers, strict=True):
                pending.answer = answer
        for pending in waiting:
            pending.done.set()
