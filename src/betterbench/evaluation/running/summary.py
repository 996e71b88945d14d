"""The counts of a run, and how its policy answered."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from betterbench.recording import JournalEntry, RunFolder


def run_counts(run: RunFolder, *, seeds: Collection[int] | None = None) -> dict[str, dict[str, int]]:
    """Return of how many trials (n) how many (k) succeeded, on training conditions and on variations, or broke down.

    With ``seeds``, the successes are those of the trials with such a seed.
    """
    counts = {"training": {"k": 0, "n": 0}, "variations": {"k": 0, "n": 0}, "errors": {"k": 0, "n": 0}}
    for entry in run.entries():
        counts["errors"]["n"] += 1
        counts["errors"]["k"] += entry.status == "error"
    for record in run.records():
        if seeds is not None and record.metadata.seed not in seeds:
            continue
        group = counts["training" if record.metadata.variation is None else "variations"]
        group["n"] += 1
        group["k"] += record.outcome.success
    return counts


def broken_trials(run: RunFolder) -> tuple[JournalEntry, ...]:
    """Return the entries of the trials that broke: without a record, or with an error of the policy at its end."""
    return tuple(e for e in run.entries() if e.status == "error" or e.message is not None)


def rendering_share(entries: Iterable[JournalEntry]) -> float | None:
    """Return the share of the time of trials that went into their observations, mostly images; None without trials."""
    walls = [e.wall for e in entries if "observe_s" in e.wall and e.wall.get("total_s", 0.0) > 0.0]
    return sum(w["observe_s"] for w in walls) / sum(w["total_s"] for w in walls) if walls else None


@dataclass(frozen=True, slots=True)
class PolicyService:
    """How a policy answered over several trials.

    Attributes:
        p50_s: Median over the trials of the median time of an answer [s].
        max_s: Longest time of an answer [s].
        concurrency: Requests under way on average.
        retries: Requests that were sent again; None if the policy has no connection.
        reconnects: Connections that were made again; None likewise.
    """

    p50_s: float
    max_s: float
    concurrency: float
    retries: int | None
    reconnects: int | None


def policy_service(entries: Iterable[JournalEntry], elapsed_s: float) -> PolicyService | None:
    """Return how the policy answered in the trials of a session that took so long [s]; None if it is unknown."""
    walls = [entry.wall for entry in entries if "policy_latency_p50_s" in entry.wall]
    if not walls:
        return None

    def total(name: str) -> int | None:
        return round(sum(wall.get(name, 0.0) for wall in walls)) if any(name in wall for wall in walls) else None

    medians = sorted(wall["policy_latency_p50_s"] for wall in walls)
    asked_s = sum(wall.get("policy_s", 0.0) for wall in walls)
    return PolicyService(
        p50_s=medians[len(medians) // 2],
        max_s=max(wall.get("policy_latency_max_s", 0.0) for wall in walls),
        concurrency=asked_s / elapsed_s if elapsed_s > 0.0 else 0.0,
        retries=total("policy_retries"),
        reconnects=total("policy_reconnects"),
    )
