"""Named random streams, with one generator per purpose.

Adding a camera therefore does not move objects, and a trial and its twin share every draw.
"""

import hashlib

import numpy as np

SUITE_VERSION = "2.0"
"""Version of the suite, incremented if the meaning of a seed changes for all tasks."""

FIRST_DEMONSTRATION_SEED = 1_000_000
"""First seed of demonstrations. Smaller seeds are for evaluation and certificates."""


def stream(task: str, seed: int, purpose: str) -> np.random.Generator:
    """Return a fresh generator for one purpose ("slot:near", "look:mug"): PCG64 seeded with a SHA-256.

    The stream depends only on the suite version, the task, the seed and the purpose. It does not depend on the
    condition, the policy, the trial order or the number of workers.
    """
    digest = hashlib.sha256(f"{SUITE_VERSION}|{task}|{seed}|{purpose}".encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))
