"""A policy that the caller of an evaluation has made, asked in this process."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.interface import EpisodeStart, Observation, Policy, PolicyInfo
from betterbench.interface.policy import require_policy
from betterbench.policies import source_of
from betterbench.policies.kinds.factory import SOURCE, PolicyFactory, is_remote, needs_no_thread, runs_apart


class GivenPolicy(PolicyFactory):
    """Factory of one instance that exists already, under the name that it declares.

    The instance answers one observation at a time, also if it takes batches. The caller closes it.
    """

    def __init__(self, policy: Policy) -> None:
        """Check the instance.

        Raises:
            InvalidInputError: If it is no policy, or has the name of a built-in policy or of a server.
        """
        require_policy(policy, "policy")
        name = policy.info.name
        if not name or needs_no_thread(name) or is_remote(name) or runs_apart(name):
            problem = f"the name {name!r} is an address of betterbench" if name else "its name is empty"
            raise InvalidInputError(
                "policy", problem, "Give its PolicyInfo another name, or pass the address as a text"
            )
        super().__init__(name)
        self._policy = policy
        made, info = type(policy), policy.info
        source = source_of(f"{made.__module__}:{made.__qualname__}")  # a resumed run compares it
        self._info = replace(info, metadata={**info.metadata, SOURCE: source}) if source else info

    def _make(self) -> Policy:
        return _Lent(self._policy)


class _Lent:
    """View of a policy without its ``close``."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    @property
    def info(self) -> PolicyInfo:
        return self._policy.info

    def reset(self, start: EpisodeStart) -> None:
        self._policy.reset(start)

    def act(self, observation: Observation) -> np.ndarray:
        return self._policy.act(observation)
