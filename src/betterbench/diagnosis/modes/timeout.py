"""Timeout: nothing was done wrong, and the step limit is reached with something left to do."""

from __future__ import annotations

from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks.labels import Label


@FailureMode(
    Label.TIMEOUT,
    short="timeout",
    definition="Every attempt was right, and the step limit was reached.",
    conclusion="It does the right things, but runs out of time.",
    finding="Does the right things until the step limit ends the trial",
)
def _find(trial: TrialView) -> Evidence | None:
    """Return the evidence of a timeout, if nothing else explains the trial."""
    if not trial.unexplained or not trial.out_of_time:
        return None
    episode = trial.episode
    last = episode.trace.rows - 1
    words = ", ".join(repr(episode.goals[g].word) for g in episode.open_goals(last))
    tail = f", with {words} still to do" if words else ""
    return episode.evidence(
        "step_limit", f"The step limit is reached although every attempt was right{tail}.", rows=(last, last)
    )
