"""Exchange between an episode and its policy: questions, replies, and handling of policy errors."""

from __future__ import annotations

import time
from types import TracebackType
from typing import NamedTuple

import numpy as np

from betterbench.errors import HandshakeError, PolicyError, described
from betterbench.interface import EpisodeStart, Observation
from betterbench.interface.state import AnyPolicy, WorldState


class Question(NamedTuple):
    """Input of an episode to its policy.

    Like :class:`Reply`, a named tuple for speed, because every control step creates one.

    Attributes:
        seen: The start of the episode (which requests no actions), an observation, or the privileged state.
        wanted_in: Number of control steps that the episode can take before it needs the reply; 0 if it must wait.
    """

    seen: EpisodeStart | Observation | WorldState
    wanted_in: int = 0


class Reply(NamedTuple):
    """Answer of a policy, with its latency.

    Attributes:
        actions: Answer as an array of any shape and type; empty at the start of an episode.
        took_s: Time from question to answer [s].
    """

    actions: np.ndarray
    took_s: float


_NO_ACTIONS = np.empty(0)


def answer(policy: AnyPolicy, seen: EpisodeStart | Observation | WorldState) -> Reply:
    """Pass an input to a policy and wait for its answer.

    Raises:
        PolicyError: If the policy raises any exception.
        PolicyUnavailableError: If the policy's server cannot be reached.
        HandshakeError: If the policy's server now serves another policy.
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
    """Context manager that turns every exception of a policy into a :class:`PolicyError`, which ends only the trial.

    Two errors that concern the complete run pass unchanged: an unreachable server, and a server whose conventions have
    changed. It has no state, so one instance is enough.
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
"""The shared instance of the boundary."""
