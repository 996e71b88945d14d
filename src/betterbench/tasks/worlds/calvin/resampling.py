"""Resampled CALVIN starts, with the same chains but with blocks anywhere in the range of the training data.

The official evaluation puts every block that is on the table at one of two points. With positions from the full range
of the training data, the same policies complete fewer subtasks per chain. According to arXiv:2606.04233, X-VLA
completes 4.17 in the official and 3.14 in the resampled starts, GR-1 3.24 and 2.50, and RoboFlamingo 2.37 and 1.87.
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
"""Ranges of block positions during data collection: x, y and z [m] for each surface (``surfaces`` in calvin_env's
scene, as in the ``merged_config.yaml`` of the published data).
"""

APART_M = 0.09
"""Minimum distance between two block centers [m], more than the extent of the largest two at any yaw."""

_TRIES = 1000


def resampled_start_of(chain: Chain) -> ChainStart:
    """Return a chain's start with blocks redrawn at positions in the range of their surfaces, with arbitrary yaws.

    Robot, drawer, slider and lights are the same as in :func:`~betterbench.tasks.worlds.calvin.starts.start_of`. Every
    chain has its own draw, which depends only on its number. Blocks on the same surface are drawn again until they are
    far enough apart. In CALVIN's data collection, they are drawn again until they do not touch.
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
    raise AssertionError("two blocks fit on the table")
