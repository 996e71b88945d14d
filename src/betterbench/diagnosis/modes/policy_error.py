"""Policy error: the policy crashed, answered too late or sent an invalid action; never a failure of reasoning."""

from __future__ import annotations

from betterbench.diagnosis.verdict import Evidence
from betterbench.recording import Record


def find(record: Record) -> Evidence | None:
    """Return the evidence of an episode that the policy or the operator broke off, or None."""
    how = record.outcome.termination
    if how not in ("policy_error", "interrupted"):
        return None
    end = float(record.time[-1])
    why = record.outcome.error or "no reason given"
    return Evidence(how, f"The episode ended early ({how.replace('_', ' ')}): {why}", end, end)


def without_record(reason: str | None) -> Evidence:
    """Return the evidence of a planned trial that has no record."""
    text = "The trial has no record: " + (reason or "it was not finished") + "."
    return Evidence("no_record", text, 0.0, 0.0)
