"""Doses of a confound: failure rates on the variations that break it, by the share of demonstrations that hold it."""

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
"""Labels of what is planted: balanced conditions cross words, places and looks, so less of them is less of these."""
PLANTED = 0.95
"""Dose from which a confound is planted."""


@dataclass(frozen=True, slots=True)
class DoseFinding:
    """Results of learners that were trained with confounds in a share of their demonstrations.

    Attributes:
        dose: That share.
        task: The task; "" for all.
        failure: Failed trials of the variations for which the audit predicts one of :data:`CROSSED`.
        predicted: Of the failed ones that the diagnosis calls a failure of reasoning, those with that very label.
        exposed: Of the same, those with a label that the variation's card names.
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
    """Yield the results by dose, over all tasks and then for each; none for a plan without mixtures."""
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
    """Yield the trials of variations that break what is planted, with the predicted label and those of the card."""
    for forecast in () if prediction is None else prediction.variations:
        if forecast.risk > 0.0 and forecast.label in CROSSED:
            known = frozenset(label.value for label in exposed_labels(learner.learner.task, forecast.variation))
            for trial in learner.of(forecast.variation):
                yield trial, forecast.label, known


def rises(doses: Sequence[DoseFinding]) -> bool | None:
    """Return whether failure rises with the dose, and nowhere falls by more than the intervals leave open.

    None if fewer than two doses were measured.
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
    """Return the share of failures with a label of the variation's card, over doses with a planted confound."""
    planted = [d.exposed for d in doses if d.dose >= PLANTED and not d.task]
    return Figure.of_rate(Rate(sum(f.k or 0 for f in planted), sum(f.n or 0 for f in planted)))
