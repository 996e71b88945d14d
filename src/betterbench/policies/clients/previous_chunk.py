"""Real-time chunking: the client sends the unexecuted part of an action chunk, and the server continues it.

A flow model's server can keep the first rows of the sent chunk as the first rows of its new chunk, and guide the rows
after them. The rows must start at the current control step. Their key in a request differs by server
(:mod:`betterbench.policies.clients.being_h`, ``openpi`` and ``gr00t``).
"""

from __future__ import annotations

import numpy as np


def rows_left(asked_at: int, chunk: np.ndarray, *, step: int) -> int:
    """Return the number of rows of a chunk, (..., horizon, dim), that remain at a control step.

    Returns 0 if the chunk starts later.
    """
    passed = step - asked_at
    return 0 if passed < 0 else max(0, chunk.shape[-2] - passed)


def moved_up(asked_at: int, chunk: np.ndarray, *, step: int) -> np.ndarray:
    """Return a chunk of the same length that begins with the row of a control step.

    The chunk is padded with its last row, which a server ignores.
    """
    passed = step - asked_at
    return np.concatenate([chunk[..., passed:, :], np.repeat(chunk[..., -1:, :], passed, axis=-2)], axis=-2)
