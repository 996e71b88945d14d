"""The three labels of a success: the goal is met, nothing was to be done, or what was asked for is absent."""

from __future__ import annotations

from betterbench.diagnosis.failure_mode import TrialView, failure_mode
from betterbench.diagnosis.verdict import Evidence
from betterbench.tasks import Expected
from betterbench.tasks.labels import Label


@failure_mode(
    Label.SUCCESS,
    name="Success",
    short="solved",
    definition="The goal is met, at rest and released, before the step limit.",
)
def find(trial: TrialView) -> Evidence | None:
    """Return the evidence of a goal that is met."""
    return _success(trial, Expected.SUCCEED, "The goal is met.")


@failure_mode(
    Label.CORRECT_FREEZE,
    name="Correct freeze",
    short="stayed still",
    definition="Nothing was left to do, nothing was touched, and the arm settled.",
)
def find_freeze(trial: TrialView) -> Evidence | None:
    """Return the evidence of an arm that rightly did nothing."""
    return _success(trial, Expected.STAY_STILL, "Nothing was to be done, and nothing was touched.")


@failure_mode(
    Label.CORRECT_REFUSAL,
    name="Correct refusal",
    short="refused",
    definition="What was asked for was absent, and nothing was grasped in its place.",
)
def find_refusal(trial: TrialView) -> Evidence | None:
    """Return the evidence of an arm that rightly took nothing in place of what is absent."""
    return _success(trial, Expected.REFUSE, "The target is absent, and nothing forbidden was touched.")


def _success(trial: TrialView, expected: Expected, text: str) -> Evidence | None:
    if not trial.record.outcome.success or trial.episode.condition.expected is not expected:
        return None
    last = trial.episode.trace.rows - 1
    return trial.episode.evidence("goal", text, rows=(last, last))


SUCCESS_LABELS = {
    Expected.SUCCEED: Label.SUCCESS,
    Expected.STAY_STILL: Label.CORRECT_FREEZE,
    Expected.REFUSE: Label.CORRECT_REFUSAL,
}
"""The label of a success under what is expected."""
