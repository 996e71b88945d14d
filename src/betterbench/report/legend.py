"""Names of labels and axes on the page, with a one-sentence explanation of each label."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from betterbench.diagnosis.failure_mode import FailureMode
from betterbench.diagnosis.modes import MODES
from betterbench.diagnosis.verdict import TrialDiagnosis
from betterbench.tasks import Axis
from betterbench.tasks.labels import Kind, Label
from betterbench.tasks.worlds.libero_plus import AXES as PLUS_AXES
from betterbench.tasks.worlds.libero_plus import TITLES

LEGEND: Mapping[Label, FailureMode] = MODES
"""Failure mode of every label, in the order in which they are stacked in charts. The texts come from the files of the
failure modes.
"""

FAMILIES: dict[str, str] = {
    "right": "Right",
    "reasoning": "Reasoning failure",
    "execution": "Execution failure",
    "system": "System failure",
}
"""Families of outcomes with their names, in the order in which charts stack them. Each family has one color."""

UNFINISHED: dict[str, str] = {Kind.UNFINISHED.value: "Unfinished"}
"""Family of planned trials that have not ended. It is only shown if there are such trials."""


def families_of(trials: Iterable[TrialDiagnosis]) -> dict[str, str]:
    """Return the families of outcomes and their names for the legend. Each family has one color.

    The family of unfinished trials is only included if a trial is unfinished.
    """
    return {**FAMILIES, **(UNFINISHED if any(t.kind is Kind.UNFINISHED for t in trials) else {})}


AXIS_NAMES: dict[str, str] = {
    Axis.SPATIAL_LAYOUT_SHIFT.value: "Spatial layout shift",
    Axis.PRIMITIVE_RECOMPOSITION.value: "Primitive recomposition",
    Axis.ADVERSARIAL_OBJECT_PERTURBATION.value: "Adversarial object perturbation",
    Axis.TEMPORAL_EXTRAPOLATION.value: "Temporal extrapolation",
    **TITLES,
}
"""Names of the axes in the order of the paper, followed by the axes of LIBERO-Plus."""

AXIS_PLACES: dict[str, str] = {
    Axis.SPATIAL_LAYOUT_SHIFT.value: "where objects are not where they were in training",
    Axis.PRIMITIVE_RECOMPOSITION.value: "where known steps form new combinations",
    Axis.ADVERSARIAL_OBJECT_PERTURBATION.value: "where objects were exchanged",
    Axis.TEMPORAL_EXTRAPOLATION.value: "where more or fewer steps are needed than in training",
    **{axis: f"where {change}" for axis, change in PLUS_AXES.items()},
}
"""Clause that describes the variations of each axis."""

EXPECTED_NAMES: dict[str, str] = {
    "succeed": "reach the goal",
    "refuse": "refuse: the requested object is absent",
    "stay_still": "stay still: the task is already done",
    "ambiguous": "ambiguous: the premise is broken, and no behavior is a failure",
}
"""Description of the correct behavior for each expected outcome."""
