"""Count of the control steps of all workers in a run, to show progress even before a trial has ended."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

REPORT_EVERY_S = 0.5
"""Interval at which a worker reports its control steps [s]."""


@dataclass(frozen=True, slots=True)
class StepsTaken:
    """Message from a worker process with the number of control steps since the process's last message."""

    steps: int


class StepReport:
    """Counter of a worker's control steps. It is called after every step, and reports the count regularly."""

    def __init__(self, hand_over: Callable[[int], None]) -> None:
        """Start counting. ``hand_over`` is called regularly with the number of steps since the last call."""
        self._hand_over, self._steps = hand_over, 0
        self._next_s = time.monotonic() + REPORT_EVERY_S

    def __call__(self, _step: int) -> None:
        """Count a step."""
        self._steps += 1
        now = time.monotonic()
        if now >= self._next_s:
            self._next_s = now + REPORT_EVERY_S
            steps, self._steps = self._steps, 0
            self._hand_over(steps)


class StepCount:
    """Number of control steps of all workers of a run.

    Attributes:
        steps: Number of steps reported so far.
    """

    def __init__(self, on_steps: Callable[[int], None] | None = None) -> None:
        """Start counting. ``on_steps`` is called after each report with the number of steps of all workers."""
        self.steps, self._on_steps = 0, on_steps

    def add(self, steps: int) -> None:
        """Add a number of steps that a worker has reported."""
        self.steps += steps
        if steps and self._on_steps is not None:
            self._on_steps(self.steps)
