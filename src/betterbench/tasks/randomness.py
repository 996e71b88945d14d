"""Named random streams: each purpose has its own random generator.

As a result, adding a camera does not move any object, and a trial and its counterfactual twin share every draw.
"""

import hashlib

import numpy as np

SUITE_VERSION = "2.0"
"""Version of the suite. It is incremented if the meaning of a seed changes for all tasks."""

FIRST_DEMONSTRATION_SEED = 1_000_000
"""First seed of demonstrations. Smaller seeds are used for evaluation and certificates."""


def stream(task: str, seed: int, purpose: str) -> np.random.Generator:
    """Return a fresh generator for one purpose, such as "slot:near" or "look:mug".

    The generator is a PCG64 that is seeded with a SHA-256 of the suite version, the task, the seed and the purpose. It
    does not depend on the condition, the policy, the order of the trials or the number of workers.
    """
    digest = hashlib.sha256(f"{SUITE_VERSION}|{task}|{seed}|{purpose}".encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))
