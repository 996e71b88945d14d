"""Statistics that ``better eval`` shows during a run: pace, successes so far, and policy latency."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.errors import RecordError
from betterbench.evaluation import Progress
from betterbench.evaluation.running.summary import PolicyService, RunTimes
from betterbench.records import JournalEntry, RunFolder
from betterbench.tasks import TrialId


@dataclass(slots=True)
class RunTally:
    """Counts of the finished trials while a run is in progress.

    Attributes:
        ambiguous: Planned trials for which no outcome is correct or wrong. These trials are not judged.
        judged: Number of trials with a record and a right or wrong outcome.
        successes: Number of judged trials that succeeded.
        policy_errors: Number of trials that ended with an error of the policy.
        broken: Number of trials that have no record because of an error in this session. Running the command again
            repeats them.
    """

    ambiguous: frozenset[TrialId] = frozenset()
    judged: int = 0
    successes: int = 0
    policy_errors: int = 0
    broken: int = 0

    def resume(self, run: RunFolder) -> None:
        """Initialize the counts from the trials that a run already contains."""
        self.judged = self.successes = self.policy_errors = 0
        for entry in run.entries():
            if entry.status == "done":
                self.add(run, entry)

    def add(self, run: RunFolder, entry: JournalEntry) -> None:
        """Count a trial that has just ended."""
        if entry.status == "error":
            self.broken += 1
            return
        try:
            outcome = run.outcome(entry)
        except RecordError:  # the record was removed, so its trial is run again
            return
        if entry.key not in self.ambiguous:
            self.judged += 1
            self.successes += outcome.success
        self.policy_errors += outcome.termination == "policy_error"

    def note(self, progress: Progress, *, left: str | None = None) -> str:
        """Return the note of the progress bar: pace, time left, successes, policy errors, broken trials and verdicts.

        If ``left`` is given, it is shown instead of the pace and the time left that are computed from finished trials.
        """
        first = pace(progress) if left is None else left
        parts = [first] if first else []
        if self.judged:
            parts.append(f"{self.successes}/{self.judged} succeeded")
        if self.policy_errors:
            parts.append(f"{self.policy_errors} error{'' if self.policy_errors == 1 else 's'}")
        if self.broken:
            parts.append(f"{self.broken} could not be run")
        if progress.decisions is not None:
            parts.append(f"{progress.decisions.decided}/{len(progress.decisions.answers)} variations decided")
        return " · ".join(parts)


def pace(progress: Progress) -> str:
    """Return a string with the trials per minute and the time left.

    The string is empty until the first trial of this session has ended. For a run with ``--until-decided``, the time
    left is an upper bound.
    """
    ended = progress.done - progress.started_with
    if ended < 1 or progress.elapsed_s <= 0.0:
        return ""
    per_minute = 60.0 * ended / progress.elapsed_s
    left_s = (progress.planned - progress.done) * progress.elapsed_s / ended
    rate = f"{per_minute:.0f}" if per_minute >= 10 else f"{per_minute:.1f}"
    most = "" if progress.decisions is None else "at most "
    return f"{rate}/min, {most}{duration(left_s)} left"


def duration(seconds: float) -> str:
    """Format a duration: "40 s", "12 min", "3 h 05 min"."""
    whole = round(seconds)
    if whole < 90:
        return f"{whole} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


def service_text(service: PolicyService | None) -> str:
    """Describe the response time of the policy. Return an empty string if it is unknown."""
    if service is None:
        return ""
    parts = [f"{_milliseconds(service.p50_s)} per answer (slowest {_milliseconds(service.max_s)})"]
    if service.concurrency >= 0.05:
        parts.append(f"{service.concurrency:.1f} simultaneous requests on average")
    if service.retries is not None:
        parts.append(f"{service.retries} {'retry' if service.retries == 1 else 'retries'}")
    if service.reconnects is not None:
        parts.append(f"{service.reconnects} reconnect{'' if service.reconnects == 1 else 's'}")
    return ", ".join(parts)


def _milliseconds(seconds: float) -> str:
    if seconds >= 10.0:
        return f"{seconds:.0f} s"
    return f"{1000 * seconds:.0f} ms" if seconds >= 0.001 else "under 1 ms"


def times_text(times: RunTimes, *, drawn_here: bool, chosen: bool) -> str:
    """Describe the time spent in each part of a run, name the bottleneck, and suggest a remedy.

    Args:
        times: Time spent in each part of the run.
        drawn_here: Whether the workers render the images. If not, the simulator of an external world renders them.
        chosen: Whether a warm-up chose the number of environments.
    """
    envs = "" if times.envs is None else f" ({times.envs} environment{'' if times.envs == 1 else 's'} a worker)"
    parts = (
        f"policy {_seconds(times.policy_s)}, simulation {_seconds(times.simulation_s)}, rendering "
        f"{_seconds(times.rendering_s)}, wire {_seconds(times.wire_s)} over all trials{envs}"
    )
    return f"{parts}. {bottleneck_text(times, drawn_here=drawn_here, chosen=chosen)}"


def bottleneck_text(times: RunTimes, *, drawn_here: bool, chosen: bool) -> str:
    """Return a sentence that names the bottleneck of a run and a remedy."""
    if times.bottleneck == "policy" and times.envs is None:
        return "The policy runs inside the workers and is the bottleneck: use more --workers."
    if times.bottleneck == "policy":
        more = "more servers" if chosen else "more --envs, more servers"
        return (
            f"The policy is the bottleneck: the workers waited for it {100 * times.idle:.0f} % of their time. Use a "
            f"faster server, {more} or, if the policy was trained for them, longer action chunks (horizon=N)."
        )
    if times.bottleneck == "wire":
        return (
            "Data transfer is the bottleneck: send images only as large as the policy needs (size=N), send JPEG images "
            "to a vla-eval server (images=jpeg), or use more --workers."
        )
    if times.bottleneck == "rendering":
        less = ", --quality fast or --observation state_only (if the policy needs no images)" if drawn_here else ""
        return f"Rendering is the bottleneck: a graphics card{less}, or more CPU cores with more --workers, would help."
    what = "Simulation" if drawn_here else "Simulation (with its images, if the world draws at each step)"
    cure = "more CPU cores with more --workers, or more machines with --engine ray"
    return f"{what} is the bottleneck: use {cure}."


def _seconds(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 90.0 else duration(seconds)
