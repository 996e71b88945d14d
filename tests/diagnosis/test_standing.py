"""A policy among the pretenders: the nearest one, the reference lines and what a score proves."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
from tests.diagnosis.small_matrix import L1, R1, T1, failing, matrix, solving

from betterbench.diagnosis.measures import power_matrix
from betterbench.diagnosis.measures import standing as standing_module
from betterbench.diagnosis.measures.standing import standing_of
from betterbench.diagnosis.verdict import Evidence, Label, RunDiagnosis, TrialDiagnosis
from betterbench.errors import RecordError
from betterbench.statistics import Rate
from betterbench.tasks import Expected, get_task


def trial(variation: str | None, seed: int, *, success: bool, task: str = "fast_food") -> TrialDiagnosis:
    axis = {"L": "spatial_layout_shift", "R": "primitive_recomposition", "T": "temporal_extrapolation"}
    label = Label.SUCCESS if success else Label.WRONG_OBJECT
    return TrialDiagnosis(
        task=task, variation=variation, condition="train1", axis=None if variation is None else axis[variation[0]],
        seed=seed, policy="p", instruction="Put it there.", success=success, expected="succeed", label=label,
        first_attempt=None, first_attempt_kind=None, first_slot=None, intended=None, intended_kind=None,
        intended_any=(), intention_correct=success, progress=float(success), attempts=(),
        evidence=Evidence("r", "t", 0.0, 1.0), collisions=0, steps=1, duration_s=1.0, record="r",
    )  # fmt: skip


def run(outcomes: dict[str | None, list[bool]], *, versions: dict[str, str] | None = None) -> RunDiagnosis:
    trials = tuple(trial(v, i, success=s) for v, values in outcomes.items() for i, s in enumerate(values))
    return RunDiagnosis("p", trials, (), (), (), {}, versions or {})


LIKE_LEXICAL = {"L1": [False] * 10, "R1": [True] * 10, None: [True] * 3}


def test_the_nearest_pretender_is_the_one_whose_outcomes_agree():
    found = standing_of(run(LIKE_LEXICAL), matrix())
    assert found.nearest is not None
    assert found.nearest.pretender == "zoo:lexical"
    assert found.nearest.agreement == 1.0
    assert found.rivals == ()
    assert found.expert is not None
    assert found.expert.agreement == 0.5
    assert found.covered == Rate(20, 20)
    assert found.notice == ""
    assert found.sentences()[0].startswith("Nearest pretender: zoo:lexical, whose outcomes agree")
    agreement = {x.pretender: x for x in found.likenesses}
    assert agreement["zoo:halt"].agreement == 0.5
    assert 0.0 <= agreement["zoo:halt"].low <= 0.5 <= agreement["zoo:halt"].high <= 1.0
    assert "expert" not in agreement


def test_pretenders_that_agree_as_well_are_named_too():
    found = standing_of(run({"R1": [True] * 4}), matrix())
    assert found.nearest is not None
    assert {found.nearest.pretender, *found.rivals} >= {"zoo:lexical", "zoo:shape", "probe:replay"}


def test_reference_lines_weigh_variations_as_the_run_does():
    found = standing_of(run({"L1": [True] * 30, "R1": [True] * 10}), matrix())
    lines = {line.pretender: line.scores for line in found.lines}
    assert lines["zoo:lexical"]["overall"] == 0.25
    assert lines["zoo:lexical"]["axis:spatial_layout_shift"] == 0.0
    assert lines["zoo:lexical"]["axis:primitive_recomposition"] == 1.0
    assert lines["expert"]["overall"] == 1.0
    assert found.scores["overall"] == 1.0
    assert "axis:temporal_extrapolation" not in lines["expert"]
    assert next(iter(found.lines)).pretender == "expert"


def test_a_score_proves_what_it_has_above_the_ceiling():
    found = standing_of(run({"L1": [True] * 20, "R1": [True] * 20}), matrix())
    margins = {m.variation: m for m in found.margins}
    assert margins["L1"].margin.value == 0.5
    assert margins["L1"].margin.low > 0.0
    assert not margins["L1"].control
    assert margins["R1"].control
    assert found.proven == Rate(1, 1)
    assert standing_of(run({"L1": [True, False] * 10}), matrix()).proven == Rate(0, 1)


def test_what_the_matrix_lacks_is_said_and_left_out():
    found = standing_of(run({"L1": [True] * 4, "T1": [True] * 4}), matrix())
    assert found.covered == Rate(4, 8)
    assert "does not contain fast_food" in found.notice
    assert T1 not in {(m.task, m.variation) for m in found.margins}
    assert {(m.task, m.variation) for m in found.margins} == {L1}


@pytest.mark.parametrize("versions", [{"task_version:fast_food": "0"}, {}])
def test_a_stale_matrix_is_named_with_its_cure(versions):
    old = matrix() if versions else dataclasses.replace(matrix(), versions={})
    found = standing_of(run(LIKE_LEXICAL, versions=versions), old)
    assert found.lines == found.margins == ()
    assert found.nearest is None
    assert "another version of fast_food" in found.notice
    assert "better calibrate --power" in found.notice
    assert found.sentences() == (found.notice,)


def test_a_task_of_a_suite_folder_is_measured_with_its_suite(monkeypatch):
    """The command alone would measure the packaged suite, and its result would not be read for this folder."""
    monkeypatch.setattr(power_matrix, "suite_folder_of", lambda tasks: Path("/my suites/lunch-0") if tasks else None)
    said = standing_of(run({"T1": [True] * 4}), matrix()).notice
    command = "better calibrate --power --suite '/my suites/lunch-0' --out runs/power"
    assert f"does not contain fast_food; measure it with {command}, and copy runs/power/power.json into" in said
    assert said.endswith("'/my suites/lunch-0'.")


def test_a_task_of_a_file_is_told_that_only_suites_have_a_matrix(monkeypatch):
    monkeypatch.setattr(power_matrix, "options_for", lambda tasks: " --task-file mine.py" if tasks else "")
    said = standing_of(run({"T1": [True] * 4}), matrix()).notice
    assert "write the task into a suite folder (docs/own-tasks.md)" in said


def test_no_matrix_and_a_spoilt_one_are_named_and_nothing_breaks(monkeypatch):
    monkeypatch.setattr(standing_module, "power_matrix_of", lambda _: None)
    found = standing_of(run(LIKE_LEXICAL))
    assert "no power matrix" in found.notice
    assert found.covered == Rate(0, 20)

    def spoilt(_tasks: object) -> None:
        raise RecordError("power.json is not JSON")

    monkeypatch.setattr(standing_module, "power_matrix_of", spoilt)
    assert "cannot be read" in standing_of(run(LIKE_LEXICAL)).notice


def test_the_json_form_holds_everything():
    form = json.loads(json.dumps(standing_of(run(LIKE_LEXICAL), matrix()).to_json()))
    assert form["nearest_pretender"]["pretender"] == "zoo:lexical"
    assert {line["pretender"] for line in form["reference_lines"]} >= {"expert", "random", "noop", "zoo:lexical"}
    assert form["margins"][0]["ceiling"] == {"pretender": "zoo:shape", "k": 3, "n": 6}


def test_a_run_without_variations_has_nothing_to_compare():
    found = standing_of(run({None: [True] * 3}), matrix())
    assert found.nearest is None
    assert found.margins == ()


def test_the_same_run_gives_the_same_interval_in_any_order():
    one = standing_of(run(LIKE_LEXICAL), matrix())
    other = run(LIKE_LEXICAL)
    assert standing_of(dataclasses.replace(other, trials=other.trials[::-1]), matrix()).likenesses == one.likenesses


def test_a_pretender_without_a_cell_is_no_candidate():
    found = standing_of(run(LIKE_LEXICAL), matrix(zoo_lexical={L1: failing("early_halt")}))
    assert "zoo:lexical" not in {x.pretender for x in found.likenesses}
    assert standing_of(run({"R1": [True]}), matrix(zoo_x={R1: solving()})).nearest is not None


def test_a_run_of_the_fruit_basket_has_reference_lines():
    """Its suite has a packaged matrix of its own."""
    names = [v.name for v in get_task("fruit_basket").variations if v.expected is not Expected.AMBIGUOUS]
    outcomes = tuple(
        dataclasses.replace(trial("L1", seed, success=name not in ("O6", "T7"), task="fruit_basket"), variation=name)
        for name in names
        for seed in range(3)
    )
    found = standing_of(RunDiagnosis("p", outcomes, (), (), (), {}, {}))
    assert found.covered == Rate(42, 42)
    assert found.notice == ""
    lines = {line.pretender: line.scores["overall"] for line in found.lines}
    assert lines["zoo:inertia"] == pytest.approx(12 / 14)
    assert lines["random"] == 0.0 < lines["probe:replay"] < lines["expert"]
    assert found.nearest is not None
    assert found.nearest.pretender == "zoo:inertia"
    assert found.nearest.agreement == 1.0
