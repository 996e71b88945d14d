"""`better eval` runs what is certified, and says what to do about the rest."""

from __future__ import annotations

import dataclasses

import pytest
from tests.looping import each

from betterbench.certification import packaged_coverage
from betterbench.certification.certificate import CertificateVersions
from betterbench.certification.coverage import Coverage, Seeds
from betterbench.certification.refusal import require_certified, require_coverage
from betterbench.certification.runner import write_json
from betterbench.cli.main import main
from betterbench.cli.verbs import evaluate as verb
from betterbench.errors import InvalidInputError
from betterbench.evaluation import make_plan
from betterbench.sim.scenes import engine_version
from betterbench.tasks import SUITE_VERSION, TrialId, get_task

FAR = 90_000
"""A seed that no certificate of ours covers."""


@pytest.fixture
def better(capsys, monkeypatch, tmp_path):
    """Runs `better eval` up to where the trials would begin."""

    def begin(*_args, **_kwargs):
        raise InvalidInputError("the run", "it begins", "All is well")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(verb, "run_with_bar", begin)

    def run(*arguments):
        status = main(["eval", "--policy", "noop", "--tasks", "morning_coffee", "--variations", "T1", *arguments])
        captured = capsys.readouterr()
        assert status == 2
        assert captured.out == ""
        return " ".join(captured.err.split())

    return run


def test_uncertified_seeds_are_refused_with_the_first_one_and_the_cure(better, tmp_path):
    error = better("--trials", "2", "--seed", str(FAR))
    assert f"the plan: morning_coffee/T1 seed {FAR}: it is not certified" in error
    assert f"better certify --tasks morning_coffee --trials 2 --seed {FAR} --out runs/certificate" in error
    assert "--uncertified" in error
    assert "it begins" not in error
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("tasks", "named"),
    [
        (["fast_food", "cheeseburger"], "better certify --tasks fast_food cheeseburger --trials 2 --seed 90000 --out"),
        ([], "better certify --trials 2 --seed 90000 --out"),
    ],
)
def test_the_cure_covers_the_whole_run(tasks, named):
    with pytest.raises(InvalidInputError, match=named):
        require_certified(make_plan("noop", tasks=tasks, trials=2, seed=FAR))


def test_they_run_when_asked_for(better):
    assert "it begins" in better("--trials", "2", "--seed", str(FAR), "--uncertified")


def test_certified_seeds_run(better):
    assert "it begins" in better("--trials", "1")


def test_a_certificate_that_covers_them_lets_them_run(better, trial, certificate, tmp_path):
    planned = make_plan("noop", tasks=["morning_coffee"], variations=["T1"], trials=2, seed=FAR).trials
    write_json(
        tmp_path / "certificate.json",
        certificate(*(trial(t.task, t.condition, t.seed) for t in planned)).to_json(),
    )
    where = ("--certificate", str(tmp_path))
    assert "it begins" in better("--trials", "2", "--seed", str(FAR), *where)
    assert f"seed {FAR + 2}: it is not certified" in better("--trials", "3", "--seed", str(FAR), *where)
    assert f"seed {FAR - 1}" in better("--trials", "2", "--seed", str(FAR - 1), *where)


@pytest.mark.parametrize(
    ("changes", "text"), [({"engine": "3.1.0"}, "MuJoCo 3.1.0"), ({"tasks": {"morning_coffee": 7}}, "version 7")]
)
def test_a_certificate_of_other_versions_does_not_count(  # noqa: PLR0917 - fixtures
    better, trial, certificate, tmp_path, changes, text
):
    planned = make_plan("noop", tasks=["morning_coffee"], variations=["T1"], trials=1).trials
    made = certificate(*(trial(t.task, t.condition, t.seed) for t in planned), **changes)
    write_json(tmp_path / "certificate.json", made.to_json())
    error = better("--trials", "1", "--certificate", str(tmp_path / "certificate.json"))
    assert "not certified" in error
    assert text in error


def test_a_trial_that_the_expert_missed_is_named_and_run(better, trial, certificate, tmp_path):
    planned = make_plan("noop", tasks=["morning_coffee"], variations=["T1"], trials=20).trials
    made = certificate(
        *(trial(t.task, t.condition, t.seed, fails="a" if (t.condition, t.seed) == ("T1", 4) else "") for t in planned)
    )
    write_json(tmp_path / "certificate.json", made.to_json())
    error = better("--trials", "20", "--certificate", str(tmp_path))
    assert "The expert did not solve 1 of the planned trials: morning_coffee/T1 seed 4." in error
    assert "it begins" in error


def test_a_trial_that_was_examined_and_fell_short_is_not_sent_to_be_examined_again(
    better, trial, certificate, tmp_path
):
    planned = make_plan("noop", tasks=["morning_coffee"], variations=["T1"], trials=1).trials
    made = certificate(*(trial(t.task, t.condition, t.seed, fails="" if t.variation else "c") for t in planned))
    write_json(tmp_path / "certificate.json", made.to_json())
    error = better("--trials", "1", "--certificate", str(tmp_path))
    assert "morning_coffee/train1 seed 0: it is not certified (it was examined and fails clause (c))" in error
    assert "better certify" not in error
    assert "Choose other seeds" in error


def test_a_missing_certificate_is_named(better):
    assert "nowhere.json: cannot be read" in better("--certificate", "nowhere.json")


@each("names", [[], ["L1"], ["L2", "R1", "T2"], ["L1", "L2", "R1", "O1", "T2"]])
@each("trials", [1, 3, 20])
def test_a_plan_of_some_variations_is_part_of_the_plan_of_all(names, trials):
    tasks = ["office_drawer"]
    whole = {(t.task, t.condition, t.seed) for t in make_plan("noop", tasks=tasks, trials=trials).trials}
    part = make_plan("noop", tasks=tasks, variations=names, trials=trials).trials
    assert {(t.task, t.condition, t.seed) for t in part} <= whole


def test_the_packaged_certificate_lets_the_first_seed_of_everything_run():
    coverage = packaged_coverage()
    covered = {name for name, seeds in coverage.conditions.items() if seeds.certified}
    assert covered, "the packaged certificate vouches for nothing: run make certify"


def test_a_certificate_covers_the_looks_it_was_made_with():
    versions = CertificateVersions("0", SUITE_VERSION, engine_version(), {"fast_food": get_task("fast_food").version})
    coverage = Coverage(versions, {"fast_food/L1": Seeds("0-3")})
    trial = TrialId("fast_food", "L1", 2)
    assert require_coverage(coverage, [trial], seed=0, trials_per_variation=1) == ""
    with pytest.raises(InvalidInputError, match=r"covers the seen looks.*--looks unseen"):
        require_coverage(coverage, [trial], seed=0, trials_per_variation=1, looks="unseen")
    held_out = Coverage(dataclasses.replace(versions, looks="unseen"), coverage.conditions)
    assert require_coverage(held_out, [trial], seed=0, trials_per_variation=1, looks="unseen") == ""
