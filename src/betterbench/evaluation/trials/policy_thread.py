"""Thread that calls the policy and waits for its replies, so that the simulation of other trials can continue."""

from __future__ import annotations

import contextlib
import math
import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from betterbench.episodes import POLICY_BOUNDARY, Reply, answer
from betterbench.errors import PolicyError
from betterbench.interface import EpisodeStart, Observation, Policy
from betterbench.interface.state import WorldState
from betterbench.policies.factory import close_policy
from betterbench.policies.process.policy_process import PolicyProcess

if TYPE_CHECKING:  # so that the host process does not import the tasks
    from betterbench.tasks import TrialId


@dataclass(frozen=True, slots=True, eq=False)
class Answered:
    """Outcome of a request to the policy.

    Attributes:
        ticket: Number that :meth:`PolicyThread.ask` returned for the request.
        outcome: Reply or exception. None after a successful :meth:`PolicyThread.connect`.
        figures: Numbers of retries and reconnections since the start of the episode, by name.
        wire_s: CPU time that this process spent on the messages of this request: resizing, packing and sending images,
            and reading the reply [s].
    """

    ticket: int
    outcome: Reply | BaseException | None
    figures: Mapping[str, float]
    wire_s: float = 0.0


class PolicyThread:
    """Thread that sends requests to a policy, one at a time.

    The policy is created in this thread at the first request, so that loading it does not stop the simulation.
    """

    def __init__(
        self,
        make: Callable[[], Policy],
        outbox: queue.SimpleQueue[Answered],
        tickets: Callable[[], int],
        *,
        client: bool,
    ) -> None:
        """Start the thread.

        ``make`` creates the policy. If it fails, it is called again at the next request. ``client`` is True if the
        policy is one of betterbench's own clients of a policy server. The retries of the client are then counted, and
        the client gets the ID of each trial, which it sends only to the server of an expert.
        """
        self._make, self._outbox, self._tickets, self._client = make, outbox, tickets, client
        self._policy: Policy | None = None
        self._made_at = math.inf
        self._inbox: queue.SimpleQueue[
            tuple[int, EpisodeStart | Observation | WorldState | None, TrialId | None] | None
        ]
        self._inbox = queue.SimpleQueue()
        # This is a daemon thread, so that a policy that hangs does not keep the process alive.
        self._thread = threading.Thread(target=self._work, name="policy", daemon=True)
        self._thread.start()

    def ask(self, seen: EpisodeStart | Observation | WorldState, trial: TrialId) -> int:
        """Send a request. Return a ticket, i.e. a number that identifies the reply in the outbox."""
        ticket = self._tickets()
        self._inbox.put((ticket, seen, trial))
        return ticket

    def connect(self) -> int:
        """Create the policy without sending a request. Return a ticket, as :meth:`ask` does."""
        ticket = self._tickets()
        self._inbox.put((ticket, None, None))
        return ticket

    @property
    def ready_at(self) -> float:
        """Time at which the policy is ready [s], as measured by ``time.perf_counter``.

        Infinite until the policy is loaded.
        """
        return max(self._made_at, ready_at(self._policy))

    def distrust(self) -> None:
        """Let the policy use a new process for the next episode, because a trial has failed.

        For a policy that does not run in a separate process, do nothing.
        """
        if isinstance(self._policy, PolicyProcess):
            self._policy.distrust()

    def dismiss(self) -> None:
        """End the thread after the current request, and close the policy."""
        self._inbox.put(None)

    def cut(self) -> None:
        """Close the policy from another thread, to end the current request.

        Only betterbench's own clients and policies in separate processes support this.
        """
        if self._policy is not None:
            with contextlib.suppress(Exception):
                close_policy(self._policy)

    def join(self, timeout_s: float) -> bool:
        """After :meth:`dismiss`, wait up to ``timeout_s`` [s] for the thread. Return whether it has ended."""
        self._thread.join(max(0.0, timeout_s))
        return not self._thread.is_alive()

    def _work(self) -> None:
        while (item := self._inbox.get()) is not None:
            ticket, seen, trial = item
            outcome: Reply | BaseException | None = None
            spent_s = time.thread_time() + shared_cost_s(self._policy)
            try:
                if self._policy is None:
                    with POLICY_BOUNDARY:
                        self._policy = self._make()
                    self._made_at = time.perf_counter()
                if self._client and isinstance(seen, EpisodeStart) and trial is not None:
                    name_trial(self._policy, trial)
                if seen is not None:
                    outcome = answer(self._policy, seen)
            except BaseException as problem:  # noqa: BLE001 - it is raised again in the thread of the simulation
                outcome = problem
            spent_s = max(0.0, time.thread_time() + shared_cost_s(self._policy) - spent_s)
            self._outbox.put(Answered(ticket, outcome, figures_of(self._policy) if self._client else {}, spent_s))
        self.cut()


def name_trial(client: object, trial: TrialId) -> None:
    """Pass the ID of the next trial to a client of a policy server, if the client has a method ``name_trial``.

    Use this only for betterbench's own clients, not for a user's policy.
    """
    told = getattr(client, "name_trial", None)
    if callable(told):
        told(trial)


def ready_at(policy: object) -> float:
    """Return the time at which a policy in a separate process became ready [s], or -inf for other policies."""
    told = getattr(policy, "ready_at", None)
    return told if isinstance(told, float) else -math.inf


def shared_cost_s(policy: object) -> float:
    """Return the CPU time that the thread of a shared policy has spent on this connection's messages [s].

    The result is 0 for other policies.
    """
    cost = getattr(policy, "cost_s", 0.0)
    return cost if isinstance(cost, float) else 0.0


def no_answer(limit_s: float) -> PolicyError:
    """Return the error for a policy that did not answer within ``limit_s`` [s]."""
    return PolicyError(f"the policy did not answer within {limit_s:g} s. Raise --policy-timeout.")


def figures_of(policy: object) -> Mapping[str, float]:
    """Return the numbers of retries and reconnections of a client, by name.

    The result is empty for a policy without a connection.
    """
    figures = getattr(policy, "figures", None)
    return dict(figures) if isinstance(figures, Mapping) else {}
