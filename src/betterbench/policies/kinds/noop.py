"""Policy kind ``noop``: a policy that never moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from betterbench.interface import EpisodeStart, Observation, PolicyInfo
from betterbench.interface.actions import (
    EE_DELTA,
    JOINT_POSITION,
    OPENING_SPACES,
    OWN_SPACES,
    ActionSpace,
    action_space,
)
from betterbench.policies.address import AddressForm
from betterbench.policies.kinds.kind import AT_ONCE, PolicyKind, register

if TYPE_CHECKING:
    from betterbench.policies.address import PolicyAddress


class Noop:
    """Policy that never moves. It supports every action space of betterbench's own scenes."""

    info = PolicyInfo("noop", needs_images=False)

    def __init__(self) -> None:
        self._space = EE_DELTA
        self._still: np.ndarray | None = None

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode that uses the given action space."""
        self._space, self._still = action_space(start.action_space or EE_DELTA.name), None

    def act(self, observation: Observation) -> np.ndarray:
        """Return the action (dim,) that keeps the arm still and the gripper open."""
        if self._still is None:
            self._still = still_action(self._space, observation)
        return self._still.copy()


def still_action(space: ActionSpace, observation: Observation) -> np.ndarray:
    """Return the action (dim,) that keeps a robot at its measured position.

    The gripper is commanded to open. In an action space that sets the opening width, the gripper keeps its measured
    width instead.
    """
    if (neutral := space.neutral) is not None:
        return np.array([*neutral[:-1], -1.0])
    if space.name in OPENING_SPACES:
        from betterbench.sim.robots import motor_positions

        return np.array(motor_positions(space, observation))
    if space.name == JOINT_POSITION.name:
        return np.array([*observation.joint_positions, -1.0])
    return np.array([*observation.ee_position, *observation.ee_quaternion, -1.0])


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
        spaces=OWN_SPACES,
    )
)
