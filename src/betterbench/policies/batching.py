"""Gathering: what several callers ask at the same time is answered in one call."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

Question = TypeVar("Question")
Answer = TypeVar("Answer")

MAX_BATCH = 16
"""Questions that one call answers at most, unless another number is asked for."""


@dataclass
class _Ticket(Generic[Question, Answer]):
    """One question on its way."""

    question: Question
    done: threading.Event = field(default_factory=threading.Event)
    answer: Answer | None = None
    problem: BaseException | None = None


class BatchCollector(Generic[Question, Answer]):
    """Answers the questions of many threads in one thread, all that wait at a moment together.

    Nothing waits for company: while one call is under way the next questions gather by themselves, so a busy policy
    gets large batches and an idle one answers at once. Where a batch fails its questions are asked one by one, so that
    a caller sees the fault of its own question only.
    """

    def __init__(self, answer: Callable[[Sequence[Question]], Sequence[Answer]], *, limit: int = MAX_BATCH) -> None:
        """Start the thread."""
        self._answer, self._limit = answer, max(1, limit)
        self._waiting: queue.SimpleQueue[_Ticket[Question, Answer] | None] = queue.SimpleQueue()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="collector", daemon=True)
        self._thread.start()

    def ask(self, question: Question, *, timeout_s: float | None = None) -> Answer:
        """Return the answer to a question; what the answering function raised for it is raised here.

        Args:
            question: The question.
            timeout_s: How long it may take [s], the wait behind other questions included; None for as long as it takes.

        Raises:
            TimeoutError: If no answer came in time. The call that answers cannot be ended.
            RuntimeError: If the collector is closed.
        """
        if self._closed:
            raise RuntimeError("the policy is being shut down")
        ticket: _Ticket[Question, Answer] = _Ticket(question)
        self._waiting.put(ticket)
        until = math.inf if timeout_s is None else time.monotonic() + timeout_s
        while not ticket.done.wait(min(1.0, max(0.0, until - time.monotonic()))):
            if not self._thread.is_alive():
                raise RuntimeError("the policy has been shut down")
            if time.monotonic() >= until:
                raise TimeoutError
        if ticket.problem is not None:
            raise ticket.problem
        return ticket.answer  # type: ignore[return-value]

    def close(self, *, timeout_s: float | None = None) -> bool:
        """Answer what waits, then end the thread.

        Args:
            timeout_s: How long to wait for that [s]; None for as long as it takes.

        Returns:
            Whether the thread has ended; a call that hangs cannot be ended.
        """
        self._closed = True
        self._waiting.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        while True:
            tickets = [self._waiting.get()]
            while len(tickets) < self._limit:
                try:
                    tickets.append(self._waiting.get_nowait())
                except queue.Empty:
                    break
            asked = [t for t in tickets if t is not None]
            if asked:
                self._serve(asked)
            if len(asked) < len(tickets):
                return

    def _serve(self, tickets: list[_Ticket[Question, Answer]]) -> None:
        try:
            answers = list(self._answer([t.question for t in tickets]))
            if len(answers) != len(tickets):
                raise ValueError(f"the policy gave {len(answers)} answers to {len(tickets)} observations")  # noqa: TRY301
        except BaseException as problem:  # noqa: BLE001 - it is raised again in the thread that asked
            if len(tickets) > 1:
                for ticket in tickets:
                    self._serve([ticket])
                return
            tickets[0].problem = problem
        else:
            for ticket, answer in zip(tickets, answers, strict=True):
                ticket.answer = answer
        for ticket in tickets:
            ticket.done.set()
