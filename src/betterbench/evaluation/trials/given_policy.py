"""Evaluation of a policy instance that the caller passes, in this process."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.interface import EpisodeStart, Observation, Policy, PolicyInfo
from betterbench.interface.policy import require_policy
from betterbench.policies import source_of
from betterbench.policies.address import AddressForm, PolicyAddress
from betterbench.policies.factory import PolicyFactory
from betterbench.policies.kinds import PolicyKind, PolicyNeeds, find_kind

CALLERS = PolicyNeeds(thread=True)
"""Requirements of a policy instance: its own thread, because its latency is unknown."""


class GivenPolicy(PolicyFactory):
    """Policy factory that always returns the caller's instance, under its declared name.

    The instance gets one observation at a time, even if it supports batches. The caller closes it.
    """

    def __init__(self, policy: Policy) -> None:
        """Check the instance.

        Raises:
            InvalidInputError: If the object is not a policy, or its name is the address of a built-in policy or a
                server.
        """
        require_policy(policy, "policy")
        name = policy.info.name
        if not name or find_kind(name) is not None:
            problem = f"the name {name!r} is an address of betterbench" if name else "the name is empty"
            raise InvalidInputError(
                "policy", problem, "Give its PolicyInfo another name, or pass the address as a string"
            )
        made = type(policy)
        super().__init__(name, kind=kind_of_callers(name, lambda: source_of(f"{made.__module__}:{made.__qualname__}")))
        self._policy = policy

    def _make(self) -> Policy:
        return _Lent(self._policy)


def kind_of_callers(name: str, source: Callable[[], str] = str) -> PolicyKind:
    """Return the policy kind of a caller's instance. It is not registered, because other processes cannot create it.

    Args:
        name: Name that the policy declares, with only characters that are valid in addresses.
        source: Function that returns name and SHA-256 of the policy's file, or "".
    """
    form = AddressForm(scheme=name, example=name, target="none")
    return PolicyKind(
        form=form,
        shown=name,
        summary="",
        needs=CALLERS,
        read=lambda text, world: PolicyAddress(text, form, "", world=world),
        source_of=lambda _: source(),
    )


def needs_in_run(policy: str) -> PolicyNeeds:
    """Return the requirements of a plan's policy. A name without a kind is a caller's instance."""
    kind = find_kind(policy)
    return CALLERS if kind is None else kind.needs_of(policy)


class _Lent:
    """Wrapper of a policy that ignores ``close``."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    @property
    def info(self) -> PolicyInfo:
        return self._policy.info

    def reset(self, start: EpisodeStart) -> None:
        self._policy.reset(start)

    def act(self, observation: Observation) -> np.ndarray:
        return self._policy.act(observation)
