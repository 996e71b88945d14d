"""Start states of CALVIN's chains: simulator vectors for the robot and the scene of each symbolic state."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from betterbench.tasks.worlds.calvin.subtasks import SymbolicState

FNV_PRIME = 0x01000193
"""Prime number of the 32-bit hashes by Fowler, Noll and Vo."""

ROBOT_START = (
    0.02586889, -0.2313129, 0.5712808, 3.09045411, -0.02908596, 1.50013585, 0.07999963,
    -1.21779124, 1.03987629, 2.11978254, -2.34205014, -0.87015899, 1.64119093, 0.55344928, 1.0,
)  # fmt: skip
"""Neutral start of the robot (CALVIN's robot_obs).

The vector contains the tool position [m] and Euler angles [rad], the gripper width [m], seven joint angles [rad], and
the gripper action (1 = open).
"""

SLIDER_OPEN_M, DRAWER_OPEN_M, SWITCH_ON_M = 0.28, 0.22, 0.088
_IN_SLIDER = {
    "slider_left": (-2.40851662e-01, 9.24044687e-02, 4.60990009e-01),
    "slider_right": (7.03416330e-02, 9.24044687e-02, 4.60990009e-01),
}
_ON_TABLE = (
    (5.00000896e-02, -1.20000177e-01, 4.59990009e-01),
    (2.29995412e-01, -1.19995140e-01, 4.59990010e-01),
)
_YAW_RANGE = (math.pi / 2 - math.pi / 8, math.pi / 2 + math.pi / 8)
BLOCKS = ("red_block", "blue_block", "pink_block")


@dataclass(frozen=True, slots=True, eq=False)
class ChainStart:
    """Arguments of ``env.reset(robot_obs=..., scene_obs=...)`` at the start of a chain.

    Attributes:
        robot: (15,) float64. This is always :data:`ROBOT_START`.
        scene: (24,) float64: slider, drawer, button and switch [m], light bulb, LED, followed by position [m] and Euler
            angles [rad] of the red, the blue and the pink block.
    """

    robot: np.ndarray
    scene: np.ndarray


def pyhash_fnv1_32(text: str) -> int:
    """Return what ``pyhash.fnv1_32()(text)`` returns for a ``str``. CALVIN seeds its starts with this hash.

    pyhash 0.9.3 begins with 0 instead of FNV's offset basis (this variant is called FNV-0), and reads the text as
    UTF-16 in little-endian order, without a byte order mark. Ports of CALVIN that use FNV-1 over UTF-8 instead get
    different seeds. As a result, the yaws of blocks differ in all of their starts, and the block positions differ in
    107 of the 192 starts.
    """
    value = 0
    for byte in text.encode("utf-16-le"):
        value = (value * FNV_PRIME) & 0xFFFFFFFF
        value ^= byte
    return value


def start_seed(state: SymbolicState) -> int:
    """Return the seed for drawing the scene of a symbolic start.

    The seed is the hash of ``str(state.values())``, where the state is a plain dict.
    """
    return pyhash_fnv1_32(str(dict(state).values()))


def start_of(state: SymbolicState) -> ChainStart:
    """Return the robot and scene vectors of a symbolic start, like CALVIN's ``get_env_state_for_initial_condition``.

    A generator with the seed :func:`start_seed` chooses one of two points for each block on the table, and draws the
    yaw of each block. Each symbolic start therefore has exactly one scene.
    """
    generator = np.random.RandomState(start_seed(state))
    on_table = list(_ON_TABLE)
    generator.shuffle(on_table)
    scene = np.zeros(24)
    scene[0] = SLIDER_OPEN_M if state["slider"] == "left" else 0.0
    scene[1] = DRAWER_OPEN_M if state["drawer"] == "open" else 0.0
    scene[3] = SWITCH_ON_M if state["lightbulb"] == 1 else 0.0
    scene[4], scene[5] = float(state["lightbulb"]), float(state["led"])
    # The first block on the table gets the first position. The pink block always gets the second.
    free = {"red_block": 0, "blue_block": 1 if state["red_block"] == "table" else 0, "pink_block": 1}
    for i, block in enumerate(BLOCKS):
        at = 6 + 6 * i
        place = str(state[block])
        scene[at : at + 3] = _IN_SLIDER[place] if place in _IN_SLIDER else on_table[free[block]]
        scene[at + 5] = generator.uniform(*_YAW_RANGE)
    return ChainStart(np.array(ROBOT_START), scene)
