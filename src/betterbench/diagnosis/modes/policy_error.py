"""Policy error: the policy crashed, answered too late or sent an invalid action. It is never a reasoning failure."""

from __future__ import annotations

from betterbench.diagnosis.failure_mode import FailureMode, TrialView, sharper_by_rule
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks.labels import Label


@FailureMode(
    Label.POLICY_ERROR,
    short="error",
    definition="The policy crashed, answered too late or sent an invalid action, or the trial could not be run.",
    conclusion="The policy itself failed to run; this is not evidence about its reasoning.",
    sharper=sharper_by_rule(
        {"not_finished": "The run is not finished: most of its failures are trials without a record."}
    ),
)
def _find(trial: TrialView) -> Evidence | None:
    """Find evidence that the policy crashed or that the operator interrupted the episode."""
    outcome = trial.record.outcome
    if outcome.termination not in ("policy_error", "interrupted"):
        return None
    end = float(trial.record.time[-1])
    how, why = outcome.termination, outcome.error or "no reason was recorded"
    return Evidence(how, f"The episode ended early ({how.replace('_', ' ')}): {why}", end, end)


def label_without_record(reason: str | None) -> Label:
    """Return the label of a planned trial without a record.

    The label is policy error if a reason is known, otherwise unfinished.
    """
    return Label.POLICY_ERROR if reason else Label.UNFINISHED


def without_record(reason: str | None) -> Evidence:
    """Return the evidence of a planned trial that has no record."""
    text = "The trial has no record: " + (reason or "it was not finished") + "."
    return Evidence("no_record" if reason else "not_finished", text, 0.0, 0.0)
