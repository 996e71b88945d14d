"""`better certify`: what it plans, prints and writes."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest

from betterbench.certification import load_coverage, runner
from betterbench.certification.coverage import Coverage, Seeds
from betterbench.certification.runner import versions_in_use, write_coverage
from betterbench.cli.main import EXIT_INTERRUPTED, main
from betterbench.evaluation import make_plan
from betterbench.tasks import SUITE_VERSION, TrialId, suite_tasks


@pytest.fixture
def better(capsys, monkeypatch, tmp_path, trial):
    """Runs `better certify` with an examination that takes no time; keywords say what fails."""
    fails: dict[tuple[str, int], str] = {}
    monkeypatch.setattr("betterbench.cli.verbs.evaluate.prepare_robot", lambda _name: None)
    monkeypatch.setattr(
        runner, "examine", lambda s: trial(s.task, s.condition, s.seed, fails=fails.get((s.condition, s.seed), ""))
    )

    def run(*arguments, **broken):
        for name, letters in broken.items():
            condition, seed = name.split("_")
            fails[condition, int(seed)] = letters
        status = main(["certify", "--workers", "1", "--out", str(tmp_path / "cert"), *arguments])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    run.out = tmp_path / "cert"
    return run


def test_what_is_certified_is_what_eval_with_the_same_arguments_plans(better):
    status, out, _ = better("--tasks", "fast_food", "office_drawer", "--trials", "2", "--seed", "5")
    assert status == 0
    assert "all clauses hold for every trial" in out
    plan = make_plan("noop", tasks=["fast_food", "office_drawer"], trials=2, seed=5)
    planned = [TrialId(t.task, t.condition, t.seed) for t in plan.trials]
    used = versions_in_use(["fast_food", "office_drawer"])
    coverage = load_coverage(better.out)
    assert coverage.gap(planned, suite=SUITE_VERSION, engine=used.engine, tasks=used.tasks) is None
    assert sum(len(s.certified) > 0 for s in coverage.conditions.values()) == len(coverage.conditions)
    assert f"{len(planned)} of {len(planned)} trials (12 variations, 10 training conditions)" in out


def test_what_is_not_full_is_printed_with_its_clauses_and_the_figures(better):
    status, out, err = better("--tasks", "fast_food", "--trials", "2", L1_1="bd", T2_0="a")
    assert status == 0
    row = next(line for line in out.splitlines() if "fast_food/L1" in line).split()
    assert row == ["fast_food/L1", "1/2", "2", "1", "2", "1", "2"]
    assert "fast_food/T2" in out
    assert "fast_food/R1" not in out
    assert "1.50 s per trial" in out
    assert "total time" in out
    assert "certificate.json" in out
    assert "fast_food/L1 seed 1: (b) b is <wrong>; (d) d is <wrong>" in " ".join(err.split())
    assert (better.out / "certificate.html").read_text().count('class="clause bad"') == 3


def test_json_is_one_document(better):
    _, out, _ = better("--tasks", "fast_food", "--trials", "1", "--json")
    form = json.loads(out)
    assert form == json.loads((better.out / "certificate.json").read_text())
    assert {s["condition"] for s in form["summary"]} >= {"L1", "T2", "train1"}


def test_ctrl_c_keeps_what_is_done(better, monkeypatch, trial):
    seen = []

    def examine(subject):
        if len(seen) == 3:
            raise KeyboardInterrupt
        seen.append(subject)
        return trial(subject.task, subject.condition, subject.seed)

    monkeypatch.setattr(runner, "examine", examine)
    status, out, err = better("--tasks", "fast_food", "--trials", "1")
    assert status == EXIT_INTERRUPTED
    assert out == ""
    assert "run the same command again" in err
    monkeypatch.setattr(runner, "examine", lambda s: trial(s.task, s.condition, s.seed))
    assert better("--tasks", "fast_food", "--trials", "1")[0] == 0
    assert len((better.out / "journal.jsonl").read_text().splitlines()) == 1 + len(
        make_plan("noop", tasks=["fast_food"], trials=1).trials
    )


@pytest.fixture
def packaged(tmp_path, monkeypatch):
    """Writes a packaged certificate of the versions in use, with one seed of each condition; keywords change them."""

    def write(**versions):
        tasks = suite_tasks("better60")
        used = versions_in_use(tasks)
        conditions = {f"{t}/{c}": Seeds("0-19") for t in tasks for c in ("L1", "train1")}
        numbers = {**used.tasks, **{k: v for k, v in versions.items() if k in tasks}}
        other = {k: v for k, v in versions.items() if k not in tasks}
        path = write_coverage(Coverage(replace(used, tasks=numbers, **other), conditions), tmp_path / "packaged.json")
        monkeypatch.setattr("betterbench.certification.coverage.packaged_name", lambda _suite: str(path))
        return path

    return write


def test_tasks_that_were_certified_replace_their_part_of_the_packaged_certificate(better, packaged):
    path = packaged(fast_food=1)
    before = load_coverage(path)
    status, _, err = better("--tasks", "fast_food", "--trials", "2", "--write-package", L1_1="b")
    assert status == 0
    assert "packaged certificate" in err
    after = load_coverage(path)
    assert after.versions == versions_in_use(suite_tasks("better60"))
    assert list(dict.fromkeys(name.split("/")[0] for name in after.conditions)) == list(suite_tasks("better60"))
    others = {name: seeds for name, seeds in before.conditions.items() if not name.startswith("fast_food")}
    assert others == {name: seeds for name, seeds in after.conditions.items() if not name.startswith("fast_food")}
    assert after.conditions["fast_food/L1"] == Seeds("0", "", {"b": "1"})
    assert after.conditions["fast_food/T2"] == Seeds("0-1")


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"fruit_lunch": 1}, "fruit_lunch was certified with .* fruit_lunch 1, .* but the versions in use are "),
        ({"engine": "3.0.0"}, "MuJoCo 3.0.0"),
        ({"suite": "0.1"}, "suite 0.1"),
    ],
)
def test_a_part_does_not_join_a_certificate_of_other_versions(better, packaged, changed, text):
    path = packaged(**changed)
    before = path.read_bytes()
    status, _, err = better("--tasks", "fast_food", "--trials", "1", "--write-package")
    assert status == 2
    assert re.search(text, " ".join(err.split()))
    assert path.read_bytes() == before
    assert not better.out.exists()


def test_unseen_looks_cannot_become_the_packaged_certificate(better):
    status, _, err = better("--looks", "unseen", "--trials", "1", "--write-package")
    assert status == 2
    assert "Leave out --looks" in " ".join(err.split())


def test_unknown_tasks_are_named(better):
    status, _, err = better("--tasks", "fast_fod")
    assert status == 2
    assert "fast_food" in err
