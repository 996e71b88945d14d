"""Choice of the number of environments per worker, based on the throughput measured in a warm-up.

In terms of queueing theory, a worker with n environments is a closed queue. For each action chunk, the worker spends S
seconds, and the reply of the policy takes L seconds. The throughput saturates at (L + S) / S environments, which is
called the knee of the queue. With fewer environments, the worker has to wait. At the knee, random variations of the
times still cost a quarter to a third of the throughput. Therefore, :data:`KNEES` times as many environments are opened,
if a measurement shows that this increases the throughput. If a server processes one request at a time, the throughput
does not increase, because more environments only lengthen the queue of the server. The number of environments does not
affect the records.
"""

from __future__ import annotations

import logging
import math
import statistics
from collections.abc import Callable
from dataclasses import dataclass

logger = logging.getLogger(__name__)

KNEES = 2.5
"""Number of environments to open, as a multiple of the knee."""

LONGEST_QUEUE_S = 10.0
"""Maximum time until the last pending request is answered, if the server processes one request at a time [s].

It is a third of the default deadline of policy servers.
"""

_ANSWERS = 16  # minimum number of answers in a measurement window
_ANSWERS_PER_ENVIRONMENT = 2.0
_WINDOW_S = 0.2
_PRESENT = 0.75  # fraction of environments that must have had an answer before a window begins
_ENOUGH = 1.25  # minimum factor by which the number of environments is increased
_GAIN = 1.2  # minimum ratio of throughputs for the increased number of environments to be kept
_IDLE = 0.15  # if the worker waits for less than this fraction of its time, more environments cannot help
_UNHINDERED = 1.5  # maximum ratio of latency to minimum latency at which the server is assumed to have no queue
_STEP = 3  # maximum factor by which the number is increased at once if the server has a queue
_LEFT_OVER = 1.5  # maximum factor by which the goal is exceeded so that all remaining trials can run at once
_LONGEST_MEMORY = 64  # number of latest latencies from which the median is computed


@dataclass(frozen=True, slots=True)
class Window:
    """Measurements made with a fixed number of environments.

    Attributes:
        envs: Number of environments.
        latency_s: Median latency of a reply [s].
        worker_s: Mean time that the worker spends on an action chunk (physics, images and record) [s].
        rate: Number of replies per second, not counting the time in which trials are set up.
    """

    envs: int
    latency_s: float
    worker_s: float
    rate: float

    @property
    def wanted(self) -> int:
        """Number of environments at which the worker should hardly ever have to wait (:data:`KNEES` times the knee)."""
        return math.ceil(KNEES * (self.latency_s + self.worker_s) / max(self.worker_s, 1e-6))

    @property
    def idle(self) -> float:
        """Fraction of the worker's time that is spent waiting."""
        return max(0.0, 1.0 - self.rate * self.worker_s)


class EnvironmentCount:
    """Controller of the number of environments of a worker.

    The controller begins with ``first`` environments. Requests made before the first reply are ignored, because a
    server may still be compiling its model. Replies after a retry or a reconnection are ignored too. As soon as most
    environments have received a reply, the controller measures the replies in a window of time and chooses a new number
    of environments. A second window shows whether the throughput has improved. If it has not, the previous number is
    restored.
    """

    def __init__(
        self,
        first: int,
        most: int,
        *,
        longest_queue_s: float = LONGEST_QUEUE_S,
        room: Callable[[int], int] = lambda _: 1_000_000,
        left: Callable[[], int] = lambda: 1_000_000,
    ) -> None:
        """Create the controller.

        ``room`` returns the number of environments that fit into memory, given the current number. ``left`` returns the
        number of trials that this worker has not finished yet, including the running ones.
        """
        self.number = first
        self.settled = most <= first
        self._most, self._longest_queue_s = most, longest_queue_s
        self._room, self._left = room, left
        self._first_answer: float | None = None
        self._least_s = math.inf
        self._answered: set[int] = set()  # environments that have received a reply since the number was changed
        self._before: Window | None = None
        self._open_window()

    def _open_window(self) -> None:
        self._began: float | None = None
        self._latencies: list[float] = []
        self._worked_s = self._set_up_s = 0.0
        self._answered = set()

    def worked(self, seconds: float, *, on_setup: bool) -> None:
        """Add the time [s] that the worker has spent on setting up a trial or on an action chunk."""
        if on_setup:
            self._set_up_s += seconds
        else:
            self._worked_s += seconds

    def answered(self, environment: int, *, asked_at: float, now: float, took_s: float, clean: bool) -> None:
        """Add a reply of the policy to an observation.

        Args:
            environment: Index of the environment.
            asked_at: Time of the request [s], on the same clock as ``now``.
            now: Time of the reply [s].
            took_s: Time from the request to the reply [s].
            clean: Whether the reply arrived without a retry and without reconnecting.
        """
        if self.settled:
            return
        if self._first_answer is None:
            self._first_answer = now
            return
        if asked_at < self._first_answer or not clean:
            return
        self._least_s = min(self._least_s, took_s)
        if self._began is None:
            self._answered.add(environment)
            if len(self._answered) >= _PRESENT * self.number:
                self._began, self._worked_s, self._set_up_s = now, 0.0, 0.0
            return
        self._latencies.append(took_s)
        elapsed_s = now - self._began - self._set_up_s
        if len(self._latencies) >= max(_ANSWERS, _ANSWERS_PER_ENVIRONMENT * self.number) and elapsed_s >= _WINDOW_S:
            count = len(self._latencies)
            latency_s = statistics.median(self._latencies[-_LONGEST_MEMORY:])
            self._decide(Window(self.number, latency_s, self._worked_s / count, count / elapsed_s))
            self._open_window()

    def limit(self, most: int) -> None:
        """Limit the number of environments for the rest of the run. Call this if the policy rejects connections."""
        self.number, self._most, self.settled = min(self.number, max(1, most)), max(1, most), True

    def _decide(self, window: Window) -> None:
        before, self._before = self._before, window
        if before is not None and window.rate < _GAIN * before.rate and window.idle > _IDLE:
            # The policy is saturated: the worker still waits, but the number of replies per second has not increased.
            self.number, self.settled = before.envs, True
            return
        goal, left = window.wanted, self._left()
        if window.latency_s > _UNHINDERED * self._least_s:
            goal = min(goal, _STEP * window.envs)  # the server may already have a queue
        if goal < left <= _LEFT_OVER * goal:
            goal = left  # without this, a few trials would be left to run at the end
        goal = min(goal, self._most)
        # If the server processes one request at a time, the latency grows with the number of environments.
        goal = min(goal, int(window.envs * self._longest_queue_s / max(window.latency_s, 1e-6)))
        if goal > window.envs:
            goal = min(goal, self._room(window.envs))
        if goal < _ENOUGH * window.envs:
            self.settled = True
            return
        self.number = goal
        logger.info(
            "an answer takes %.0f ms and this worker spends %.1f ms on a chunk: %d environments instead of %d",
            1e3 * window.latency_s,
            1e3 * window.worker_s,
            goal,
            window.envs,
        )
