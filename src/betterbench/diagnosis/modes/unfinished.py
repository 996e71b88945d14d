"""Unfinished: a planned trial that was not run to its end. It is not evidence about the policy."""

from __future__ import annotations

from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks.labels import Label


@FailureMode(
    Label.UNFINISHED,
    short="unfinished",
    definition="The run was stopped before the trial had ended; this is not a failure of the policy.",
    conclusion="The run is not finished: run the same command again for the remaining trials.",
)
def _find(trial: TrialView) -> Evidence | None:
    """Return None, because a trial with a record has ended, and this label is only for unfinished trials."""
    del trial
    return None
