"""Success labels: the policy meets the goal, correctly stays still, or correctly refuses an impossible request."""

from __future__ import annotations

from betterbench.diagnosis.failure_mode import FailureMode, TrialView
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import Expected
from betterbench.tasks.labels import Label


@FailureMode(
    Label.SUCCESS,
    short="solved",
    definition="The goal is met before the step limit, with its objects at rest and released, and no other object was "
    "harmed.",
)
def _find(trial: TrialView) -> Evidence | None:
    return _success(trial, (Expected.SUCCEED,), "The goal is met.")


@FailureMode(
    Label.CORRECT_FREEZE,
    short="stayed still",
    definition="All steps were already done, so the policy should not move. The arm came to rest, and no object was "
    "touched or approached.",
)
def _find_freeze(trial: TrialView) -> Evidence | None:
    """Find evidence that the arm correctly stayed still, because nothing was left to do."""
    return _success(trial, (Expected.STAY_STILL,), "No step was left, and no object was touched.")


@FailureMode(
    Label.CORRECT_REFUSAL,
    short="refused",
    definition="The instructed object was absent, and no other object was attempted or moved instead.",
)
def _find_refusal(trial: TrialView) -> Evidence | None:
    """Find evidence that the requested object was absent and the policy correctly touched no other object."""
    return _success(
        trial, (Expected.REFUSE, Expected.AMBIGUOUS), "The target is absent, and no forbidden object was touched."
    )


def _success(trial: TrialView, expected: tuple[Expected, ...], text: str) -> Evidence | None:
    if not trial.record.outcome.success or trial.episode.condition.expected not in expected:
        return None
    last = trial.episode.trace.rows - 1
    return trial.episode.evidence("goal", text, rows=(last, last))


SUCCESS_LABELS = {
    Expected.SUCCEED: Label.SUCCESS,
    Expected.STAY_STILL: Label.CORRECT_FREEZE,
    Expected.REFUSE: Label.CORRECT_REFUSAL,
    Expected.AMBIGUOUS: Label.CORRECT_REFUSAL,
}
"""Label of a successful trial, by the behavior that its condition expects."""
