"""The one protocol between an episode and a mind that sees only observations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from betterbench.interface.observation import Observation


@dataclass(frozen=True, slots=True)
class EpisodeStart:
    """What a policy is told when an episode begins.

    Attributes:
        instruction: The sentence that says what to do.
        seed: Seed for a policy that draws random numbers; the same for a trial and its twin.
        action_space: Name of the action space in force ("ee_delta").
    """

    instruction: str
    seed: int
    action_space: str


@dataclass(frozen=True, slots=True)
class PolicyInfo:
    """What a policy says about itself; stored with the run.

    Attributes:
        name: Address by which the policy was asked for.
        action_space: Action space in which it answers.
        needs_images: False if it never looks at a picture, so that none are rendered for it.
        metadata: Free text pairs (checkpoint, revision, server).
    """

    name: str
    action_space: str = "ee_delta"
    needs_images: bool = True
    metadata: Mapping[str, str] = field(default_factory=dict)


class Policy(Protocol):
    """A mind that sees only what an :class:`Observation` shows."""

    @property
    def info(self) -> PolicyInfo:
        """What the policy says about itself."""

    def reset(self, start: EpisodeStart) -> None:
        """Forget the last episode and prepare for the next one."""

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next actions.

        Args:
            observation: What is seen now.

        Returns:
            (horizon, dim) array of actions to execute one after the other, or (dim,) for one action.
        """
