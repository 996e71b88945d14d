"""Names of labels and axes on the page, and the meaning of each label in one sentence."""

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
"""Every label's entry, in the order in which bars are stacked; it stands in the file of its failure mode."""

FAMILIES: dict[str, str] = {
    "right": "Right",
    "reasoning": "Reasoning failure",
    "execution": "Execution failure",
    "system": "System failure",
}
"""Color families and their names, in the order in which bars are stacked."""

UNFINISHED: dict[str, str] = {Kind.UNFINISHED.value: "Unfinished"}
"""The family of planned trials that have not ended, which is shown where there are some."""


def families_of(trials: Iterable[TrialDiagnosis]) -> dict[str, str]:
    """Return the families with which the outcomes of trials are shown, and their names."""
    return {**FAMILIES, **(UNFINISHED if any(t.kind is Kind.UNFINISHED for t in trials) else {})}


AXIS_NAMES: dict[str, str] = {
    Axis.SPATIAL_LAYOUT_SHIFT.value: "Spatial layout shift",
    Axis.PRIMITIVE_RECOMPOSITION.value: "Primitive recomposition",
    Axis.ADVERSARIAL_OBJECT_PERTURBATION.value: "Adversarial object perturbation",
    Axis.TEMPORAL_EXTRAPOLATION.value: "Temporal extrapolation",
    **TITLES,
}
"""Axes and their names, in the order of the paper; those of LIBERO-Plus come last."""

AXIS_PLACES: dict[str, str] = {
    Axis.SPATIAL_LAYOUT_SHIFT.value: "where things stand elsewhere than in training",
    Axis.PRIMITIVE_RECOMPOSITION.value: "where known steps are combined anew",
    Axis.ADVERSARIAL_OBJECT_PERTURBATION.value: "where objects were exchanged",
    Axis.TEMPORAL_EXTRAPOLATION.value: "where there is more or less to do than in training",
    **{axis: f"where {change}" for axis, change in PLUS_AXES.items()},
}
"""Common property of the variations of each axis, as the end of a sentence."""

EXPECTED_NAMES: dict[str, str] = {
    "succeed": "reach the goal",
    "refuse": "refuse: what is asked for is not there",
    "stay_still": "stay still: it is done already",
}
"""Correct behavior by expected outcome, in words."""
