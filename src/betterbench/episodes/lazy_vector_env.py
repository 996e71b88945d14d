"""Vector environments that create their environments at the first reset instead of in the constructor.

LeRobot creates the vector environments of all conditions before the first episode, but uses only one at a time. An open
environment takes about 25 MB for its scene and, if it runs in a separate process, the memory of a Python interpreter.
Therefore, only one vector environment of a group has open environments at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv

from betterbench.episodes.gymnasium_env import TaskEnv

Factory = Callable[[], TaskEnv]


class ActiveEnv:
    """Group of vector environments, only one of which has open environments at a time."""

    def __init__(self) -> None:
        self._active: _LazyVectorEnv | None = None

    def take(self, env: _LazyVectorEnv) -> None:
        """Make a vector environment active, and close the environments of the previously active vector environment."""
        if self._active is not None and self._active is not env:
            self._active.close_extras()
        self._active = env


class _LazyVectorEnv(VectorEnv[dict[str, Any], np.ndarray, np.ndarray]):
    """Base class of vector environments that create their environments at the first reset, or after a close."""

    def __init__(self, make: Sequence[Factory], group: ActiveEnv) -> None:
        """Store the functions that create the environments, without calling them.

        ``group`` is the group to which this vector environment belongs.
        """
        self._make, self._group, self._empty = tuple(make), group, True
        self.num_envs = len(self._make)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Create the environments if they are not open, and reset them."""
        if self._empty:
            self._group.take(self)
            self._make_envs()
            self._empty = False
        return super().reset(seed=seed, options=options)  # type: ignore[arg-type] # both kinds take a list of seeds

    def close_extras(self, **how: Any) -> None:  # noqa: ANN401 - Gymnasium's own signature
        """Close all environments. The next reset creates new ones."""
        if not self._empty:
            super().close_extras(**how)
            self._empty = True

    def _make_envs(self) -> None:
        raise NotImplementedError


class LazySyncVectorEnv(_LazyVectorEnv, SyncVectorEnv[dict[str, Any], np.ndarray]):
    """Lazy vector environment whose environments run in this process."""

    def _make_envs(self) -> None:
        SyncVectorEnv.__init__(self, self._make, autoreset_mode=AutoresetMode.SAME_STEP)


class LazyAsyncVectorEnv(_LazyVectorEnv, AsyncVectorEnv[dict[str, Any], np.ndarray]):  # type: ignore[misc] # narrower close_extras
    """Lazy vector environment that runs each environment in its own process.

    LeRobot reads attributes of the environments in ``envs``. Since the environments run in other processes, ``envs``
    contains the objects ``stand_ins`` instead.
    """

    def __init__(self, make: Sequence[Factory], group: ActiveEnv, *, stand_ins: Sequence[object] = ()) -> None:
        super().__init__(make, group)
        self.envs = list(stand_ins)

    def _make_envs(self) -> None:
        # Spawn the processes, because a forked process would inherit the OpenGL context of this process.
        AsyncVectorEnv.__init__(self, self._make, context="spawn", autoreset_mode=AutoresetMode.SAME_STEP)
