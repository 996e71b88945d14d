"""Findings of a study: success rates, illusion gaps and their causes, accuracy of the audit, use of the instruction."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from betterbench.demonstrations.shortcuts.facts import facts_of_condition
from betterbench.demonstrations.shortcuts.prediction import Prediction
from betterbench.diagnosis.failure_mode import exposed_labels
from betterbench.learning.study.contrasts import (
    ArmContrast,
    ArmFinding,
    arm_of,
    contrast_of,
    figure_of,
    gap_of,
    success_of,
)
from betterbench.learning.study.doses import DoseFinding, doses_of
from betterbench.learning.study.levers import LeverTable, lever_tables
from betterbench.learning.study.outcomes import LearnerOutcome, TrialOutcome
from betterbench.learning.study.plan import ROLES, StudyPlan
from betterbench.learning.study.vocabulary import never_shown
from betterbench.report.wording import Figure
from betterbench.statistics import (
    Difference,
    Rate,
    ranking_area,
    ratio_of,
)
from betterbench.tasks import Expected, get_task
from betterbench.tasks.authoring.training_distribution import pairing
from betterbench.tasks.interventions import resolve_condition

SOLVED = 0.5
"""A variation counts as solved if the confidence interval of its success rate lies above this value."""
DROPPED = 0.5
"""When the prediction is scored, a variation counts as failed if its success rate is below this fraction of the success
rate in training conditions.
"""
CONTRAST = "balanced against confounded"
"""Name of the main comparison on the page of a study."""
COVERAGE, DECORRELATION = "diverse-confounded against confounded", "balanced against diverse-confounded"
"""Names of the comparisons that separate the effects of coverage and of decorrelation.

