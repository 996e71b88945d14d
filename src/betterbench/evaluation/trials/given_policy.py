"""Evaluation of a policy object that the caller passes to the run, in this process only."""

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
"""Needs of a policy object: its own thread, because its replies may take any time."""


class GivenPolicy(PolicyFactory):
    """Policy factory that always returns the caller's policy object, under the name that the object declares.

    The object gets one observation at a time, even if it supports batches. The caller closes the object.
    """

    def __init__(self, policy: Policy) -> None:
        """Check the policy object.

        Raises:
            InvalidInputError: If the object is not a policy, or if its name is empty or is the address of a built-in
                policy or of a server.
        """
        require_policy(policy, "policy")
        name = policy.info.name
        if not name or find_kind(name) is not None:
            problem = f"the name {name!r} is an address of betterbench" if name else "the name is empty"
            raise InvalidInputError(
                "policy", problem, "Use another name in its PolicyInfo, or pass the policy address as a string"
            )
        made = type(policy)
        super().__init__(name, kind=kind_of_callers(name, lambda: source_of(f"{made.__module__}:{made.__qualname__}")))
        self._policy = policy

    def _make(self) -> Policy:
        return _Lent(self._policy)


def kind_of_callers(name: str, source: Callable[[], str] = str) -> PolicyKind:
    """Return a policy kind for the caller's policy object.

    The kind is not registered, because other processes cannot create the object.

    Args:
        name: Name that the policy declares. It may contain only characters that are valid in addresses.
        source: Function that returns the name and SHA-256 of the file that contains the policy, or an empty string.
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
    """Return the needs of the policy in a plan.

    If no policy kind has this name, the policy is an object that the caller has passed to the run.
    """
    kind = find_kind(policy)
    return CALLERS if kind is None else kind.needs_of(policy)


class _Lent:
    """Wrapper around a policy that does not close the policy when it is closed itself."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    @property
    def info(self) -> PolicyInfo:
        return self._policy.info

    def reset(self, start: EpisodeStart) -> None:
        self._policy.reset(start)

    def act(self, observation: Observation) -> np.ndarray:
        return self._policy.act(observation)
