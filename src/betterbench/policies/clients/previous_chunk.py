"""Real-time chunking: the unplayed rest of an action chunk, which is sent along so that the next chunk continues it.

A server of a flow model can keep the first rows of what it is sent as the first of its new chunk, and guide the ones
after them. The rows have to be those of the control steps that begin now. Which entry of a request they stand in
differs by server (:mod:`betterbench.policies.clients.being_h`, ``openpi`` and ``gr00t``).
"""

from __future__ import annotations

import numpy as np


def rows_left(asked_at: int, chunk: np.ndarray, *, step: int) -> int:
    """Return how many rows of a chunk, (..., horizon, dim), are not played yet at a control step; 0 before it."""
    passed = step - asked_at
    return 0 if passed < 0 else max(0, chunk.shape[-2] - passed)


def moved_up(asked_at: int, chunk: np.ndarray, *, step: int) -> np.ndarray:
    """Return a chunk that begins with the row of a control step, as long as it was.

    It is filled up with its last row, which a server does not look at.
    """
    passed = step - asked_at
    return np.concatenate([chunk[..., passed:, :], np.repeat(chunk[..., -1:, :], passed, axis=-2)], axis=-2)
