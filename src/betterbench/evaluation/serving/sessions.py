"""Sessions of the policy server for policies that use observations. Each connection has its own session."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from betterbench.episodes import POLICY_BOUNDARY
from betterbench.episodes.chunks import checked_chunk
from betterbench.errors import InvalidInputError, PolicyError
from betterbench.interface import EpisodeStart, Policy, episode_number
from betterbench.interface.actions import action_space
from betterbench.policies.conventions.request import Request, read_request

if TYPE_CHECKING:  # so that the host process does not import the tasks
    from betterbench.tasks import TrialId


class PolicySession:
    """Session of a client, for a policy that uses observations."""

    def __init__(
        self, policy: Policy, trial: TrialId | None, *, within: bool = False, on_close: Callable[[], None] | None = None
    ) -> None:
        """Open a session. The policy must belong to this session alone, or answer each observation independently.

        ``trial`` determines the episode number if the client does not send an episode number. ``within`` is True if the
        client is a worker of a run, in which case error messages are written to the records of the run.
        """
        self._policy, self._trial, self._within, self._on_close = policy, trial, within, on_close
        self._counter = Counter()

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the next actions of the policy."""
        request = read_request(message)
        if request.observation is None:
            raise InvalidInputError(
                "the request",
                "the message contains no observation",
                "Send better/joint_positions etc. (preset native), or observation/state (preset openpi_libero)",
            )
        space = self._policy.info.action_space
        number = episode_number(self._trial.seed if self._trial else 0)
        start = request.start or EpisodeStart(request.instruction, number, space)
        check_space(start, space, "the policy")
        step = self._counter.step(request, request.start)
        if self._counter.begins:
            self._policy.reset(start)
        observation = request.observation
        if request.step is None:
            observation = dataclasses.replace(observation, step=step)
        if self._within:
            with POLICY_BOUNDARY:
                actions = checked_chunk(np.asarray(self._policy.act(observation)), action_space(space))
        else:
            actions = np.asarray(self._policy.act(observation))
        if actions.ndim == 1:
            actions = actions[None]
        if actions.ndim != 2 or not len(actions) or actions.dtype.kind not in "fiu":
            raise PolicyError(
                f"expected actions with shape (horizon, dim), got {actions.dtype} with shape {actions.shape}"
            )
        self._counter.answered(step, len(actions))
        return {"actions": np.ascontiguousarray(actions, dtype=np.float64)}

    def close(self) -> None:
        """Close the session by calling the function ``on_close``."""
        if self._on_close is not None:
            self._on_close()


class Counter:
    """Counter of the control steps of a client, which also detects the start of an episode."""

    def __init__(self) -> None:
        self._episode: object = None
        self._next = 0
        self.begins = False

    def step(self, request: Request, episode: object) -> int:
        """Return the control step of a request. Set ``begins`` to True if the request begins an episode, else False.

        ``episode`` is any value that identifies the episode of the request.
        """
        key = (episode, request.instruction)
        self.begins = key != self._episode or request.step == 0
        if self.begins:
            self._episode, self._next = key, 0
        if request.step is not None:
            self._next = request.step
        return self._next

    def answered(self, step: int, count: int) -> None:
        """Note that ``count`` actions were sent, the first for control step ``step``.

        A client that does not send its control step is assumed to execute all of these actions.
        """
        self._next = step + count


def check_space(start: EpisodeStart, space: str, who: str) -> None:
    """Raise InvalidInputError if the client and the served policy have different action spaces.

    ``who`` is the name of the policy in the error message.
    """
    if start.action_space != space:
        raise InvalidInputError(
            "better/episode: action_space",
            f"the client executes {start.action_space!r}, but {who} returns actions in {space!r}",
            f"Evaluate with --action-space {space}",
        )
