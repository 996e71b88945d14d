"""The confusion matrix: counted right, read back, and silent about what it cannot know."""

from __future__ import annotations

import dataclasses
import json

import pytest
from tests.diagnosis.small_matrix import matrix

from betterbench.calibration import CalibrationPolicy, calibration_policies, true_label
from betterbench.calibration.chance import chance_of
from betterbench.diagnosis import Calibration, Judged, Kind, Label
from betterbench.errors import InvalidInputError, RecordError, UnknownNameError
from betterbench.policies.experts import EXPERTS, parse_address
from betterbench.report.pages.calibration_page import calibration_markdown, write_calibration_page
from betterbench.report.pages.power_page import blind_sentences, power_markdown, write_power_page
from betterbench.tasks import all_labels

S, E, R, C = Label.SUCCESS, Label.EXECUTION_FAILURE, Label.BEHAVIORAL_INERTIA, Label.CAUSAL_CONFUSION


def judged(truth: Label, label: Label, *, policy: str = "zoo:x", trial: str = "fast_food/T1/0", **more) -> Judged:
    return Judged(policy, trial, truth, label, "decision 0: something", "a_rule", "It did something.", **more)


@pytest.fixture
def calibration() -> Calibration:
    trials = [judged(S, S)] * 6 + [judged(R, R)] * 3 + [judged(R, E)] + [judged(E, E, policy="zoo:y")] * 2
    trials.append(judged(C, R, policy="zoo:y"))
    return Calibration.of(trials, versions={"package_version": "1"})


def test_rates_are_counts_over_counts(calibration):
    assert (calibration.overall.k, calibration.overall.n) == (11, 13)
    assert (calibration.crossed_rate.k, calibration.crossed_rate.n) == (1, 7)
    assert (calibration.failed.k, calibration.failed.n) == (5, 7)
    scores = {s.label: s for s in calibration.scores()}
    assert (scores[R].recall.k, scores[R].recall.n) == (3, 4)
    assert (scores[R].precision.k, scores[R].precision.n) == (3, 4)
    assert (scores[E].recall.k, scores[E].recall.n, scores[E].precision.n) == (2, 2, 3)
    assert (scores[C].recall.k, scores[C].recall.n, scores[C].precision.n) == (0, 1, 0)
    assert {p: (r.k, r.n) for p, r in calibration.policies.items()} == {"zoo:x": (9, 10), "zoo:y": (2, 3)}
    assert len(calibration.wrong) == 2
    assert sum(calibration.counts.values()) == calibration.total == 13


def test_what_is_hard_and_what_is_unjust_is_counted_apart():
    hovers = [judged(R, R, grasped=False), judged(R, E, grasped=False), judged(S, S, grasped=False), judged(C, R)]
    honest = [judged(E, E, honest=True), judged(S, S, honest=True), judged(E, R, honest=True, grasped=False)]
    found = Calibration.of(hovers + honest, left_out=2)
    assert (found.failed_kinds.k, found.failed_kinds.n) == (3, 5)
    assert (found.without_grasp.k, found.without_grasp.n) == (1, 3)
    assert (found.accused.k, found.accused.n) == (1, 3)
    text = calibration_markdown(found)
    assert "Of the failed trials without a grasp attempt, 33.3 % (1/3)" in text
    assert "labeled as reasoning failures in 1 of 3 trials" in text
    assert "2 trials do not show the habit" in text


def test_only_reasoning_against_execution_is_crossed():
    crossed = {(a, b) for a in all_labels() for b in all_labels() if judged(a, b).crossed}
    kinds = {Kind.REASONING, Kind.EXECUTION}
    assert crossed == {(a, b) for a in all_labels() for b in all_labels() if {a.kind, b.kind} == kinds}
    assert (S, E) not in crossed


def test_the_json_form_reads_back(calibration):
    again = Calibration.from_json(json.dumps(calibration.to_json()).encode(), where="calibration.json")
    assert again == calibration


@pytest.mark.parametrize(
    "spoil", ["counts", "policies", "wrong", "crossed", "without_grasp", "accused", "left_out", "versions"]
)
def test_a_spoilt_file_is_one_clear_error(calibration, spoil):
    form = calibration.to_json()
    for bad in (
        {k: v for k, v in form.items() if k != spoil},
        {**form, spoil: "x" if spoil in ("crossed", "left_out") else 3.5},
    ):
        with pytest.raises(RecordError, match=f"calibration.json: {spoil}.*better calibrate"):
            Calibration.from_json(json.dumps(bad).encode(), where="calibration.json")
    with pytest.raises(RecordError):
        Calibration.from_json(b"[]", where="calibration.json")
    with pytest.raises(RecordError, match=r"rate: 3 successes in 2 trials are impossible"):
        Calibration.from_json(
            json.dumps({**form, "policies": {"zoo:x": {"k": 3, "n": 2}}}).encode(), where="calibration.json"
        )
    unknown = {**form, "counts": [{"truth": "success", "label": "succes", "n": 1}]}
    with pytest.raises(RecordError, match=r"counts\[0\]\.label: .*Did you mean 'success'"):
        Calibration.from_json(json.dumps(unknown).encode(), where="calibration.json")


