"""The certificate as a value: its JSON, its summary, its compact form, and the page."""

from __future__ import annotations

import dataclasses
import json
import re

import pytest

from betterbench.certification import Certificate, Coverage, load_coverage, packaged_coverage, summaries
from betterbench.certification.certificate import seed_ranges
from betterbench.certification.coverage import parse_ranges
from betterbench.certification.runner import versions_in_use, write_coverage, write_json
from betterbench.errors import InvalidInputError
from betterbench.report.pages.certificate_page import render_certificate, write_certificate_page
from betterbench.tasks import SUITE_VERSION, TrialId, all_tasks, built_in_suite, get_task, suite_tasks
from betterbench.tasks.authoring.registry import SUITES

USED = versions_in_use(suite_tasks("better60"))
HERE = {"suite": SUITE_VERSION, "engine": USED.engine, "tasks": USED.tasks}


def test_a_certificate_survives_its_json(trial, certificate):
    whole = certificate(trial(), trial(condition="train1", joint_margin_rad=None), trial(seed=3, fails="bd"))
    form = json.loads(json.dumps(whole.to_json()))
    assert Certificate.from_json(form) == whole
    assert form["seeds"] == "0,3"
    assert set(form["versions"]) == {"package", "suite", "engine", "tasks", "looks", "robot"}
    assert [s["condition"] for s in form["summary"]] == ["L1", "train1"]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda f: f.update(form="another"), "not a certificate"),
        (lambda f: f.update(schema_version=2), "schema_version"),
        (lambda f: f["trials"][0].pop("seed"), "trials[0].seed: is missing"),
        (lambda f: f["trials"][0]["clauses"].pop("c"), "clauses"),
        (lambda f: f["trials"][0]["clauses"]["a"].update(passed="yes"), "passed"),
        (lambda f: f.update(more=1), "more"),
    ],
)
def test_what_is_no_certificate_is_refused_with_the_field(trial, certificate, change, text):
    form = json.loads(json.dumps(certificate(trial()).to_json()))
    change(form)
    with pytest.raises(InvalidInputError, match=re.escape(text)):
        Certificate.from_json(form)


def test_a_summary_holds_the_worst_of_each_margin(trial):
    (s,) = summaries(
        [
            trial(seed=0, support_slack_mm=None, steps=500),
            trial(seed=1, penetration_mm=0.3, joint_margin_rad=0.1, fails="a", steps=550),
            trial(seed=2, drift_mm=0.5, support_slack_mm=-2.0, fails="b"),
        ]
    )
    assert (s.n, s.passed) == (3, 1)
    assert s.clauses == {"a": 2, "b": 2, "c": 3, "d": 3, "e": 3}
    assert s.steps_share == pytest.approx(500 / 550, abs=1e-4), "a trial that was not solved has no share"
    assert (s.penetration_mm, s.drift_mm, s.joint_margin_rad, s.support_slack_mm) == (0.3, 0.5, 0.1, -2.0)
    assert s.notes == ("(a) fails, seed 1: a is <wrong>", "(b) fails, seed 2: b is <wrong>")


@pytest.mark.parametrize(("seeds", "text"), [((), ""), ((4,), "4"), ((3, 1, 2, 7), "1-3,7"), ((0, 2), "0,2")])
def test_ranges_are_inverse_to_each_other(seeds, text):
    assert seed_ranges(seeds) == text
    assert parse_ranges(text) == frozenset(seeds)


def test_hostile_ranges_are_refused():
    for text in ["a", "1-", "-1", "1-2-3", "0-99999999", "0-9999999", "1,,2", "١"]:
        with pytest.raises(InvalidInputError, match="not a range"):
            parse_ranges(text) if text != "1-" else parse_ranges("1-x")


# ------------------------------------------------------------------------------------------------------------ coverage


def test_what_passes_is_covered_and_nothing_else(trial, certificate):
    coverage = Coverage.of(certificate(trial(seed=0), trial(seed=1, fails="c"), trial(seed=2)))
    assert coverage.gap([TrialId("fast_food", "L1", 0), TrialId("fast_food", "L1", 2)], **HERE) is None
    gap = coverage.gap([TrialId("fast_food", "L1", 0), TrialId("fast_food", "L1", 1)], **HERE)
    assert gap is not None
    assert (gap.trial.condition, gap.trial.seed) == ("L1", 1)
    assert "fails clause (c)" in gap.reason
    assert gap.refused
    assert "covers seeds 0,2" in coverage.gap([TrialId("fast_food", "L1", 9)], **HERE).reason
    assert "no seed of this condition" in coverage.gap([TrialId("fast_food", "L2", 0)], **HERE).reason


def test_one_slip_of_the_expert_in_twenty_is_forgiven_and_named_two_are_not(trial, certificate):
    one = Coverage.of(certificate(*(trial(seed=s, fails="a" if s == 7 else "") for s in range(20))))
    planned = [TrialId("fast_food", "L1", s) for s in range(20)]
    assert one.gap(planned, **HERE) is None
    assert one.unsolved(planned) == (TrialId("fast_food", "L1", 7),)
    two = Coverage.of(certificate(*(trial(seed=s, fails="a" if s in (7, 8) else "") for s in range(20))))
    assert two.gap(planned, **HERE).trial.seed == 7
    worse = Coverage.of(certificate(*(trial(seed=s, fails="ab" if s == 7 else "") for s in range(20))))
    assert worse.gap(planned, **HERE).trial.seed == 7


