"""What a run shows while it goes on: its pace, what succeeded so far, and how the policy answers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from betterbench.evaluation import Progress
from betterbench.recording import JournalEntry, RunFolder, read_outcome


@dataclass(slots=True)
class RunTally:
    """Counts of a run as it goes on.

    Attributes:
        judged: Trials with a record.
        successes: Those of them that succeeded.
        policy_errors: Those of them that the policy broke off.
        broken: Trials that broke down in this session and are run again by the same command.
    """

    judged: int = 0
    successes: int = 0
    policy_errors: int = 0
    broken: int = 0

    def resume(self, run: RunFolder) -> None:
        """Count what a run holds already."""
        for entry in run.entries():
            if entry.status == "done":
                self.add(run, entry)

    def add(self, run: RunFolder, entry: JournalEntry) -> None:
        """Count a trial that has just ended."""
        if entry.status == "error":
            self.broken += 1
            return
        outcome = read_outcome(run.record_path(entry.task, entry.condition, entry.seed))
        self.judged += 1
        self.successes += outcome.success
        self.policy_errors += outcome.termination == "policy_error"

    def note(self, progress: Progress) -> str:
        """Return the text beside the bar: pace in trials, time left, successes, errors of the policy, breakdowns."""
        parts = [pace(progress)] if pace(progress) else []
        if self.judged:
            parts.append(f"{self.successes}/{self.judged} right")
        if self.policy_errors:
            parts.append(f"{self.policy_errors} error{'' if self.policy_errors == 1 else 's'}")
        if self.broken:
            parts.append(f"{self.broken} broke down")
        return " · ".join(parts)


def pace(progress: Progress) -> str:
    """Return how fast a run goes and how long it will still take; empty before its first trial has ended.

    Args:
        progress: How far the run is. What an earlier session did counts as done, and not for the pace.
    """
    ended = progress.done - progress.started_with
    if ended < 1 or progress.elapsed_s <= 0.0:
        return ""
    per_minute = 60.0 * ended / progress.elapsed_s
    left_s = (progress.planned - progress.done) * progress.elapsed_s / ended
    rate = f"{per_minute:.0f}" if per_minute >= 10 else f"{per_minute:.1f}"
    return f"{rate}/min, {duration(left_s)} left"


def duration(seconds: float) -> str:
    """Return a duration for people: "40 s", "12 min", "3 h 05 min"."""
    whole = round(seconds)
    if whole < 90:
        return f"{whole} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


def service(entries: Iterable[JournalEntry], elapsed_s: float) -> str:
    """Return how the policy answered in a session, in a sentence; empty if nothing is known about it.

    Args:
        entries: The trials of the session.
        elapsed_s: How long the session took [s].
    """
    walls = [entry.wall for entry in entries if "policy_latency_p50_s" in entry.wall]
    if not walls:
        return ""
    medians = sorted(wall["policy_latency_p50_s"] for wall in walls)
    slowest = max(wall.get("policy_latency_max_s", 0.0) for wall in walls)
    parts = [f"{_milliseconds(medians[len(medians) // 2])} per answer (slowest {_milliseconds(slowest)})"]
    asked_s = sum(wall.get("policy_s", 0.0) for wall in walls)
    if elapsed_s > 0.0 and asked_s / elapsed_s >= 0.05:
        parts.append(f"{asked_s / elapsed_s:.1f} requests under way on average")
    for name in ("retries", "reconnects"):
        count = round(sum(wall.get(name, 0.0) for wall in walls))
        if any(name in wall for wall in walls):
            parts.append(f"{count} {name if count != 1 else _singular(name)}")
    return ", ".join(parts)


def _singular(name: str) -> str:
    return {"retries": "retry", "reconnects": "reconnect"}[name]


def _milliseconds(seconds: float) -> str:
    if seconds >= 10.0:
        return f"{seconds:.0f} s"
    if seconds >= 0.001:
        return f"{1000 * seconds:.0f} ms"
    return "under 1 ms"
