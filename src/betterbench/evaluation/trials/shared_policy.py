"""One policy for many connections: all that wait are answered in one batch, under a deadline."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from betterbench.evaluation.trials.policy_factory import close_policy
from betterbench.evaluation.trials.policy_thread import no_answer, ready_at
from betterbench.interface import BatchPolicy, EpisodeStart, Observation, Policy
from betterbench.policies.batching import BatchCollector


@dataclass(frozen=True, slots=True)
class Deadline:
    """The deadline of a policy that the run itself serves."""

    limit_s: float
    """Longest time from question to answer [s]."""
    on_hang: Callable[[], None]
    """Called when it has passed: a call that hangs can only be ended with its process."""


class SharedPolicy:
    """A policy of which there is one for all connections; all that wait are answered in one batch.

    Only one thread calls the policy. A policy that takes no batches gets one observation at a time.
    """

    def __init__(self, policy: Policy, batch: int, *, deadline: Deadline | None = None) -> None:
        """Start the thread; ``batch`` is the largest number of observations in one call."""
        self._policy, self._deadline = policy, deadline
        self._collector: BatchCollector[_Asked, np.ndarray] = BatchCollector(self._answer, limit=batch)

    def seat(self) -> Policy:
        """Return the policy as one connection sees it."""
        return _SharedClient(self._policy, self._collector, self._deadline)

    def close(self, *, timeout_s: float | None = None) -> None:
        """Stop the thread, after at most so many seconds if given, and close the policy unless it still hangs."""
        if self._collector.close(timeout_s=timeout_s):
            close_policy(self._policy)

    def cut(self) -> None:
        """Close the policy while it is asked, which ends the call; only one in a process of its own allows that."""
        close_policy(self._policy)
        self._collector.close(timeout_s=0.0)

    def _answer(self, asked: Sequence[_Asked]) -> Sequence[np.ndarray]:
        for start, _ in asked:
            if start is not None:
                self._policy.reset(start)
        if isinstance(self._policy, BatchPolicy):
            answers = self._policy.act_batch([observation for _, observation in asked])
        else:
            answers = [self._policy.act(observation) for _, observation in asked]
        # A policy may reuse the memory of its answers before other threads have read them.
        return [np.array(answer) for answer in answers]


_Asked = tuple[EpisodeStart | None, Observation]
"""The episode that begins with an observation, if one does, and the observation."""


class _SharedClient:
    """A shared policy as one connection sees it."""

    def __init__(
        self, policy: Policy, collector: BatchCollector[_Asked, np.ndarray], deadline: Deadline | None = None
    ) -> None:
        self.info = policy.info
        self._policy, self._collector, self._deadline = policy, collector, deadline
        self._start: EpisodeStart | None = None

    @property
    def ready_at(self) -> float:
        """Since when the shared policy can be asked, by ``time.perf_counter`` [s]."""
        return ready_at(self._policy)

    def reset(self, start: EpisodeStart) -> None:
        """Note that an episode begins; the policy is reset with the first observation."""
        self._start = start

    def act(self, observation: Observation) -> np.ndarray:
        """Return the answer to one observation."""
        start, self._start = self._start, None
        deadline = self._deadline
        if deadline is None:
            return self._collector.ask((start, observation))
        try:
            return self._collector.ask((start, observation), timeout_s=deadline.limit_s, ready_at=lambda: self.ready_at)
        except TimeoutError:
            deadline.on_hang()
            raise no_answer(deadline.limit_s) from None
