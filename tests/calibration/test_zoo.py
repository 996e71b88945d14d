"""The instrument is calibrated: policies with one known fault each are found out, and nothing else is said of them."""

from __future__ import annotations

import dataclasses

import pytest
from tests.daily import TODAY, in_turn

from betterbench.calibration import CalibrationPolicy, calibrate, true_label
from betterbench.calibration.run import assess, run_plans
from betterbench.diagnosis import Calibration, Label, RunDiagnosis, diagnose_run
from betterbench.evaluation import evaluate, make_plan
from betterbench.policies.experts import Address
from betterbench.records import RunFolder


def calibrated(tmp_path, policy: str, tasks: tuple[str, ...], *, trials: int = 1, strength: float = 1.0) -> Calibration:
    return calibrate([CalibrationPolicy(Address(policy, strength), trials, 40)], tmp_path, tasks=tasks)


def calibrated_quickly(tmp_path, policy: str, task: str, variations: tuple[str, ...]) -> Calibration:
    """On some variations of one task and the training conditions that they are compared with."""
    plan = make_plan(policy, tasks=(task,), variations=variations, trials=1, seed=40, observation="state_only")
    return assess(run_plans({policy.replace(":", "-"): plan}, tmp_path))


def diagnosed(tmp_path_factory, policy: str, **options) -> RunDiagnosis:
    folder = tmp_path_factory.mktemp("zoo") / policy.replace(":", "-")
    return diagnose_run(evaluate(make_plan(policy, **options), folder, workers=1))


WORDS = {"L1": 1.0, "L2": 1.0, "L3": 0.0, "L4": 0.0, "training": 1.0}
"""Intention accuracy of the lexical policy in the variations of `morning_coffee` that change the words."""


@pytest.mark.parametrize("variations", [("L1", "L3"), pytest.param((), marks=pytest.mark.slow, id="all")])
def test_lexical_fails_the_counterfactual_words_only(tmp_path_factory, variations):
    lexical = diagnosed(
        tmp_path_factory, "zoo:lexical", tasks=("morning_coffee",), variations=variations, trials=1, seed=40
    )
    asked = {*variations, "training"} if variations else WORDS.keys()
    for name in asked:
        metric = lexical.metric("intention_accuracy", f"morning_coffee/{name}")
        assert metric is not None
        assert metric.value == WORDS[name], name
    shortcuts = {t.variation for t in lexical.trials if t.label is Label.LEXICAL_KINEMATIC_SHORTCUT}
    assert shortcuts == {"L3", "L4"} & asked


CLUMSY = () if TODAY % 2 else pytest.mark.slow
"""A policy that is found out by its motion, and one by what it skips, take turns."""


@pytest.mark.parametrize(
    ("policy", "task", "variations", "found"),
    [
        pytest.param("zoo:clumsy", "morning_coffee", ("L1",), Label.EXECUTION_FAILURE, marks=CLUMSY),
        pytest.param("zoo:clumsy", "morning_coffee", (), Label.EXECUTION_FAILURE, marks=pytest.mark.slow),
        pytest.param("zoo:habit-place", "desk_meeting", (), Label.BEHAVIORAL_INERTIA, marks=pytest.mark.slow),
    ],
)
def test_a_policy_is_found_out_and_nothing_else_is_said(tmp_path, policy, task, variations, found):
    calibration = calibrated_quickly(tmp_path, policy, task, variations)
    assert calibration.wrong == ()
    assert calibration.counts[found, found] > 0


def test_the_diagnosis_never_reads_the_truth(tmp_path):
    """The ground_truth of the journal are taken away, and every label stays what it was."""
    calibrated_quickly(tmp_path, "zoo:color", "morning_coffee", ("O1",))
    run = RunFolder.open(tmp_path / "zoo-color")
    before = [(t.key, t.label, t.evidence) for t in diagnose_run(run).trials]
    text = run.journal_path.read_text()
    assert "semantic_feature_collapse" in text
    assert any(label is Label.SEMANTIC_FEATURE_COLLAPSE for _, label, _ in before)
    entries = run.entries()
    run.journal_path.unlink()
    with run.journal() as journal:
        for entry in entries:
            changed = {
                k: v.replace("semantic_feature_collapse", "order_violation") for k, v in entry.ground_truth.items()
            }
            journal.append(dataclasses.replace(entry, ground_truth=changed))
    assert "semantic_feature_collapse" not in run.journal_path.read_text()
    assert [(t.key, t.label, t.evidence) for t in diagnose_run(run).trials] == before


@in_turn(0, 2)
def test_progress_cue_skips_the_burger_when_only_one_is_there(tmp_path):
    plan = make_plan("zoo:progress-cue", tasks=("fast_food",), variations=("T1",), trials=1, seed=40)
    plan = dataclasses.replace(plan, trials=tuple(t for t in plan.trials if t.variation == "T1"))
    (changed,) = diagnose_run(evaluate(plan, tmp_path / "run", workers=1)).trials
    # A trial of one variation cannot tell a skipped step from a favorite place; a whole run can.
    assert changed.label.value == "wrong_object"
    assert changed.evidence.rule == "required_step_skipped"
    assert "causal_confusion" in changed.evidence.candidates
    assert changed.first_attempt == "fries"


@pytest.mark.slow
@pytest.mark.parametrize("strength", [1.0, 0.3])
@pytest.mark.parametrize("policy", ["zoo:lexical", "zoo:layout", "zoo:inertia", "zoo:sequence", "zoo:reorder"])
def test_first_attempt_rules_are_told_apart_on_all_tasks(tmp_path, policy, strength):
    calibration = calibrated(tmp_path, policy, (), strength=strength)
    overall = calibration.overall
    assert overall.value is not None
    # A rule that is followed now and then shows itself in one attempt per task here, which other rules explain as well.
    least = 0.97 if strength == 1.0 else 0.95
    if policy == "zoo:lexical":  # 94.0 % of 134 in docs/calibration.md: in some variations, the word and the slot agree
        least = 0.92
    assert overall.value >= least, [f"{j.trial}: {j.truth} called {j.label}" for j in calibration.wrong]


@pytest.mark.slow
def test_inertia_loses_the_novel_composition(tmp_path_factory):
    diagnosis = diagnosed(tmp_path_factory, "zoo:inertia", tasks=("fast_food",), trials=4, seed=60)
    delta = diagnosis.metric("delta_sr", "fast_food/R1")
    assert delta is not None
    assert delta.value is not None
    assert delta.value <= -0.45


def test_a_policy_outside_the_zoo_has_no_truth():
    assert true_label({"truth": ""}, expected="succeed", success=True) is Label.SUCCESS
