"""Resampled start states of CALVIN's chains: the subtasks stay the same, but blocks start at other positions.

The official evaluation puts every block on the table at one of two points. If the positions are drawn from the full
range of the training data instead, the same policies complete fewer subtasks per chain. According to arXiv:2606.04233,
X-VLA completes 4.17 subtasks from the official starts and 3.14 from resampled starts. For GR-1, the numbers are 3.24
and 2.50, and for RoboFlamingo 2.37 and 1.87.
"""

from __future__ import annotations

import hashlib
import math

import numpy as np

from betterbench.geometry import horizontal_distance
from betterbench.tasks.worlds.calvin.sequences import Chain
from betterbench.tasks.worlds.calvin.starts import BLOCKS, ChainStart, start_of

TRAINING_RANGE: dict[str, tuple[tuple[float, float], tuple[float, float], float]] = {
    "table": ((0.0, 0.35), (-0.15, -0.03), 0.46),
    "slider_left": ((-0.32, -0.16), (0.05, 0.12), 0.46),
    "slider_right": ((-0.05, 0.13), (0.05, 0.12), 0.46),
}
"""Ranges of block positions during CALVIN's data collection: x, y and z [m] for each surface.

They are ``surfaces`` of calvin_env's scene, as in the ``merged_config.yaml`` of the published data.
"""

APART_M = 0.09
"""Smallest distance between the centers of two blocks [m]. It exceeds the extent of the largest two at any yaw."""

_TRIES = 1000


def resampled_start_of(chain: Chain) -> ChainStart:
    """Return the start of a chain with the blocks at newly drawn positions on their surfaces and with random yaws.

    Robot, drawer, slider and lights are in the same state as in
    :func:`~betterbench.tasks.worlds.calvin.starts.start_of`. Every chain has its own draw. The draw depends only on the
    number of the chain. Blocks on the same surface are drawn again until they are far enough apart. (In CALVIN's data
    collection, they were drawn again until they did not touch.)
    """
    digest = hashlib.sha256(f"betterbench calvin resampled {chain.number}".encode()).digest()
    generator = np.random.Generator(np.random.PCG64(int.from_bytes(digest[:8], "little")))
    official = start_of(chain.start)
    scene = official.scene.copy()
    for _ in range(_TRIES):
        for i, block in enumerate(BLOCKS):
            x, y, z = TRAINING_RANGE[str(chain.start[block])]
            scene[6 + 6 * i : 12 + 6 * i] = (
                generator.uniform(*x), generator.uniform(*y), z, 0.0, 0.0, generator.uniform(-math.pi, math.pi),
            )  # fmt: skip
        places = [scene[6 + 6 * i : 9 + 6 * i].tolist() for i in range(len(BLOCKS))]
        if all(horizontal_distance(a, b) > APART_M for i, a in enumerate(places) for b in places[:i]):
            return ChainStart(official.robot, scene)
    raise AssertionError("found no positions at which the blocks are far enough apart")
