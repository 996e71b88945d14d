"""Summary of a run: numbers of trials by outcome, and response times of the policy."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any, Literal

from betterbench.errors import PolicyError
from betterbench.records import JournalEntry, RunFolder
from betterbench.tasks import Expected


def run_counts(run: RunFolder, *, seeds: Collection[int] | None = None) -> dict[str, dict[str, int]]:
    """Return the numbers of successes and trials for training conditions and variations, and the number of errors.

    In each group, "k" is the number of successes (or errors) and "n" the number of trials. Ambiguous trials are counted
    separately. If ``seeds`` is given, only trials with these seeds are counted, except for the errors.
    """
    counts = {"training": {"k": 0, "n": 0}, "variations": {"k": 0, "n": 0}, "errors": {"k": 0, "n": 0}}
    counts["ambiguous"] = {"n": 0}
    for entry in run.entries():
        counts["errors"]["n"] += 1
        counts["errors"]["k"] += entry.status == "error"
    for record in run.records():
        if seeds is not None and record.metadata.seed not in seeds:
            continue
        if record.metadata.expected == Expected.AMBIGUOUS.value:
            counts["ambiguous"]["n"] += 1
            continue
        group = counts["training" if record.metadata.variation is None else "variations"]
        group["n"] += 1
        group["k"] += record.outcome.success
    return counts


def broken_trials(run: RunFolder) -> tuple[JournalEntry, ...]:
    """Return the journal entries of trials that have no record or that ended with a policy error."""
    return tuple(e for e in run.entries() if e.status == "error" or e.message is not None)


def require_a_trial(run: RunFolder) -> None:
    """Raise PolicyError if no trial of the run could be completed. The message quotes the first error."""
    broken = broken_trials(run)
    if broken and len(broken) == len(run.entries()):
        first = broken[0]
        counted = "the only trial" if len(broken) == 1 else f"all {len(broken)} trials"
        raise PolicyError(
            f"{counted} failed with an error, so there is no result. {first.key}: {first.message or 'no message'}"
        )


@dataclass(frozen=True, slots=True)
class PolicyService:
    """Response times of a policy, number of simultaneous requests, and connection failures, over several trials.

    Attributes:
        p50_s: Median over all trials of the median response time [s].
        max_s: Longest response time [s].
        concurrency: Average number of pending requests.
        retries: Number of requests that were sent again. None for a policy without a connection.
        reconnects: Number of reconnections. None for a policy without a connection.
    """

    p50_s: float
    max_s: float
    concurrency: float
    retries: int | None
    reconnects: int | None


def policy_service(entries: Iterable[JournalEntry], elapsed_s: float) -> PolicyService | None:
    """Return the response times of the policy in a session of ``elapsed_s`` [s], or None if they are not known."""
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


RunPart = Literal["policy", "simulation", "rendering", "wire"]
"""Parts into which the duration of a run is divided."""

WAITED = 0.2
"""If workers wait for at least this fraction of the time, the policy or its messages are the bottleneck."""


@dataclass(frozen=True, slots=True)
class RunTimes:
    """Time that each part of a run took, summed over all trials, including those before the run was resumed.

    Attributes:
        policy_s: Time from request to reply, without ``wire_s`` [s]. The requests of several environments may overlap
            in time.
        simulation_s: Time for creating scenes, simulating, reading the privileged state, and writing records [s].
        rendering_s: Time for creating observations, which is mostly spent on rendering images [s].
        wire_s: CPU time that betterbench spends on messages to and from the policy: resizing, packing and sending
            images, and reading replies [s]. The network latency is part of ``policy_s``.
        idle_s: Time that workers spent waiting for the policy [s].
        envs: Number of environments per worker in the last trial, or None if the policy runs in the worker itself.
    """

    policy_s: float
    simulation_s: float
    rendering_s: float
    wire_s: float
    idle_s: float
    envs: int | None

    @property
    def idle(self) -> float:
        """Fraction of the workers' time spent waiting for the policy."""
        worked = self.simulation_s + self.rendering_s + self.idle_s
        return self.idle_s / worked if worked > 0.0 else 0.0

    @property
    def bottleneck(self) -> RunPart:
        """Name of the part that limits the speed of the run."""
        if self.envs is not None and self.idle >= WAITED:
            return "wire" if self.wire_s > self.policy_s else "policy"
        parts: dict[RunPart, float] = {
            "simulation": self.simulation_s,
            "rendering": self.rendering_s,
            "wire": self.wire_s,
        }
        if self.envs is None:
            parts["policy"] = self.policy_s
        return max(parts, key=parts.__getitem__)

    def to_json(self) -> dict[str, Any]:
        """Return the times as a JSON-serializable dict, in seconds."""
        return {
            "policy_s": round(self.policy_s, 3),
            "simulation_s": round(self.simulation_s, 3),
            "rendering_s": round(self.rendering_s, 3),
            "wire_s": round(self.wire_s, 3),
            "waited_s": round(self.idle_s, 3),
            "envs": self.envs,
            "bottleneck": self.bottleneck,
        }


def run_times(entries: Iterable[JournalEntry]) -> RunTimes | None:
    """Return the total times of the parts of several trials, or None if the journal entries contain no times."""
    walls = [e.wall for e in entries if "simulation_s" in e.wall]
    if not walls:
        return None

    def total(*names: str) -> float:
        return sum(wall.get(name, 0.0) for wall in walls for name in names)

    wire_s = total("wire_s")
    return RunTimes(
        policy_s=max(0.0, total("policy_s") - wire_s),
        simulation_s=total("simulation_s", "setup_s", "write_s"),
        rendering_s=total("observe_s"),
        wire_s=wire_s,
        idle_s=total("idle_s"),
        envs=round(walls[-1]["envs"]) if "envs" in walls[-1] else None,
    )
