"""Random walk, as a measure of the success rate of random actions."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

from betterbench.interface import EpisodeStart, Observation, PolicyInfo
from betterbench.policies.address import AddressForm
from betterbench.policies.kinds.kind import AT_ONCE, PolicyKind, register

if TYPE_CHECKING:
    from betterbench.policies.address import PolicyAddress


class Random:
    """Seeded random walk that is smooth enough to cover distance."""

    info = PolicyInfo("random", needs_images=False)

    def __init__(self) -> None:
        self._draw = np.random.default_rng(0)
        self._velocity = np.zeros(6)
        self._gripper = -1.0

    def reset(self, start: EpisodeStart) -> None:
        """Seed the walk with the episode number and the instruction."""
        digest = hashlib.sha256(f"random|{start.episode}|{start.instruction}".encode()).digest()
        self._draw = np.random.Generator(np.random.PCG64(int.from_bytes(digest[:8], "little")))
        self._velocity = np.zeros(6)
        self._gripper = -1.0

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next step of a random walk in velocity, shape (7,)."""
        del observation
        self._velocity = np.clip(0.9 * self._velocity + 0.15 * self._draw.standard_normal(6), -1.0, 1.0)
        if self._draw.random() < 0.02:
            self._gripper = -self._gripper
        return np.concatenate([self._velocity, [self._gripper]])


def _make(address: PolicyAddress) -> Random:
    del address
    return Random()


RANDOM = register(
    PolicyKind(
        form=AddressForm(scheme="random", example="random", target="none"),
        shown="random",
        summary="A seeded random walk with a gripper that opens and closes.",
        needs=AT_ONCE,
        make=_make,
    )
)