def test_other_versions_do_not_count(trial, certificate):
    planned = [TrialId("fast_food", "L1", 0)]
    old = Coverage.of(certificate(trial(), engine="3.16.2"))
    assert "MuJoCo 3.16.2" in old.gap(planned, **HERE).reason
    patched = Coverage.of(certificate(trial(), engine=f"{USED.engine.rsplit('.', 1)[0]}.99"))
    assert patched.gap(planned, **HERE) is None, "contacts change between minor versions"
    assert (
        "version 99 of fast_food"
        in Coverage.of(certificate(trial(), tasks={"fast_food": 99})).gap(planned, **HERE).reason
    )
    assert "suite version 0.1" in Coverage.of(certificate(trial(), suite="0.1")).gap(planned, **HERE).reason


def test_the_compact_form_says_the_same_as_the_certificate(trial, certificate, tmp_path):
    trials = [
        trial(seed=s, condition=c, fails="a" if s == 7 else "b" if s == 8 else "")
        for s in range(20)
        for c in ("L1", "R1")
    ]
    whole = certificate(*trials, trial(condition="train1"))
    compact = write_coverage(whole, tmp_path / "compact.json")
    write_json(tmp_path / "certificate.json", whole.to_json())
    planned = [t.key for t in whole.trials]
    both = load_coverage(compact), load_coverage(tmp_path)
    assert both[0].gap(planned, **HERE) == both[1].gap(planned, **HERE) == Coverage.of(whole).gap(planned, **HERE)
    assert both[0].versions == whole.versions
    assert compact.stat().st_size < 1000


@pytest.mark.parametrize("text", ["", "{", "[]", '{"form": "betterbench coverage"}', '{"form": 3}', "[" * 100_000])
def test_files_that_are_no_certificate_are_refused(tmp_path, text):
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(InvalidInputError, match=re.escape(str(path))):
        load_coverage(path)


def test_ranges_that_are_none_are_named_with_their_file_and_not_in_full(tmp_path):
    form = packaged_coverage().to_json()
    next(iter(form["conditions"].values()))["certified"] = "x" * 100_000
    path = tmp_path / "c.json"
    path.write_text(json.dumps(form))
    with pytest.raises(InvalidInputError, match=re.escape(str(path))) as caught:
        load_coverage(path)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("suite", SUITES)
def test_the_packaged_certificate_names_what_exists(suite):
    coverage = packaged_coverage(suite)
    used = versions_in_use(suite_tasks(suite), robot=get_task(suite_tasks(suite)[0]).robot)
    known = {f"{t.id}/{c.name}" for t in all_tasks() for c in (*t.training, *t.variations)}
    assert set(coverage.conditions) <= known
    assert coverage.versions.suite == SUITE_VERSION
    assert dict(coverage.versions.tasks) == used.tasks, "a task's version moved: run make certify"
    assert coverage.versions.robot == used.robot
    assert built_in_suite(suite_tasks(suite)) == suite


@pytest.mark.slow
@pytest.mark.parametrize("suite", SUITES)
def test_the_packaged_certificate_covers_the_default_run(suite):
    from betterbench.certification.refusal import require_certified
    from betterbench.evaluation import make_plan

    require_certified(make_plan("expert", tasks=suite_tasks(suite)))


def test_tasks_of_no_built_in_suite_belong_to_the_first_one():
    assert built_in_suite(["fruit_basket"]) == "real_world"
    assert built_in_suite(["cheeseburger_so101"]) == "so101"
    assert built_in_suite(["fast_food"]) == built_in_suite([]) == built_in_suite(["mine"]) == "better60"
    assert built_in_suite(["fast_food", "fruit_basket"]) == "better60"


# ---------------------------------------------------------------------------------------------------------------- page


def test_the_page_is_self_contained_and_shows_every_condition(trial, certificate, tmp_path):
    whole = certificate(
        *(
            trial(seed=s, condition=c, fails="bd" if (c, s) == ("L1", 1) else "")
            for s in (0, 1)
            for c in ("L1", "T1", "train1")
        )
    )
    page = write_certificate_page(whole, tmp_path / "deep" / "certificate.html").read_text()
    assert "http://" not in page
    assert "https://" not in page
    assert "<script" not in page
    assert "light-dark(" in page
    assert 'name="viewport"' in page
    assert page.count('<th scope="row">') == 3
    assert page.count('class="clause bad"') == 2
    assert "&lt;wrong&gt;" in page
    assert "<wrong>" not in page
    assert "5 of 6 trials hold all five clauses" in page


def test_a_full_certificate_lists_no_failure(trial, certificate):
    page = render_certificate(certificate(trial(), dataclasses.replace(trial(), seed=1)))
    assert "What fails" not in page
    assert "clause bad" not in page
