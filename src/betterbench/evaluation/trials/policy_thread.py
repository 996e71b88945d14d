"""A respondent: the thread in which a policy answers, so that the simulation need not wait for it."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from betterbench.episodes import POLICY_BOUNDARY, Reply, answer
from betterbench.errors import PolicyError
from betterbench.evaluation.trials.policy_factory import close_policy
from betterbench.interface import EpisodeStart, Observation, Policy
from betterbench.state import WorldState


@dataclass(frozen=True, slots=True, eq=False)
class Answered:
    """What came of a question.

    Attributes:
        ticket: Number that :meth:`PolicyThread.ask` gave to the question.
        outcome: The reply, or what was raised instead.
        figures: What the policy counts about its connection since the episode began (retries, reconnects), by name.
    """

    ticket: int
    outcome: Reply | BaseException
    figures: Mapping[str, float]


class PolicyThread:
    """Asks one policy in a thread of its own, question after question.

    The policy is made in that thread when it is first asked, so connecting and loading hold up nobody either.
    """

    def __init__(
        self,
        make: Callable[[], Policy],
        outbox: queue.SimpleQueue[Answered],
        tickets: Callable[[], int],
        *,
        counts: bool,
    ) -> None:
        """Start the thread.

        Args:
            make: Makes the policy; called again at the next question if it fails.
            outbox: Where answers are put.
            tickets: Gives the next number of a question.
            counts: Whether the policy is a client of ours, which counts its requests.
        """
        self._make, self._outbox, self._tickets, self._counts = make, outbox, tickets, counts
        self._policy: Policy | None = None
        self._inbox: queue.SimpleQueue[tuple[int, EpisodeStart | Observation | WorldState] | None]
        self._inbox = queue.SimpleQueue()
        # A daemon: a policy that hangs for ever must not keep the process alive.
        self._thread = threading.Thread(target=self._work, name="respondent", daemon=True)
        self._thread.start()

    def ask(self, seen: EpisodeStart | Observation | WorldState) -> int:
        """Ask, and return the number under which the answer will be put into the outbox.

        Args:
            seen: What the policy is shown.
        """
        ticket = self._tickets()
        self._inbox.put((ticket, seen))
        return ticket

    def dismiss(self) -> None:
        """Let the thread end, and its policy be closed, when it has answered."""
        self._inbox.put(None)

    def cut(self) -> None:
        """Close the policy from outside, which ends its waiting; only a client's connection may be closed so."""
        if self._policy is not None:
            with contextlib.suppress(Exception):
                close_policy(self._policy)

    def join(self, timeout_s: float) -> bool:
        """Wait for the thread of a respondent that was dismissed, and tell whether it has ended.

        Args:
            timeout_s: How long to wait [s]; a call that hangs cannot be ended.
        """
        self._thread.join(max(0.0, timeout_s))
        return not self._thread.is_alive()

    def _work(self) -> None:
        while (item := self._inbox.get()) is not None:
            ticket, seen = item
            outcome: Reply | BaseException
            try:
                if self._policy is None:
                    with POLICY_BOUNDARY:
                        self._policy = self._make()
                outcome = answer(self._policy, seen)
            except BaseException as problem:  # noqa: BLE001 - it is raised again in the thread of the simulation
                outcome = problem
            self._outbox.put(Answered(ticket, outcome, figures_of(self._policy) if self._counts else {}))
        self.cut()


def no_answer(limit_s: float) -> PolicyError:
    """Return the error of a trial whose policy did not answer in time.

    Args:
        limit_s: The deadline [s].
    """
    return PolicyError(f"the policy gave no answer within {limit_s:g} s. Raise --policy-timeout.")


def figures_of(policy: object) -> Mapping[str, float]:
    """Return what a client counts about its connection, by name; empty for a policy that has none."""
    figures = getattr(policy, "figures", None)
    return dict(figures) if isinstance(figures, Mapping) else {}
