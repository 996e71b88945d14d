"""Exchange between an episode and its policy: requests, replies, and the handling of policy errors."""

from __future__ import annotations

import time
from types import TracebackType
from typing import NamedTuple

import numpy as np

from betterbench.errors import HandshakeError, PolicyError, described
from betterbench.interface import EpisodeStart, Observation
from betterbench.interface.state import AnyPolicy, WorldState


class Question(NamedTuple):
    """Request that an episode makes to its policy.

    Like :class:`Reply`, it is a named tuple for speed, since every control step creates one.

    Attributes:
        seen: Input for which actions are requested, which is an observation or a privileged state. For the request at
            the start of an episode, which asks for no actions, it is the description of the episode.
        wanted_in: Number of control steps that can be executed before the reply is needed. It is 0 if the episode must
            wait for the reply.
    """

    seen: EpisodeStart | Observation | WorldState
    wanted_in: int = 0


class Reply(NamedTuple):
    """Reply of a policy, and the time that the policy took.

    Attributes:
        actions: Array that the policy returned. Its shape and type have not been checked yet. It is empty in the reply
            at the start of an episode.
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
        # For speed, the context is entered only after an error, since a privileged policy is called at every control
        # step.
        with POLICY_BOUNDARY:
            raise
    return Reply(actions, time.perf_counter() - began)


class PolicyBoundary:
    """Context manager that converts an exception of a policy to a :class:`PolicyError`.

    This ends only the current trial. Two errors concern the whole run and are therefore not converted: the policy's
    server cannot be reached, or its conventions have changed. The context manager has no state, so all callers share
    one instance.
    """

    __slots__ = ()

    def __enter__(self) -> None:
        """Do nothing."""

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Raise a PolicyError if the code in this context has raised an exception."""
        if isinstance(problem, (Exception, SystemExit)) and not isinstance(problem, (PolicyError, HandshakeError)):
            raise PolicyError(described(problem)) from problem


POLICY_BOUNDARY = PolicyBoundary()
"""Instance of :class:`PolicyBoundary` that all callers share."""