In the first comparison, the arms differ in how many conditions are demonstrated. In the second comparison, both arms
demonstrate equally many conditions, but in one of them each word always occurs with the same place.
"""

GapVerdict = Literal[
    "no gap",
    "coverage is enough",
    "decorrelation is enough",
    "needs more than decorrelation",
    "hard for another reason",
    "open",
]
"""Verdict on why learners fail a variation, see :func:`verdict_of`."""


@dataclass(frozen=True, slots=True)
class VariationFinding:
    """Results of the learners on one variation.

    Attributes:
        risk: Risk that the audit of the confounded demonstrations predicts; None if there was no audit.
        predicted: Failure label that the audit predicts; "" if it predicts no failure.
        never_shown: Words, object categories and colors of the variation that are missing from the training data of the
            confounded learners or of the balanced learners.
        success: Success rate by arm.
        gaps: Illusion gap by arm.
        validity: Fraction of the confounded learners' gap that balancing the training data removes; None if there is no
            significant gap.
        verdict: Verdict on why learners fail the variation.
        labels: Failure labels of the confounded learners with their counts, starting with the most frequent.
    """

    task: str
    variation: str
    axis: str
    title: str
    risk: float | None
    predicted: str
    never_shown: tuple[str, ...]
    success: Mapping[str, Figure]
    gaps: Mapping[str, Figure]
    validity: Figure | None
    verdict: GapVerdict
    labels: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class KnownFinding:
    """Results on variations in which all words, categories and colors also occur in the training data of every learner.

    Attributes:
        variations: Number of these variations.
        balanced: Success rate of the balanced learners on these variations.
        contrast: Comparison of the balanced learners with the confounded learners on these variations.
    """

    variations: int
    balanced: Figure
    contrast: ArmContrast


@dataclass(frozen=True, slots=True)
class RepeatedFinding:
    """Replication of the verdict "decorrelation is enough" with learners that did not contribute to the verdict.

    The verdict means that balanced learners solve a variation that confounded learners fail.

    Each training seed is left out in turn. The learners with all other seeds determine which variations have this
    verdict. The balanced learner with the left-out seed is then evaluated on these variations.

    Attributes:
        variations: Number of variations with the verdict, summed over the seeds.
        success: Success rate of the left-out balanced learners on these variations.
    """

    variations: int
    success: Figure


@dataclass(frozen=True, slots=True)
class WordFinding:
    """Rate at which learners change the target of their first grasp attempt when only the instruction changes."""

    arm: str
    changed: Figure
    right: Figure


@dataclass(frozen=True, slots=True)
class PredictionFinding:
    """Accuracy with which the audit predicted the failures of the confounded learners before they were trained.

    Attributes:
        area: Probability that a failed variation had a higher predicted risk than a solved one (AUROC). ``n`` is the
            number of variations.
        failed: Number of failed variations.
        label: Fraction of the failed trials that have the label predicted for their variation.
        exposed: Fraction of the failed trials that have a label listed on their variation's task card.
    """

    area: Figure
    failed: int
    label: Figure
    exposed: Figure


@dataclass(frozen=True, slots=True)
class StudyFindings:
    """All findings of a study that its page shows.

    Attributes:
        roles: Name of the arm that has each role, such as "confounded" or "balanced".
        coverage: Comparisons :data:`COVERAGE` and :data:`DECORRELATION`, over all tasks and by task; empty if the study
            has no arms for them.
        known: Results on variations that contain only words and objects that occur in training; None if the study does
            not have both balanced and confounded arms.
        repeated: Replication of the verdicts with left-out learners; None unless both arms have at least two training
            seeds.
        doses: Results by the fraction of the demonstrations that have confounds; empty if no arm mixes training
            distributions.
    """

    roles: Mapping[str, str]
    arms: tuple[ArmFinding, ...]
    variations: tuple[VariationFinding, ...]
    contrasts: tuple[ArmContrast, ...]
    coverage: tuple[ArmContrast, ...]
    known: KnownFinding | None
    repeated: RepeatedFinding | None
    levers: tuple[LeverTable, ...]
    words: tuple[WordFinding, ...]
    prediction: PredictionFinding | None
    doses: tuple[DoseFinding, ...]

    @property
    def compared(self) -> tuple[ArmContrast, ...]:
        """All comparisons: over all tasks, by task, and on the variations of :class:`KnownFinding`."""
        known = () if self.known is None else (self.known.contrast,)
        return (*self.contrasts, *known, *self.coverage)


def findings_of(
    plan: StudyPlan, learners: Sequence[LearnerOutcome], predictions: Mapping[str, Prediction]
) -> StudyFindings:
    """Compute the findings of a study. They depend only on the arguments.

    Args:
        plan: Plan of the study.
        learners: All learners with their trials.
        predictions: Predicted failures for each task, from the audit of its confounded demonstrations.
    """
    roles = {role: arm for role in ROLES if (arm := plan.arm_in(role)) is not None}
    plain = [f for f in learners if not f.learner.lever]
    variations = tuple(_variations(plan, plain, roles, predictions))
    contrasts: list[ArmContrast] = []
    known = None
    if "confounded" in roles and "balanced" in roles:
        first, second = (_of_arm(plain, roles[role]) for role in ("balanced", "confounded"))
        contrasts = [contrast_of(CONTRAST, task, first, second) for task in ("", *plan.tasks)]
        known = _on_the_known(variations, first, second)
    confounded = _of_arm(plain, roles["confounded"]) if "confounded" in roles else []
    return StudyFindings(
        roles,
        tuple(_arms(plan, learners)),
        variations,
        tuple(contrasts),
        tuple(_coverage(plan, plain, roles)),
        known,
        _repeated(plain, roles),
        tuple(lever_tables(plan, learners)),
        tuple(word_finding(arm, _of_arm(plain, arm)) for arm in plan.arms),
        score_of(confounded, predictions) if confounded and predictions else None,
        tuple(doses_of(plan, plain, predictions)),
    )


def _coverage(plan: StudyPlan, learners: Sequence[LearnerOutcome], roles: Mapping[str, str]) -> Iterator[ArmContrast]:
    """Yield the comparisons that separate the effect of varied demonstrations from the effect of removing confounds.

    A comparison is left out if the plan has no arms for it.
    """
    for name in (COVERAGE, DECORRELATION):
        pair = name.split(" against ")
        if all(role in roles for role in pair):
            first, second = (_of_arm(learners, roles[role]) for role in pair)
            for task in ("", *plan.tasks):
                yield contrast_of(name, task, first, second)


def _on_the_known(
    variations: Sequence[VariationFinding], balanced: Sequence[LearnerOutcome], confounded: Sequence[LearnerOutcome]
) -> KnownFinding:
    """Return the results on variations in which all words and objects also occur in the training data of both arms."""
    known = {(v.task, v.variation) for v in variations if not v.never_shown}
    first, second = (
        [
            replace(
                f, trials=tuple(t for t in f.trials if t.variation is None or (f.learner.task, t.variation) in known)
            )
            for f in learners
        ]
        for learners in (balanced, confounded)
    )
    solved = success_of(trial for f in first for trial in f.varied)
    return KnownFinding(len(known), solved, contrast_of(f"{CONTRAST}, nothing new", "", first, second))


def _repeated(learners: Sequence[LearnerOutcome], roles: Mapping[str, str]) -> RepeatedFinding | None:
    """Return how often balanced learners replicate the verdict "decorrelation is enough".

    Each training seed is left out in turn. The verdict is derived from the learners with the other seeds, and the
    balanced learner with the left-out seed is then evaluated on the variations with this verdict.
    """
    if not {"confounded", "balanced"} <= roles.keys():
        return None
    chosen, trials, seeds = 0, list[TrialOutcome](), 0
    for left_out in _of_arm(learners, roles["balanced"]):
        task = left_out.learner.task
        others = [f for f in learners if f.learner.task == task and f.learner.seed != left_out.learner.seed]
        by_role = {role: _of_arm(others, arm) for role, arm in roles.items()}
        seeds += bool(by_role["confounded"] and by_role["balanced"])
        for name in dict.fromkeys(t.variation for t in left_out.varied):
            success = {role: success_of(t for f in found for t in f.of(name)) for role, found in by_role.items()}
            if verdict_of(success) == "decorrelation is enough":
                chosen += 1
                trials += left_out.of(name)
    return RepeatedFinding(chosen, success_of(trials)) if seeds else None


def _of_arm(learners: Iterable[LearnerOutcome], arm: str, task: str = "") -> list[LearnerOutcome]:
    return [f for f in learners if f.learner.arm == arm and task in ("", f.learner.task)]


def _arms(plan: StudyPlan, learners: Sequence[LearnerOutcome]) -> Iterator[ArmFinding]:
    for lever in ("", *(v.name for v in plan.levers)):
        mine = [f for f in learners if f.learner.lever == lever]
        for task in ("", *plan.tasks):
            for arm in plan.arms:
                chosen = _of_arm(mine, arm, task)
                if chosen:
                    yield arm_of(task, arm, lever, chosen)


def _variations(
    plan: StudyPlan,
    learners: Sequence[LearnerOutcome],
    roles: Mapping[str, str],
    predictions: Mapping[str, Prediction],
) -> Iterator[VariationFinding]:
    for task in plan.tasks:
        for variation in get_task(task).variations:
            name = variation.name
            by_arm = {arm: _of_arm(learners, arm, task) for arm in plan.arms}
            success = {arm: success_of(t for f in found for t in f.of(name)) for arm, found in by_arm.items()}
            gaps = {arm: gap_of(found, name) for arm, found in by_arm.items()}
            counts = {arm: sum(len(f.pairs(name)) for f in found) for arm, found in by_arm.items()}
            forecast = predictions[task].of(task, name) if task in predictions else None
            failed = [t.label for f in by_arm.get(roles.get("confounded", ""), ()) for t in f.of(name) if not t.success]
            compared = [plan.arms[roles[role]] for role in ("confounded", "balanced") if role in roles]
            new = [never_shown(shares, task, name) for shares in compared]
            labels = sorted(Counter(failed).items(), key=lambda item: (-item[1], item[0]))
            yield VariationFinding(
                task,
                name,
                variation.axis.value,
                variation.title,
                None if forecast is None else forecast.risk,
                "" if forecast is None else forecast.label,
                tuple(dict.fromkeys(itertools.chain(*new))),
                success,
                {arm: figure_of(gaps[arm], counts[arm]) for arm in gaps},
                _validity(roles, gaps, counts),
                verdict_of({role: success[arm] for role, arm in roles.items()}),
                tuple(labels),
            )


def _validity(roles: Mapping[str, str], gaps: Mapping[str, Difference], counts: Mapping[str, int]) -> Figure | None:
    """Return the fraction of the confounded learners' gap that balancing the training data removes."""
    if not {"confounded", "balanced"} <= roles.keys():
        return None
    left = ratio_of(gaps[roles["balanced"]], gaps[roles["confounded"]])
    if left is None or left.value is None:
        return None
    n = min(counts[roles["balanced"]], counts[roles["confounded"]])
    return Figure(1.0 - left.value, 1.0 - left.high, 1.0 - left.low, None, n, noun="pairs")


