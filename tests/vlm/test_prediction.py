"""Whether a static score predicts the illusion gap: runs of both kinds, paired by policy, and few policies."""

from __future__ import annotations

import pytest
from tests.vlm.sighted import Sighted, own_set

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError
from betterbench.evaluation import evaluate, make_plan
from betterbench.vlm import RunSettings, evaluate_model, find_benchmark
from betterbench.vlm.prediction import PolicyPoint, predictions_of
from betterbench.vlm.prompts import find_prompt


def point(name, score, gap, static_gap=None):
    return PolicyPoint(name, score, 100, static_gap, gap, gap - 0.1, gap + 0.1, 20, 0.9, 0.9 - gap)


def test_nothing_is_concluded_from_fewer_than_five_policies():
    (found,) = predictions_of([point(str(i), 0.1 * i, 0.9 - 0.1 * i) for i in range(4)])
    assert found.correlation.value == pytest.approx(-1.0)
    assert not found.is_supported
    assert found.sentence.startswith("static score: 4 policies are too few for a conclusion (rank correlation -1.00")


def test_a_perfect_ranking_of_six_policies_is_a_conclusion_with_its_direction():
    policies = [point(str(i), 0.1 * i, 0.9 - 0.1 * i, static_gap=0.1 * (i % 2)) for i in range(6)]
    score, gap = predictions_of(policies)
    assert score.is_supported
    assert "A higher value goes with a smaller gap" in score.sentence
    assert (gap.predictor, gap.is_supported) == ("static gap", False)
    assert gap.sentence.startswith("static gap: the 6 policies do not allow a conclusion")


def test_policies_without_differences_and_a_single_policy():
    (found,) = predictions_of([point(str(i), 0.5, 0.1 * i) for i in range(6)])
    assert found.sentence == "static score: all 6 policies have the same value, so there is no correlation."
    with pytest.raises(InvalidInputError, match="a single policy cannot be ranked"):
        predictions_of([point("a", 0.5, 0.1)])


@pytest.fixture(scope="module")
def acted(tmp_path_factory):
    """Returns the folders of the runs of two policies."""
    folder = tmp_path_factory.mktemp("acted")
    for policy in ("noop", "random"):
        plan = make_plan(policy, tasks=["morning_coffee"], variations=["T1"], trials=1, observation="state_only")
        evaluate(plan, folder / policy, workers=1)
    return [str(folder / policy) for policy in ("noop", "random")]


@pytest.mark.physics
def test_compare_pairs_static_and_acted_runs_by_name_or_order(acted, tmp_path, capsys):
    items, settings = own_set(tmp_path / "set", 40), RunSettings(find_prompt("better-vqa", None))
    for name in ("a", "b"):
        evaluate_model(find_benchmark("better-vqa"), items, Sighted(20, "native"), tmp_path / name, settings)
    static = [str(tmp_path / name) for name in ("a", "b")]
    assert main(["compare", *static, *acted]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "all 2 policies have the same value" in out
    assert main(["compare", *static, *acted, "--json"]) == 0
    assert '"predictor": "static score"' in capsys.readouterr().out
    named = [word for name in ("x", "y", "y", "x") for word in ("--name", name)]
    assert main(["compare", *static, *acted, *named]) == 0
    capsys.readouterr()
    assert main(["compare", *static, acted[0]]) == 2
    assert "has no run of better eval for the same policy" in " ".join(capsys.readouterr().err.split())
    assert main(["compare", *static, *acted, "--name", "x"]) == 2
    assert "1 names for 4 runs" in " ".join(capsys.readouterr().err.split())
