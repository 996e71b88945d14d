"""Rollout of a CALVIN chain: up to five instructions one after the other, until one of them fails."""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np

from betterbench.tasks.worlds.calvin.play_table import PlayTable
from betterbench.tasks.worlds.calvin.results import ChainResult, SubtaskResult
from betterbench.tasks.worlds.calvin.rules import done
from betterbench.tasks.worlds.calvin.sequences import Chain
from betterbench.tasks.worlds.calvin.starts import ChainStart, start_of

STEPS_PER_SUBTASK = 360
"""Largest number of control steps for each instruction (CALVIN's EP_LEN), which is 12 s at 30 Hz."""

ObservationT = TypeVar("ObservationT")
SeenT_co = TypeVar("SeenT_co", covariant=True)
ShownT_contra = TypeVar("ShownT_contra", contravariant=True)


class ChainWorld(Protocol[SeenT_co]):
    """Interface of a simulator that runs chains."""

    def reset(self, start: ChainStart) -> SeenT_co:
        """Reset the robot and the scene, and return the observation."""

    def info(self) -> PlayTable:
        """Return the current state of the scene."""

    def step(self, action: np.ndarray) -> SeenT_co:
        """Execute one action for one control step, and return the observation.

        Args:
            action: (7,) floats: relative position and Euler angles in [-1, 1], and the gripper (1 opens, -1 closes).
        """


class ChainPolicy(Protocol[ShownT_contra]):
    """Interface of a policy that runs chains."""

    def reset(self) -> None:
        """Reset the policy. This method is called before each instruction."""

    def act(self, observation: ShownT_contra, instruction: str) -> np.ndarray:
        """Return the next action, (7,) floats."""


def play_chain(
    world: ChainWorld[ObservationT],
    policy: ChainPolicy[ObservationT],
    chain: Chain,
    *,
    steps: int = STEPS_PER_SUBTASK,
) -> ChainResult:
    """Run one chain in the same way as CALVIN's ``evaluate_sequence``.

    The robot returns to its start only before the chain, and the policy is reset before each instruction. A subtask is
    done as soon as its success rule holds. The rule compares the current scene with the scene at the beginning of the
    subtask. The chain ends with the first subtask that is not done.
    """
    observation = world.reset(start_of(chain.start))
    played = []
    for subtask in chain.subtasks:
        policy.reset()
        start = world.info()
        taken, success = 0, False
        while taken < steps and not success:
            observation = world.step(policy.act(observation, subtask.instruction))
            taken += 1
            success = done(subtask.rule, start, world.info())
        played.append(SubtaskResult(subtask.name, success, taken))
        if not success:
            break
    return ChainResult(chain.number, tuple(played))
