"""Real-time chunking: the client sends the actions that were not executed, and the server's new chunk continues them.

A server with a flow model can use the first rows of the chunk that it receives as the first rows of its new chunk, and
the following rows as guidance. The rows that are sent must begin at the current control step. Each server expects them
under a different key of the request (see :mod:`betterbench.policies.clients.being_h`, ``openpi`` and ``gr00t``).
"""

from __future__ import annotations

import numpy as np


def rows_left(asked_at: int, chunk: np.ndarray, *, step: int) -> int:
    """Return how many rows of a chunk (..., horizon, dim) have not been executed at a control step.

    ``asked_at`` is the control step at which the chunk begins. The result is 0 if the chunk begins after ``step``.
    """
    passed = step - asked_at
    return 0 if passed < 0 else max(0, chunk.shape[-2] - passed)


def moved_up(asked_at: int, chunk: np.ndarray, *, step: int) -> np.ndarray:
    """Shift a chunk so that it begins with the row for a control step. The length of the chunk does not change.

    ``asked_at`` is the step at which the given chunk begins. The missing rows at the end are filled with copies of the
    last row, which the server ignores.
    """
    passed = step - asked_at
    return np.concatenate([chunk[..., passed:, :], np.repeat(chunk[..., -1:, :], passed, axis=-2)], axis=-2)