def solves(figure: Figure | None) -> bool | None:
    """Return whether learners solve more than half of the trials. Return None if the data are not conclusive."""
    if figure is None or figure.low is None or figure.high is None:
        return None
    return True if figure.low > SOLVED else False if figure.high < SOLVED else None


def verdict_of(success: Mapping[str, Figure]) -> GapVerdict:
    """Return the verdict on why learners fail a variation.

    Args:
        success: Success rate on the variation by role of the arm.
    """
    confounded, diverse, balanced, covered = (
        solves(success.get(role)) for role in ("confounded", "diverse-confounded", "balanced", "covered")
    )
    if confounded:
        return "no gap"
    if confounded is None:
        return "open"
    if diverse:
        return "coverage is enough"
    if balanced is None:
        return "open"
    if balanced:
        return "decorrelation is enough"
    return "open" if covered is None else "needs more than decorrelation" if covered else "hard for another reason"


def reworded(task: str) -> tuple[str, ...]:
    """Return the variations that differ from their training condition only in the instruction.

    The instruction of such a variation names a different object to be handled first.
    """
    found = []
    for variation in get_task(task).variations:
        twin = resolve_condition(task, variation.base).condition
        test = resolve_condition(task, variation.name).condition
        first, second = (facts_of_condition(c).steps[:1] for c in (twin, test))
        acts = test.expected is Expected.SUCCEED and first and second
        if not acts or pairing(twin)[1] != pairing(test)[1]:
            continue
        if (first[0].thing, first[0].origin) != (second[0].thing, second[0].origin):
            found.append(variation.name)
    return tuple(found)


