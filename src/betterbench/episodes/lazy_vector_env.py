"""Vector environments that sleep until they are reset, and of which one of a group is awake at a time.

An evaluation over all conditions makes all its vector environments before the first episode. Each environment that was
reset holds a scene of some 25 MB, and one in a process of its own an interpreter too; only one vector environment is at
work at any time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv

from betterbench.episodes.gymnasium_env import TaskEnv

Factory = Callable[[], TaskEnv]


class ActiveEnv:
    """The group of vector environments of which one is awake."""

    def __init__(self) -> None:
        """Begin with all of them asleep."""
        self._awake: _LazyVectorEnv | None = None

    def take(self, env: _LazyVectorEnv) -> None:
        """Send to sleep the one that is awake, unless it is this one."""
        if self._awake is not None and self._awake is not env:
            self._awake.close_extras()
        self._awake = env


class _LazyVectorEnv(VectorEnv[dict[str, Any], np.ndarray, np.ndarray]):
    """What both kinds share: environments are made at a reset, and the end of a nap is that of the whole object."""

    def __init__(self, make: Sequence[Factory], shift: ActiveEnv) -> None:
        """Remember how the environments are made.

        Args:
            make: One factory per environment.
            shift: Group to which the vector environment belongs.
        """
        self._make, self._shift, self._asleep = tuple(make), shift, True
        self.num_envs = len(self._make)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Wake up if need be, and reset all environments."""
        if self._asleep:
            self._shift.take(self)
            self._wake()
            self._asleep = False
        return super().reset(seed=seed, options=options)  # type: ignore[arg-type] # both kinds take a list of seeds

    def close_extras(self, **how: Any) -> None:  # noqa: ANN401 - Gymnasium's own signature
        """Free all environments; a reset makes them anew."""
        if not self._asleep:
            super().close_extras(**how)
            self._asleep = True

    def _wake(self) -> None:
        raise NotImplementedError


class LazySyncVectorEnv(_LazyVectorEnv, SyncVectorEnv[dict[str, Any], np.ndarray]):
    """Environments in this process."""

    def _wake(self) -> None:
        SyncVectorEnv.__init__(self, self._make, autoreset_mode=AutoresetMode.SAME_STEP)


class LazyAsyncVectorEnv(_LazyVectorEnv, AsyncVectorEnv[dict[str, Any], np.ndarray]):  # type: ignore[misc] # narrower close_extras
    """Environments in processes of their own.

    Args:
        make: One factory per environment.
        shift: Group to which the vector environment belongs.
        stand_ins: What stands in this process for the environments in the others, for code that looks at ``envs``.
    """

    def __init__(self, make: Sequence[Factory], shift: ActiveEnv, *, stand_ins: Sequence[object] = ()) -> None:
        """Remember how the environments are made."""
        super().__init__(make, shift)
        self.envs = list(stand_ins)

    def _wake(self) -> None:
        # A forked process would share the OpenGL and the threads of this one.
        AsyncVectorEnv.__init__(self, self._make, context="spawn", autoreset_mode=AutoresetMode.SAME_STEP)
