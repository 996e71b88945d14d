"""Unfinished: a planned trial that the run has not reached; it says nothing about the policy."""

from __future__ import annotations

from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks.labels import Label


@FailureMode(
    Label.UNFINISHED,
    short="unfinished",
    definition="The run was stopped before the trial had ended; no failure of any kind.",
    conclusion="The run is not finished: the same command runs the trials that are left.",
)
def _find(trial: TrialView) -> Evidence | None:
    """Return nothing: what has a record has ended."""
    del trial
    return None
