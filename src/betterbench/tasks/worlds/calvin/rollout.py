"""Rollout of a chain: five instructions in a row, until one is not carried out."""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np

from betterbench.tasks.worlds.calvin.play_table import PlayTable
from betterbench.tasks.worlds.calvin.results import ChainResult, SubtaskResult
from betterbench.tasks.worlds.calvin.rules import done
from betterbench.tasks.worlds.calvin.sequences import Chain
from betterbench.tasks.worlds.calvin.starts import ChainStart, start_of

STEPS_PER_SUBTASK = 360
"""Control steps that a policy has for each instruction (EP_LEN); 12 s at 30 Hz."""

ObservationT = TypeVar("ObservationT")
SeenT_co = TypeVar("SeenT_co", covariant=True)
ShownT_contra = TypeVar("ShownT_contra", contravariant=True)


class ChainWorld(Protocol[SeenT_co]):
    """Interface of the simulator that chains are played in."""

    def reset(self, start: ChainStart) -> SeenT_co:
        """Set robot and scene, and return the observation."""

    def info(self) -> PlayTable:
        """Return the scene as it is."""

    def step(self, action: np.ndarray) -> SeenT_co:
        """Carry out one action for one control step, and return the observation.

        Args:
            action: (7,) float: relative position and Euler angles in [-1, 1], and the gripper, 1 = open, -1 = close.
        """


class ChainPolicy(Protocol[ShownT_contra]):
    """Interface of the policy that plays chains."""

    def reset(self) -> None:
        """Forget what was; called before every instruction."""

    def act(self, observation: ShownT_contra, instruction: str) -> np.ndarray:
        """Return the next action, (7,) float."""


def play_chain(
    world: ChainWorld[ObservationT],
    policy: ChainPolicy[ObservationT],
    chain: Chain,
    *,
    steps: int = STEPS_PER_SUBTASK,
) -> ChainResult:
    """Play one chain as CALVIN's ``evaluate_sequence`` does.

    The robot returns to its start before the chain only, the policy is reset before each instruction, and a subtask is
    done at the first step at which its rule holds against the scene in which it began. The chain ends with the first
    subtask that is not done.
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
