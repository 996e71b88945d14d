"""Exchange between an episode and its policy: requests, replies, and handling of policy errors."""

from __future__ import annotations

import time
from types import TracebackType
from typing import NamedTuple

import numpy as np

from betterbench.errors import HandshakeError, PolicyError, described
from betterbench.interface import EpisodeStart, Observation
from betterbench.interface.state import AnyPolicy, WorldState


class Question(NamedTuple):
    """Request of an episode to its policy.

    This is a named tuple for speed, like :class:`Reply`, because every control step creates one.

    Attributes:
        seen: Start of the episode (no actions are requested), observation, or privileged state.
        wanted_in: Number of control steps that can be executed before the reply is needed; 0 if the episode must wait.
    """

    seen: EpisodeStart | Observation | WorldState
    wanted_in: int = 0


class Reply(NamedTuple):
    """Reply of a policy, with its latency.

    Attributes:
        actions: Reply as an unchecked array of any shape and type; empty at the start of an episode.
        took_s: Time from request to reply [s].
    """

    actions: np.ndarray
    took_s: float


_NO_ACTIONS = np.empty(0)


def answer(policy: AnyPolicy, seen: EpisodeStart | Observation | WorldState) -> Reply:
    """Send a request to a policy and wait for its reply.

    Raises:
        PolicyError: If the policy raises any exception.
        PolicyUnavailableError: If the policy's server cannot be reached.
        HandshakeError: If the server now serves a different policy.
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
        # the code above is repeated here for speed, because a privileged policy answers at every control step
        with POLICY_BOUNDARY:
            raise
    return Reply(actions, time.perf_counter() - began)


class PolicyBoundary:
    """Context manager that converts exceptions of a policy into a :class:`PolicyError`. It ends only this trial.

    Two errors that affect the whole run are not converted: an unreachable server, and changed conventions of a server.
    The context manager has no state, so one instance is shared.
    """

    __slots__ = ()

    def __enter__(self) -> None:
        """Do nothing."""

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Raise PolicyError if the policy failed."""
        if isinstance(problem, (Exception, SystemExit)) and not isinstance(problem, (PolicyError, HandshakeError)):
            raise PolicyError(described(problem)) from problem


POLICY_BOUNDARY = PolicyBoundary()
"""Shared instance of :class:`PolicyBoundary`."""
