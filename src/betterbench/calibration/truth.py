"""True label of a faulty policy's trial, from the decisions of the policy and the success of the trial."""

from __future__ import annotations

from collections.abc import Mapping

from betterbench.diagnosis import Label
from betterbench.diagnosis.modes.success import SUCCESS_LABELS
from betterbench.errors import RecordError
from betterbench.tasks import Expected


def true_label(ground_truth: Mapping[str, str], *, expected: str, success: bool) -> Label:
    """Return the label that a trial of a faulty policy deserves.

    A trial whose goal is met is a success, whatever was decided on the way (suite, section 5). Otherwise the first
    wrong decision names the fault; and where every decision was right, only the manipulation can have failed.

    Args:
        ground_truth: Ground truth that the policy wrote to the journal about its episode.
        expected: Behavior of a policy that understood the instruction: "succeed", "refuse" or "stay_still".
        success: Whether the trial succeeded, by the goal tracker that ran in the episode.

    Raises:
        RecordError: If the policy said nothing, so that its truth is unknown.
    """
    if "truth" not in ground_truth:
        raise RecordError("The journal holds no true label. Only faulty policies write theirs down; run it again.")
    if success:
        return SUCCESS_LABELS[Expected(expected)]
    return Label(ground_truth["truth"]) if ground_truth["truth"] else Label.EXECUTION_FAILURE
