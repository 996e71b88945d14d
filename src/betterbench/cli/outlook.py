"""Estimates of the duration of a run, printed before and during the run."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from betterbench.cli.tally import duration, pace
from betterbench.evaluation import Progress
from betterbench.tasks import TrialId

FEW = 8
"""Minimum number of finished trials for an estimate of the remaining time.

Short trials finish first, so fewer trials would bias the estimate.
"""

LONG_S = 300.0
"""Duration above which a run prints an estimate after its first seconds [s]."""


@dataclass(slots=True)
class Outlook:
    """Estimate of the remaining time of a run, based on the speed of the current session.

    Attributes:
        limits: Maximum number of control steps of each trial; empty if unknown.
        steps: Number of control steps that were executed in this session.
    """

    limits: Mapping[TrialId, int]
    steps: int = 0
    _left: int = 0
    _ended: set[TrialId] = field(default_factory=set)
    # Time [s] and step count of the first report.
    _first: tuple[float, int] | None = None
    _now_s: float = 0.0

    def begin(self, done: set[TrialId]) -> None:
        """Exclude the trials that are already done from the remaining work."""
        self._ended = set(done)
        self._left = sum(limit for trial, limit in self.limits.items() if trial not in self._ended)

    def end(self, trial: TrialId) -> None:
        """Subtract a trial that has just ended from the remaining work."""
        if trial not in self._ended:
            self._ended.add(trial)
            self._left -= self.limits.get(trial, 0)

    def see(self, steps: int, *, now_s: float | None = None) -> None:
        """Record the number of steps that this session has executed so far, and the current time ``now_s`` [s]."""
        self.steps = steps
        self._now_s = time.monotonic() if now_s is None else now_s
        if self._first is None:
            self._first = (self._now_s, steps)

    @property
    def seen_s(self) -> float:
        """Time since the first report of executed steps [s]."""
        return 0.0 if self._first is None else self._now_s - self._first[0]

    @property
    def rate(self) -> float | None:
        """Steps per second since the first report, or None until there is a second report."""
        if self._first is None or self.seen_s <= 0.0:
            return None
        return (self.steps - self._first[1]) / self.seen_s

    @property
    def most_left_s(self) -> float | None:
        """Remaining time if every trial takes its maximum number of steps [s], or None if the time is not known yet."""
        return None if not self.rate or not self.limits else self._left / self.rate

    def note(self, progress: Progress) -> str:
        """Return a string with the remaining time and the number of steps, for the progress line of a run."""
        ended = progress.done - progress.started_with
        if ended < min(FEW, progress.planned - progress.started_with) and self.most_left_s is not None:
            parts = [f"at most {duration(self.most_left_s)} left"]
        else:
            parts = [pace(progress)] if pace(progress) else []
        return " · ".join([*parts, *([f"{self.steps:,} step{'' if self.steps == 1 else 's'}"] if self.steps else [])])

    def first_estimate(self) -> str | None:
        """Return a message that estimates the duration of a run from its first seconds; None if the run is short."""
        if self.most_left_s is None or self.most_left_s < LONG_S:
            return None
        return (
            f"At most {duration(self.most_left_s)} left, estimated from the first {self.seen_s:.0f} s: {self.rate:.0f} "
            f"steps per second, and {self._left:,} more steps if no trial ends early. Ctrl-C stops the run; "
            f"running the command again resumes it."
        )
