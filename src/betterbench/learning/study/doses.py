"""Dose response of a confound: the failure rate on variations that break the confound, as a function of its dose.

A confound is a property that always coincides with another in the demonstrations, such as a word that always goes with
the same place. The dose is the fraction of the demonstrations that have the confound.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from betterbench.demonstrations.shortcuts.prediction import Prediction
from betterbench.diagnosis.failure_mode import exposed_labels
from betterbench.learning.study.outcomes import LearnerOutcome, TrialOutcome
from betterbench.learning.study.plan import StudyPlan
from betterbench.report.wording import Figure
from betterbench.statistics import Rate
from betterbench.tasks.labels import Kind, Label

CROSSED = (Label.LEXICAL_KINEMATIC_SHORTCUT, Label.VISUAL_LAYOUT_BIAS, Label.SEMANTIC_FEATURE_COLLAPSE)
"""Failure labels that the planted confounds cause. Balanced conditions combine words, places and appearances in all
ways, which reduces these confounds.
"""
PLANTED = 0.95
"""A confound counts as planted if at least this fraction of the demonstrations has it."""


@dataclass(frozen=True, slots=True)
class DoseFinding:
    """Results of learners that were trained on demonstrations with confounds at a given dose.

    Attributes:
        dose: Fraction of the demonstrations that have the confounds.
        arm: Name of the arm.
        task: Task name; "" for all tasks.
        failure: Failure rate on the variations for which the shortcut audit predicts one of the labels in
            :data:`CROSSED`.
        predicted: Fraction of the reasoning failures on these variations that have the predicted label.
        exposed: Fraction of the same failures that have a label listed on the variation's task card.
    """

    dose: float
    arm: str
    task: str
    failure: Figure
    predicted: Figure
    exposed: Figure


def doses_of(
    plan: StudyPlan, learners: Sequence[LearnerOutcome], predictions: Mapping[str, Prediction]
) -> Iterator[DoseFinding]:
    """Yield the results for each dose, first over all tasks and then for each task.

    If no arm of the plan mixes training distributions, there are no doses to compare, and nothing is yielded.
    """
    if all(len(shares) == 1 for shares in plan.arms.values()):
        return
    for task in ("", *plan.tasks):
        for dose, arm in sorted(
            (plan.dose_of(arm), arm) for arm, shares in plan.arms.items() if "covered" not in shares
        ):
            mine = [f for f in learners if f.learner.arm == arm and task in ("", f.learner.task)]
            trials = [found for f in mine for found in _matching(f, predictions.get(f.learner.task))]
            lost = [found for found in trials if not found[0].success]
            decided = [found for found in lost if Label(found[0].label).kind is Kind.REASONING]
            predicted = sum(trial.label == label for trial, label, _ in decided)
            exposed = sum(trial.label in known for trial, _, known in decided)
            yield DoseFinding(
                dose,
                arm,
                task,
                Figure.of_rate(Rate(len(lost), len(trials))),
                Figure.of_rate(Rate(predicted, len(decided))),
                Figure.of_rate(Rate(exposed, len(decided))),
            )


def _matching(
    learner: LearnerOutcome, prediction: Prediction | None
) -> Iterator[tuple[TrialOutcome, str, frozenset[str]]]:
    """Yield the trials of variations that break a planted confound.

    Each trial is yielded with the label that the audit predicts and with the labels on the task card.
    """
    for forecast in () if prediction is None else prediction.variations:
        if forecast.risk > 0.0 and forecast.label in CROSSED:
            known = frozenset(label.value for label in exposed_labels(learner.learner.task, forecast.variation))
            for trial in learner.of(forecast.variation):
                yield trial, forecast.label, known


def rises(doses: Sequence[DoseFinding]) -> bool | None:
    """Return whether the failure rate increases with the dose and never decreases significantly between two doses.

    Return None if fewer than two doses were measured.
    """
    ends = [
        (d.failure.value, d.failure.low, d.failure.high)
        for d in doses
        if d.failure.value is not None and d.failure.low is not None and d.failure.high is not None
    ]
    if len(ends) < 2:
        return None
    falls = any(later[2] < earlier[1] for i, earlier in enumerate(ends) for later in ends[i + 1 :])
    return ends[-1][0] > ends[0][0] and not falls


def named_when_planted(doses: Sequence[DoseFinding]) -> Figure:
    """Return the fraction of reasoning failures with a label on the variation's task card.

    Only doses of at least :data:`PLANTED` are included.
    """
    planted = [d.exposed for d in doses if d.dose >= PLANTED and not d.task]
    return Figure.of_rate(Rate(sum(f.k or 0 for f in planted), sum(f.n or 0 for f in planted)))
