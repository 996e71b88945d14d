"""Helper functions for real-time chunking, in which a new action chunk continues the previous chunk.

The client sends the unexecuted actions of the previous chunk, beginning with the action for the current control step. A
server with a flow model copies the first of these actions to its new chunk and uses the others as guidance. The key of
these actions in the request depends on the server (see :mod:`betterbench.policies.clients.being_h`, ``openpi`` and
``gr00t``).
"""

from __future__ import annotations

import numpy as np


def rows_left(asked_at: int, chunk: np.ndarray, *, step: int) -> int:
    """Return the number of unexecuted actions of a chunk (..., horizon, dim) at the control step ``step``.

    ``asked_at`` is the control step of the first action in the chunk. If it is later than ``step``, the result is 0.
    """
    passed = step - asked_at
    return 0 if passed < 0 else max(0, chunk.shape[-2] - passed)


def moved_up(asked_at: int, chunk: np.ndarray, *, step: int) -> np.ndarray:
    """Shift a chunk (..., horizon, dim) so that its first action is the action for a control step.

    ``asked_at`` is the control step of the first action in the given chunk. The end of the result is padded with copies
    of the last action, which the server ignores, so the shape does not change.
    """
    passed = step - asked_at
    return np.concatenate([chunk[..., passed:, :], np.repeat(chunk[..., -1:, :], passed, axis=-2)], axis=-2)
