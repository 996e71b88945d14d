"""Policy that several connections share. It processes their requests in batches, and each request has a deadline."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from betterbench.evaluation.trials.policy_thread import figures_of, no_answer, ready_at
from betterbench.interface import BatchPolicy, EpisodeStart, Observation, Policy
from betterbench.policies.batching import BatchCollector
from betterbench.policies.factory import close_policy

POLICY_TIMEOUT_S = 300.0
"""Default time limit for a reply of a policy in this process [s]."""


@dataclass(frozen=True, slots=True)
class Deadline:
    """Time limit for the replies of a policy that the run itself serves, and a function to call if it is exceeded."""

    limit_s: float
    """Maximum time from a request to the reply [s]."""
    on_hang: Callable[[], None]
    """Function that is called when the time limit is exceeded.

    It usually ends the process, because a call that hangs cannot be ended in any other way.
    """


class SharedPolicy:
    """Policy that all connections share. It processes pending requests together in one batch.

    A single thread calls the policy. A policy that does not support batches gets one observation at a time.
    """

    def __init__(
        self,
        policy: Policy,
        batch: int,
        *,
        deadline: Deadline | None = None,
        expected: Callable[[], int] = lambda: 0,
        client: bool = False,
    ) -> None:
        """Start the thread.

        ``batch`` is the maximum number of observations in one call. ``expected`` returns the number of requests that
        may be pending at the same time, as in :class:`~betterbench.policies.batching.BatchCollector`. ``client`` is
        True if the policy is one of betterbench's own clients of a policy server, whose retries are then counted.
        """
        self._policy, self._deadline, self._client = policy, deadline, client
        self._collector: BatchCollector[_Asked, _Given] = BatchCollector(self._answer, limit=batch, expected=expected)

    def seat(self) -> Policy:
        """Return a policy object for one connection, which passes its requests on to the shared policy."""
        return _SharedClient(self._policy, self._collector, self._deadline)

    def close(self, *, timeout_s: float | None = None) -> None:
        """Stop the thread. Close the policy as well, unless it hangs.

        If ``timeout_s`` [s] is given, wait at most this long.
        """
        if self._collector.close(timeout_s=timeout_s):
            close_policy(self._policy)

    def cut(self) -> None:
        """Close the policy during a call, to end the call.

        Only a policy in a separate process supports this.
        """
        close_policy(self._policy)
        self._collector.close(timeout_s=0.0)

    def _answer(self, asked: Sequence[_Asked]) -> Sequence[_Given]:
        began, before = time.thread_time(), self._figures()
        try:
            for question in asked:
                if question.start is not None:
                    self._policy.reset(question.start)
            if isinstance(self._policy, BatchPolicy):
                answers = self._policy.act_batch([question.observation for question in asked])
            else:
                answers = [self._policy.act(question.observation) for question in asked]
        finally:
            for name, count in self._figures().items():
                for question in asked:
                    figures = question.asker.figures
                    figures[name] = figures.get(name, 0.0) + count - before.get(name, 0.0)
        # The answers are copied, because a policy may overwrite the array before other threads have read it.
        copies = [np.array(answer) for answer in answers]
        cost_s = (time.thread_time() - began) / max(1, len(asked))
        return [_Given(actions, cost_s) for actions in copies]

    def _figures(self) -> Mapping[str, float]:
        return figures_of(self._policy) if self._client else {}


@dataclass(frozen=True, slots=True, eq=False)
class _Given:
    """Reply to one request, with the part of the batch's CPU time [s] that is attributed to this request."""

    actions: np.ndarray
    cost_s: float


class _Asked(NamedTuple):
    """Request to the policy: the start of a new episode (or None), the observation, and the object that asks."""

    start: EpisodeStart | None
    observation: Observation
    asker: _SharedClient


class _SharedClient:
    """Policy object of one connection, which passes requests on to the shared policy."""

    def __init__(
        self, policy: Policy, collector: BatchCollector[_Asked, _Given], deadline: Deadline | None = None
    ) -> None:
        self.info = policy.info
        self._policy, self._collector, self._deadline = policy, collector, deadline
        self._start: EpisodeStart | None = None
        self.cost_s = 0.0
        """CPU time spent on the requests of this connection so far [s].

        The time of a batch is divided equally among its requests.
        """
        self.figures: dict[str, float] = {}
        """Numbers of requests, retries and reconnects in this episode, by name.

        Those of a batch count for each of its requests.
        """

    @property
    def ready_at(self) -> float:
        """Time at which the shared policy became ready [s], as measured by ``time.perf_counter``."""
        return ready_at(self._policy)

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode. The policy itself is reset when it gets the first observation."""
        self._start, self.figures = start, {}

    def act(self, observation: Observation) -> np.ndarray:
        """Return the actions for an observation."""
        start, self._start = self._start, None
        deadline = self._deadline
        try:
            given = self._collector.ask(
                _Asked(start, observation, self),
                timeout_s=None if deadline is None else deadline.limit_s,
                ready_at=lambda: self.ready_at,
            )
        except TimeoutError:
            if deadline is None:
                raise  # the policy itself has a deadline
            deadline.on_hang()
            raise no_answer(deadline.limit_s) from None
        self.cost_s += given.cost_s
        return given.actions
