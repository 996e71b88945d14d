"""LIBERO's process as in a run, which also reports the processor time of LIBERO's own calls."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from betterbench.sim.worlds.libero.simulator import LiberoSimulator
from betterbench.sim.worlds.simulator_loop import FrameContent, answer_requests


class TimedSimulator(LiberoSimulator):
    """Counts the processor time inside ``reset``, ``set_init_state`` and ``step`` of LIBERO's environment [s]."""

    def __init__(self) -> None:
        """Begin at zero."""
        super().__init__()
        self.raw_s = 0.0

    def start(self, request: Mapping[str, Any]) -> FrameContent:
        """Begin an episode."""
        document, arrays = super().start(request)
        return document, self.with_times(arrays)

    def step(self, action: np.ndarray, *, look: bool) -> FrameContent:
        """Take one control step."""
        document, arrays = super().step(action, look=look)
        return document, self.with_times(arrays)

    def _make(self, path: str, size: int | None) -> None:
        super()._make(path, size)
        for name in ("reset", "set_init_state", "step"):
            setattr(self._wrapper, name, self.timed(getattr(self._wrapper, name)))

    def timed(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a call that counts its processor time."""

        def counted(*arguments: Any) -> Any:  # noqa: ANN401 - those of LIBERO's calls
            before = time.process_time()
            try:
                return call(*arguments)
            finally:
                self.raw_s += time.process_time() - before

        return counted

    def with_times(self, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the arrays and "times" (2,) [s]: the time in LIBERO's own calls and in the whole process so far."""
        return {**arrays, "times": np.array([self.raw_s, time.process_time()])}


def main() -> None:
    """Answer over the socket whose number is the first argument."""
    answer_requests(TimedSimulator(), int(sys.argv[1]))
