"""Requests from an episode to its policy, replies, and handling of policy errors."""

from __future__ import annotations

import time
from types import TracebackType
from typing import NamedTuple

import numpy as np

from betterbench.errors import HandshakeError, PolicyError, described
from betterbench.interface import EpisodeStart, Observation
from betterbench.interface.state import AnyPolicy, WorldState


class Question(NamedTuple):
    """Request from an episode to its policy.

    Requests and replies are named tuples for speed, because they may be created at every control step.

    Attributes:
        seen: Input of the policy: an observation or a privileged state. For the request at the start of an episode,
            which does not ask for actions, the start of the episode.
        wanted_in: Number of control steps that can be executed before the reply is needed. If it is 0, the episode
            waits for the reply.
    """

    seen: EpisodeStart | Observation | WorldState
    wanted_in: int = 0


class Reply(NamedTuple):
    """Reply of a policy to a :class:`Question`.

    Attributes:
        actions: Array that the policy returned, before its shape and type are checked. Empty in the reply to the
            request at the start of an episode.
        took_s: Time from the request to the reply [s].
    """

    actions: np.ndarray
    took_s: float


_NO_ACTIONS = np.empty(0)


def answer(policy: AnyPolicy, seen: EpisodeStart | Observation | WorldState) -> Reply:
    """Send a request to a policy and wait for the reply.

    Raises:
        PolicyError: If the policy raises any exception.
        PolicyUnavailableError: If the policy's server cannot be reached.
        HandshakeError: If the policy's server now serves a different policy.
    """
    began = time.perf_counter()
    try:
        if isinstance(seen, WorldState):
            actions = np.asarray(policy.act_on_state(seen))  # type: ignore[union-attr]
        elif isinstance(seen, EpisodeStart):
            policy.reset(seen)  # type: ignore[union-attr]
            actions = _NO_ACTIONS
        else:
            actions = np.asarray(policy.act(seen))  # type: ignore[union-attr]
    except BaseException:
        # Enter the context only after an error, because this function may be called at every control step and must be
        # fast.
        with POLICY_BOUNDARY:
            raise
    return Reply(actions, time.perf_counter() - began)


class PolicyBoundary:
    """Context manager that converts any exception of a policy to a :class:`PolicyError`.

    A PolicyError ends only the current trial. PolicyUnavailableError and HandshakeError are not converted, because they
    end the whole run. The context manager has no state, so all callers share one instance.
    """

    __slots__ = ()

    def __enter__(self) -> None:
        """Do nothing."""

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Raise a PolicyError if the body of the context has raised an exception."""
        if isinstance(problem, (Exception, SystemExit)) and not isinstance(problem, (PolicyError, HandshakeError)):
            raise PolicyError(described(problem)) from problem


POLICY_BOUNDARY = PolicyBoundary()
"""Shared instance of :class:`PolicyBoundary`."""
