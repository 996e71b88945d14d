"""Computation of the true label of a faulty policy's trial from the policy's decisions and the trial's success."""

from __future__ import annotations

from collections.abc import Mapping

from betterbench.diagnosis import Label
from betterbench.diagnosis.modes.success import SUCCESS_LABELS
from betterbench.errors import RecordError
from betterbench.tasks import Expected


def true_label(ground_truth: Mapping[str, str], *, expected: str, success: bool) -> Label:
    """Return the true label of a trial of a faulty policy.

    A successful trial gets a success label, regardless of the policy's decisions. Otherwise, the first wrong decision
    of the policy determines the label. If all decisions were correct, the trial is an execution failure.

    Args:
        ground_truth: Ground truth about the episode, which the policy wrote to the journal.
        expected: Expected behavior in the condition: "succeed", "refuse" or "stay_still".
        success: Whether the trial succeeded, according to the goal tracker during the episode.

    Raises:
        RecordError: If the policy reported no ground truth.
    """
    if "truth" not in ground_truth:
        raise RecordError("The journal contains no true label. Only faulty policies report one; run the policy again.")
    if success:
        return SUCCESS_LABELS[Expected(expected)]
    return Label(ground_truth["truth"]) if ground_truth["truth"] else Label.EXECUTION_FAILURE