def test_the_truth_is_what_was_decided_unless_the_goal_was_met():
    fault = {"truth": "causal_confusion", "fault": "decision 1", "mishap": ""}
    clean = {"truth": "", "fault": "", "mishap": ""}
    assert true_label(fault, expected="succeed", success=False) is C
    assert true_label(fault, expected="succeed", success=True) is S
    assert true_label(clean, expected="succeed", success=False) is E
    assert true_label(clean, expected="refuse", success=True) is Label.CORRECT_REFUSAL
    assert true_label(clean, expected="stay_still", success=True) is Label.CORRECT_FREEZE
    with pytest.raises(RecordError, match="no true label"):
        true_label({}, expected="succeed", success=False)


def test_arms_cover_the_zoo_at_every_strength_with_seeds_of_their_own():
    planned = calibration_policies(trials=2, seed=10)
    zoo = [n for n in EXPERTS if n.startswith("zoo:")]
    assert len(zoo) >= 10
    for name in zoo:
        mine = [a for a in planned if a.address.name == name]
        assert [a.address.strength for a in mine] == [1.0, 0.6, 0.3]
        assert [a.seed for a in mine] == [10, 12, 14]
        assert mine[0].address.action_noise_m == 0.0 < mine[1].address.action_noise_m < mine[2].address.action_noise_m
    assert {a.address.name.partition(":")[0] for a in planned} == {"expert", "zoo"}
    assert len({a.folder for a in planned}) == len(planned)
    assert {a.address.name for a in calibration_policies(policies=("zoo:halt",))} == {"zoo:halt"}


@pytest.mark.parametrize(
    "options",
    [{"policies": ("zoo:hal",)}, {"strengths": ()}, {"strengths": (0.0,)}, {"strengths": (1.2,)}, {"trials": 0}],
)
def test_bad_arms_are_named(options):
    with pytest.raises(InvalidInputError, match="--"):
        calibration_policies(**options)


def test_an_address_reads_back():
    for entry in calibration_policies():
        assert isinstance(entry, CalibrationPolicy)
        assert parse_address(str(entry.address)) == entry.address


@pytest.mark.parametrize(
    ("address", "names"),
    [
        ("zoo:lexical?strength=2", "strength"),
        ("zoo:lexical?strength=x", "strength"),
        ("zoo:lexical?strength=nan", "strength"),
        ("zoo:lexical?action_noise=0.5", "action_noise"),
        ("zoo:lexical?size=1", "size"),
    ],
)
def test_bad_options_of_an_address_are_named(address, names):
    with pytest.raises((InvalidInputError, UnknownNameError), match=names):
        parse_address(address)


def test_an_address_of_another_kind_is_no_privileged_policy():
    with pytest.raises(UnknownNameError, match="privileged policy"):
        parse_address("openpi://localhost:8000")


def test_chance_is_one_in_the_sentences_that_make_sense():
    assert chance_of("morning_coffee", "L3") == 0.5  # red and top mean the far mug, blue and bottom the near one
    assert 0.0 < chance_of("fast_food", "R1") < 1.0
    assert chance_of("fruit_lunch", "O2") == 1.0
    assert chance_of("tidy_desk", "O1") < 1.0  # napkin and can are both there


def test_a_guess_that_begins_with_all_that_is_asked_for_is_right():
    """ "Red on white, then blue on red" has put red on white, and succeeded, before it comes to blue."""
    assert chance_of("dinner_plates", "O1") == 0.5


def test_the_page_and_the_tables_say_it_all(calibration, tmp_path):
    page = write_calibration_page(calibration, tmp_path, power=matrix()).read_text()
    for text in ("84.6 % (11/13)", "14.3 % (1/7)", "zoo:y", "It did something.", "fast_food/T1", "causal confusion"):
        assert text in page
    assert "better calibrate --power" in write_calibration_page(calibration, tmp_path).read_text()
    assert "these tasks; do it." in write_calibration_page(calibration, tmp_path, cure="do it").read_text()
    assert "<script" not in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert (tmp_path / "confusion.svg").read_text().count("<text") > 10
    assert (tmp_path / "confusion.png").read_bytes().startswith(b"\x89PNG")
    assert "| `behavioral_inertia` | reasoning | 75.0 % (3/4) | 75.0 % (3/4) |" in calibration_markdown(calibration)


def test_what_is_solved_blind_stands_raw_beside_corrected(calibration, tmp_path):
    page = write_calibration_page(calibration, tmp_path, power=matrix()).read_text()
    for text in ("14/14*", "7/7*", "4/14", "fast_food/R1 by probe:replay (7/7)", "Before the correction"):
        assert text in page
    sentences = blind_sentences(matrix().blind_cells())
    assert "solve 1 variation that requires an action" in sentences[0]
    assert "solve no variation that requires an action" in blind_sentences(())[0]


def test_the_page_of_the_matrix_names_ceilings_and_control_cells(tmp_path):
    page = write_power_page(matrix(), tmp_path).read_text()
    for text in ("1 control cell", "fast_food/R1", "50.0 % (3/6), zoo:shape", "random", "noop", "counted as shared"):
        assert text in page, text
    assert "<script" not in page
    tables = (tmp_path / "power.md").read_text()
    assert "| fast_food/L1 | 0/6 | 3/6 | 0/6 |" in tables
    assert "| `noop` | 0 | 0 | 0 | – | – | 0 | 4 | 0 |" in tables
    old = dataclasses.replace(matrix(), versions={})
    assert "another version of fast_food" in power_markdown(old)


def test_the_page_is_a_pure_function_of_the_calibration(calibration, tmp_path):
    one, two = tmp_path / "1", tmp_path / "2"
    for out in (one, two):
        write_calibration_page(calibration, out)
    for file in one.iterdir():
        assert file.read_bytes() == (two / file.name).read_bytes(), file.name
