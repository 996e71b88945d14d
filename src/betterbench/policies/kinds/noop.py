"""Idle policy, which never moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from betterbench.interface import EpisodeStart, Observation, PolicyInfo
from betterbench.policies.address import AddressForm
from betterbench.policies.kinds.kind import AT_ONCE, PolicyKind, register

if TYPE_CHECKING:
    from betterbench.policies.address import PolicyAddress


class Noop:
    """Policy that never moves."""

    info = PolicyInfo("noop", needs_images=False)

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode; no state needs to be reset."""

    def act(self, observation: Observation) -> np.ndarray:
        """Return an action that keeps the arm still with an open gripper, shape (7,)."""
        del observation
        return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0])


def _make(address: PolicyAddress) -> Noop:
    del address
    return Noop()


NOOP = register(
    PolicyKind(
        form=AddressForm(scheme="noop", example="noop", target="none"),
        shown="noop",
        summary="Never moves.",
        needs=AT_ONCE,
        make=_make,
    )
)
