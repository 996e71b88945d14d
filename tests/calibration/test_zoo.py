"""The instrument is calibrated: policies with one known fault each are found out, and nothing else is said of them."""

from __future__ import annotations

import pytest

from betterbench.diagnosis import RunDiagnosis, diagnose_run
from betterbench.evaluation import evaluate, make_plan
from betterbench.experts import expert_names, true_label


def diagnosed(tmp_path_factory, policy: str, **options) -> RunDiagnosis:
    folder = tmp_path_factory.mktemp("zoo") / policy.replace(":", "-")
    return diagnose_run(evaluate(make_plan(policy, **options), folder, workers=1))


def mistakes(diagnosis: RunDiagnosis) -> list[str]:
    return [
        f"{t.key}: {t.label.value}, should be {true_label(t.policy, t.task, t.variation or t.condition)}"
        for t in diagnosis.trials
        if t.label.value != true_label(t.policy, t.task, t.variation or t.condition)
    ]


@pytest.fixture(scope="module")
def lexical(tmp_path_factory):
    return diagnosed(tmp_path_factory, "zoo:lexical", tasks=("morning_coffee",), trials=2, seed=40)


def test_lexical_fails_the_counterfactual_words_only(lexical):
    assert mistakes(lexical) == []
    for name, wanted in {"L1": 1.0, "L2": 1.0, "L3": 0.0, "L4": 0.0, "training": 1.0}.items():
        metric = lexical.metric("intention_accuracy", f"morning_coffee/{name}")
        assert metric is not None
        assert metric.value == wanted, name


def test_clumsy_is_execution_and_not_reasoning(tmp_path_factory):
    diagnosis = diagnosed(tmp_path_factory, "zoo:clumsy", tasks=("morning_coffee",), trials=2, seed=40)
    assert mistakes(diagnosis) == []
    reasoning = diagnosis.metric("reasoning_failure_rate", "overall")
    assert reasoning is not None
    assert reasoning.k == 0


def test_progress_cue_skips_the_burger_when_only_one_is_there(tmp_path_factory):
    diagnosis = diagnosed(
        tmp_path_factory, "zoo:progress-cue", tasks=("fast_food",), variations=("T1",), trials=2, seed=40
    )
    assert mistakes(diagnosis) == []
    changed = [t for t in diagnosis.trials if t.variation == "T1"]
    assert [t.label.value for t in changed] == ["causal_confusion"] * 2
    assert all(t.first_attempt == "fries" for t in changed)


@pytest.mark.slow
@pytest.mark.parametrize("policy", expert_names())
def test_every_policy_gets_its_true_label(tmp_path_factory, policy):
    diagnosis = diagnosed(tmp_path_factory, policy, trials=3, seed=60)
    wrong = mistakes(diagnosis)
    assert len(wrong) <= 0.05 * len(diagnosis.trials), "\n".join(wrong)


@pytest.mark.slow
def test_inertia_loses_the_novel_composition(tmp_path_factory):
    diagnosis = diagnosed(tmp_path_factory, "zoo:inertia", tasks=("fast_food",), trials=4, seed=60)
    delta = diagnosis.metric("delta_sr", "fast_food/R1")
    assert delta is not None
    assert delta.value is not None
    assert delta.value <= -0.45
