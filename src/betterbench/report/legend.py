"""Names of labels and axes on the page, with a one-sentence explanation of each label."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from betterbench.diagnosis.failure_mode import FailureMode
from betterbench.diagnosis.modes import MODES
from betterbench.diagnosis.verdict import RunDiagnosis
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


NOT_JUDGED: dict[str, str] = {"right": "Right", "execution": "Failure, cause not judged", "system": "System failure"}
"""Families of runs in worlds that judge only the outcome of a trial."""

_OUTCOMES = (Label.SUCCESS, Label.TIMEOUT, Label.POLICY_ERROR, Label.UNFINISHED)
"""Labels of trials in worlds that judge only the outcome of a trial."""

_UNMET = "The step limit was reached before the goal."
"""Definition of a timeout in worlds that judge only the outcome of a trial."""


def causes_judged(diagnoses: Sequence[RunDiagnosis]) -> bool:
    """Return whether the causes of failures are judged in the world of at least one of the runs."""
    return any(diagnosis.causes_judged for diagnosis in diagnoses)


def families_of(diagnoses: Sequence[RunDiagnosis]) -> dict[str, str]:
    """Return the families of outcomes and their names for the legend. Each family has one color.

    The family of unfinished trials is only included if a trial is unfinished.
    """
    families = FAMILIES if causes_judged(diagnoses) else NOT_JUDGED
    return {**families, **(UNFINISHED if any(d.unfinished for d in diagnoses) else {})}


def modes_of(diagnoses: Sequence[RunDiagnosis]) -> list[FailureMode]:
    """Return the failure modes that the page explains."""
    families = families_of(diagnoses)
    modes = [mode for mode in LEGEND.values() if mode.family in families]
    if causes_judged(diagnoses):
        return modes
    shown = (mode for mode in modes if mode.label in _OUTCOMES)
    return [replace(mode, definition=_UNMET) if mode.label is Label.TIMEOUT else mode for mode in shown]


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