def word_finding(arm: str, learners: Sequence[LearnerOutcome]) -> WordFinding:
    """Return how often learners change their first target between trials that differ only in the instruction.

    If there is no grasp attempt in one of the two trials, the target counts as unchanged.
    """
    pairs = [p for f in learners for name in reworded(f.learner.task) for p in f.pairs(name)]
    changed = sum(
        twin.target is not None and trial.target is not None and twin.target != trial.target for twin, trial in pairs
    )
    right = sum(bool(trial.intention) for _, trial in pairs)
    return WordFinding(arm, Figure.of_rate(Rate(changed, len(pairs))), Figure.of_rate(Rate(right, len(pairs))))


def score_of(learners: Sequence[LearnerOutcome], predictions: Mapping[str, Prediction]) -> PredictionFinding:
    """Score a prediction: how well it ranks the variations, and how often it predicts the labels of failed trials."""
    risks, failed, named, exposed, count = [], [], 0, 0, 0
    for task, prediction in sorted(predictions.items()):
        mine = [f for f in learners if f.learner.task == task]
        trained = success_of(t for f in mine for t in f.of(None)).value
        for variation in get_task(task).variations:
            trials = [t for f in mine for t in f.of(variation.name)]
            reached = success_of(trials).value
            if trained is None or reached is None:
                continue
            forecast = prediction.of(task, variation.name)
            risks.append(forecast.risk)
            failed.append(reached < DROPPED * trained)
            known = {label.value for label in exposed_labels(task, variation.name)}
            lost = [t.label for t in trials if not t.success]
            count += len(lost)
            named += sum(label == forecast.label for label in lost)
            exposed += sum(label in known for label in lost)
    area = ranking_area(risks, failed)
    low, high = (None, None) if area.value is None else (area.low, area.high)
    return PredictionFinding(
        Figure(area.value, low, high, None, len(risks), noun="variations"),
        sum(failed),
        Figure.of_rate(Rate(named, count)),
        Figure.of_rate(Rate(exposed, count)),
    )
