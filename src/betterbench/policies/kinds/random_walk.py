"""Policy kind ``random``: a random walk, as a baseline for the success rate of other policies."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

from betterbench.interface import EpisodeStart, Observation, PolicyInfo
from betterbench.interface.actions import (
    EE_DELTA,
    EE_POSE,
    JOINT_STEP_PER_UNIT_RAD,
    OPENING_SPACES,
    OWN_SPACES,
    action_space,
)
from betterbench.policies.address import AddressForm
from betterbench.policies.kinds.kind import AT_ONCE, PolicyKind, register
from betterbench.policies.kinds.noop import still_action

if TYPE_CHECKING:
    from betterbench.policies.address import PolicyAddress


class Random:
    """Policy that performs a seeded random walk.

    The velocity changes randomly but slowly, so that the robot moves through the scene instead of trembling.

    In an action space of absolute joint angles, the walk starts at the measured angles and moves each joint by at most
    :data:`~betterbench.interface.actions.JOINT_STEP_PER_UNIT_RAD` per step.
    """

    info = PolicyInfo("random", needs_images=False)

    def __init__(self) -> None:
        self._draw = np.random.default_rng(0)
        self._space = EE_DELTA
        self._velocity = np.zeros(6)
        self._gripper = -1.0
        self._position: np.ndarray | None = None

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode. The random walk is seeded with the episode number and the instruction."""
        digest = hashlib.sha256(f"random|{start.episode}|{start.instruction}".encode()).digest()
        self._draw = np.random.Generator(np.random.PCG64(int.from_bytes(digest[:8], "little")))
        self._space = action_space(start.action_space or EE_DELTA.name)
        self._velocity = np.zeros(self._space.dim - 1)
        self._gripper = -1.0
        self._position = None

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action (dim,) of the random walk."""
        noise = self._draw.standard_normal(len(self._velocity))
        self._velocity = np.clip(0.9 * self._velocity + 0.15 * noise, -1.0, 1.0)
        if self._draw.random() < 0.02:
            self._gripper = -self._gripper
        space = self._space
        if space.neutral is not None:
            return np.concatenate([self._velocity, [self._gripper]])
        if self._position is None:
            self._position = still_action(space, observation)[:-1]
        step = JOINT_STEP_PER_UNIT_RAD / np.array(space.scale[:-1])
        low, high = np.array(space.low), np.array(space.high)
        self._position = np.clip(self._position + step * self._velocity, low[:-1], high[:-1])
        opened, closed = (high[-1], low[-1]) if space.name in OPENING_SPACES else (low[-1], high[-1])
        return np.concatenate([self._position, [closed if self._gripper > 0.0 else opened]])


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
        spaces=tuple(name for name in OWN_SPACES if name != EE_POSE.name),
    )
)
