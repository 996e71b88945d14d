"""Doses of a confound: what is counted, and when failure is said to rise."""

from __future__ import annotations

import pytest

from betterbench.demonstrations.shortcuts.prediction import Forecast, Prediction
from betterbench.learning.study.doses import DoseFinding, doses_of, named_when_planted, rises
from betterbench.learning.study.outcomes import LearnerOutcome, TrialOutcome
from betterbench.learning.study.plan import PlannedLearner, read_study_plan
from betterbench.report.wording import Figure
from betterbench.statistics import Rate

TASK = "morning_coffee"
PLAN = read_study_plan(
    {
        "tasks": [TASK],
        "arms": {"half": {"training": 0.5, "balanced": 0.5}, "all": {"training": 1.0}, "tests": {"covered": 1.0}},
        "seeds": [0],
    }
)


def predicted(**labels: tuple[float, str]) -> dict[str, Prediction]:
    forecasts = tuple(
        Forecast(rank, TASK, variation, "lexical", risk, label, ())
        for rank, (variation, (risk, label)) in enumerate(labels.items(), 1)
    )
    made = Prediction("betterbench-prediction", 1, "0", "better60", "made up", "0" * 64, "", (TASK,), forecasts)
    return {TASK: made}


def learner(arm: str, *labels: tuple[str, str]) -> LearnerOutcome:
    trials = [
        TrialOutcome(variation, "train1", seed, label == "success", label, label == "success", "near")
        for seed, (variation, label) in enumerate(labels)
    ]
    return LearnerOutcome(PlannedLearner(TASK, arm, 0), tuple(trials))


def finding(dose: float, k: int, n: int, *, named: tuple[int, int] = (0, 0), task: str = "") -> DoseFinding:
    none = Figure.of_rate(Rate(0, 0))
    return DoseFinding(dose, f"dose-{dose:g}", task, Figure.of_rate(Rate(k, n)), none, Figure.of_rate(Rate(*named)))


def test_counted_is_what_breaks_a_word_a_place_or_a_look():
    predictions = predicted(
        L3=(0.9, "lexical_kinematic_shortcut"), L1=(0.0, ""), T1=(0.8, "behavioral_inertia"),
        O1=(0.7, "semantic_feature_collapse"),
    )  # fmt: skip
    mixed = learner(
        "half", ("L3", "success"), ("L3", "lexical_kinematic_shortcut"), ("T1", "timeout"), ("L1", "timeout")
    )
    planted = learner(
        "all", ("L3", "lexical_kinematic_shortcut"), ("L3", "visual_layout_bias"), ("L3", "timeout"),
        ("O1", "execution_failure"), ("O1", "semantic_feature_collapse"),
    )  # fmt: skip
    found = list(doses_of(PLAN, [mixed, planted, learner("tests", ("L3", "timeout"))], predictions))
    assert [(d.dose, d.arm, d.task) for d in found] == [
        (0.5, "half", ""), (1.0, "all", ""), (0.5, "half", TASK), (1.0, "all", TASK),
    ]  # fmt: skip
    half, whole = found[:2]
    assert (half.failure.k, half.failure.n) == (1, 2)
    assert (whole.failure.k, whole.failure.n) == (5, 5)
    assert (whole.predicted.k, whole.predicted.n) == (2, 3), "time and execution say nothing about a cause"
    assert whole.exposed.k in (2, 3)
    assert (half.predicted.k, half.predicted.n) == (1, 1)


def test_a_plan_without_mixtures_has_no_doses():
    plan = read_study_plan({"tasks": [TASK], "arms": {"all": {"training": 1.0}}})
    assert list(doses_of(plan, [learner("all", ("L3", "timeout"))], predicted(L3=(0.9, "timeout")))) == []


@pytest.mark.parametrize(
    ("counts", "found"),
    [
        ([(2, 16), (5, 16), (12, 16), (16, 16)], True),
        ([(2, 16), (6, 16), (5, 16), (16, 16)], True),  # a fall that the intervals leave open
        ([(2, 16), (16, 16), (3, 16), (16, 16)], False),
        ([(9, 16), (9, 16), (9, 16), (9, 16)], False),
        ([(16, 16), (2, 16)], False),
        ([(16, 16)], None),
        ([(0, 0), (0, 0)], None),
    ],
)
def test_failure_rises_with_the_dose_or_it_does_not(counts, found):
    assert rises([finding(0.1 * i, k, n) for i, (k, n) in enumerate(counts, 1)]) is found


def test_what_is_named_counts_planted_doses_of_all_tasks_once():
    findings = [
        finding(0.85, 9, 10, named=(0, 9)), finding(0.95, 9, 10, named=(8, 9)), finding(1.0, 10, 10, named=(10, 10)),
        finding(1.0, 10, 10, named=(10, 10), task=TASK),
    ]  # fmt: skip
    named = named_when_planted(findings)
    assert (named.k, named.n) == (18, 19)
