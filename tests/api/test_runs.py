"""Evaluating, diagnosing and comparing in Python is what the command line does, with the same results and errors."""

from __future__ import annotations

import importlib.util
import json
import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.daily import in_turn
from tests.evaluation.few_steps import in_few_steps

import betterbench
from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, PolicyError, RecordError, RunConflictError, UnknownNameError
from betterbench.tasks.trial import Trial

pytestmark = pytest.mark.physics

PLAN = {"tasks": "morning_coffee", "variations": "L1", "trials": 1, "quality": "fast", "observation": "state_only"}
FAR = 90_000
"""A seed that no certificate of ours covers."""

WAVE = """
import numpy as np
from betterbench import EpisodeStart, Observation, PolicyInfo, BetterError


class Wave:
    info = PolicyInfo("wave", needs_images=False)

    def __init__(self):
        self.closed = False
        self.number = 0

    def reset(self, start: EpisodeStart) -> None:
        self.rng = np.random.default_rng(start.episode)

    def act(self, observation: Observation) -> np.ndarray:
        return 0.3 * self.rng.standard_normal((20, 7))

    def close(self):
        self.closed = True
"""


@pytest.fixture
def short(monkeypatch):
    """Ends the trials in this process after a few steps."""
    monkeypatch.setattr(Trial, "resolve", in_few_steps(20))


@pytest.fixture(scope="module")
def wave(tmp_path_factory):
    """File of a policy, and its class."""
    path = tmp_path_factory.mktemp("policy") / "wave.py"
    path.write_text(WAVE)
    namespace = {"__name__": "wave"}
    exec(compile(WAVE, str(path), "exec"), namespace)  # noqa: S102 - the text above
    return path, namespace["Wave"]


@pytest.fixture(scope="module")
def runs(wave, tmp_path_factory):
    """A run of an instance, a run of its address, and one of the expert."""
    out = tmp_path_factory.mktemp("runs")
    path, policy = wave
    mine = policy()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trial, "resolve", in_few_steps(100))
        there = betterbench.evaluate(mine, **PLAN, out=out / "instance")
        assert not mine.closed, "the instance stays the caller's"
        address = betterbench.evaluate(f"python:{path}:Wave", **PLAN, out=str(out / "address"))
    expert = betterbench.evaluate("expert", **PLAN, out=out / "expert")
    return there, address, expert


def test_an_instance_and_its_address_leave_the_same_states(runs):
    here, there, _ = (list(run.records()) for run in runs)
    assert len(here) == len(there) == 2
    for a, b in zip(here, there, strict=True):
        assert np.array_equal(a.qpos, b.qpos)
        assert a.outcome == b.outcome


def test_the_command_line_resumes_and_reads_what_python_has_made(runs, capsys):
    _, _, expert = runs
    options = ["--tasks", "morning_coffee", "--variations", "L1", "--trials", "1", "--quality", "fast"]
    journal = expert.journal_path.read_bytes()
    command = ["eval", "--policy", "expert", *options, "--observation", "state_only", "--out", str(expert.path)]
    assert main([*command, "--json"]) == 0
    assert expert.journal_path.read_bytes() == journal
    capsys.readouterr()
    assert main(["diagnose", str(expert.path), "--keep", "--json"]) == 0
    told, found = json.loads(capsys.readouterr().out), betterbench.diagnose(expert).to_json()
    assert {key: told[key] for key in found} == json.loads(json.dumps(found))


def test_comparing_is_what_the_command_line_does(runs, capsys):
    mine, _, expert = runs
    found = betterbench.compare(mine, str(expert.path), names=("mine", "theirs"))
    assert [side.name for side in found.sides] == ["mine", "theirs"]
    command = ["compare", str(mine.path), str(expert.path), "--name", "mine", "--name", "theirs", "--json"]
    assert main(command) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"] == list(found.verdict)
    assert told["groups"] == json.loads(json.dumps(found.to_json()["groups"]))


def test_a_report_is_written_into_the_folder_of_the_first_run(runs, tmp_path):
    mine, _, expert = runs
    page = betterbench.write_report(mine, expert.path, films=0)
    assert page == mine.path / "report" / "index.html"
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "mine.txt").write_text("mine")
    with pytest.raises(RunConflictError):
        betterbench.write_report(mine, out=tmp_path / "notes", films=0)
    with pytest.raises(InvalidInputError, match="films: -1 is out of range"):
        betterbench.write_report(mine, films=-1)
    with pytest.raises(InvalidInputError, match="names: "):
        betterbench.write_report(mine, names=("a", "b"), films=0)


def test_a_run_goes_on_where_it_stopped_and_another_policy_is_refused(wave, runs):
    _, policy = wave
    mine, _, _ = runs
    journal = mine.journal_path.read_bytes()
    assert betterbench.evaluate(policy(), **PLAN, out=mine.path).path == mine.path
    assert mine.journal_path.read_bytes() == journal

    other = policy()
    other.info = betterbench.PolicyInfo("wave", needs_images=False, metadata={"checkpoint": "2"})
    with pytest.raises(RunConflictError, match="checkpoint"):
        betterbench.evaluate(other, **PLAN, out=mine.path)


@pytest.mark.usefixtures("short")
def test_an_edited_file_is_another_policy(tmp_path, monkeypatch):
    def evaluate(**options):
        spec = importlib.util.spec_from_file_location("wave_of_mine", tmp_path / "wave.py")
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "wave_of_mine", module)
        spec.loader.exec_module(module)
        return betterbench.evaluate(module.Wave(), **PLAN, out=tmp_path / "run", **options)

    (tmp_path / "wave.py").write_text(WAVE)
    run = evaluate()
    assert "wave.py, sha256" in run.context["policy"]["metadata"]["source file"]
    (tmp_path / "wave.py").write_text(WAVE.replace("0.3", "0.4"))
    with pytest.raises(RunConflictError, match="source file"):
        evaluate()
    assert evaluate(allow_changed_policy=True).context["policy_changes"]


@pytest.mark.usefixtures("short")
def test_progress_is_told_after_every_trial(tmp_path):
    seen = []
    betterbench.evaluate("noop", **PLAN, out=tmp_path / "run", on_progress=lambda p: seen.append((p.done, p.planned)))
    assert seen == [(0, 2), (1, 2), (2, 2)]


@pytest.mark.usefixtures("short")
def test_the_folder_is_called_after_the_policy(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert betterbench.evaluate("noop", **PLAN).path == tmp_path / "runs" / "noop"


class Broken:
    info = betterbench.PolicyInfo("broken", needs_images=False)

    def reset(self, start):
        pass

    def act(self, observation):
        raise RuntimeError(f"out of ideas at step {observation.step}")


def test_a_run_of_which_every_trial_broke_is_an_error(tmp_path):
    with pytest.raises(PolicyError, match=r"all 2 trials failed with an error.*out of ideas at step 0"):
        betterbench.evaluate(Broken(), **PLAN, out=tmp_path / "run")


@pytest.mark.parametrize(
    ("policy", "changes", "text"),
    [
        (Broken, {}, "policy: Broken is a class. Pass an instance: Broken"),
        (object(), {}, "policy: object has no 'info'"),
        (Broken(), {"workers": 2}, "workers: a policy instance can only be used in this process. Use one worker, or"),
        ("noop", {"trials": 0}, "trials: 0 is out of range. Use a number ≥ 1"),
        ("noop", {"workers": 0}, "workers: 0 is out of range"),
        ("noop", {"until_decided": True}, "trials: 1 are too few for a verdict"),
        ("noop", {"seed": FAR}, f"morning_coffee/L1 seed {FAR}: it is not certified"),
        ("noop", {"policy_timeout_s": 0.0}, "policy_timeout_s: 0 s is out of range"),
    ],
)
def test_a_wrong_argument_is_named(policy, changes, text, tmp_path):
    with pytest.raises(InvalidInputError) as caught:
        betterbench.evaluate(policy, **{**PLAN, **changes}, out=tmp_path / "run")
    assert text in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_a_worker_of_a_pool_starts_no_workers(tmp_path, monkeypatch):
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)
    with pytest.raises(InvalidInputError, match=r"workers: this process is a worker of a multiprocessing\.Pool"):
        betterbench.evaluate("noop", **PLAN, out=tmp_path / "run", workers=2)


@pytest.mark.usefixtures("short")
def test_a_command_that_cannot_be_encoded_does_not_stop_a_run(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["better", "--out", "\udcff"])
    assert betterbench.evaluate("noop", **PLAN, out=tmp_path / "run").context["command"] == "better --out \\udcff"


def test_a_name_may_hold_what_addresses_are_made_of(tmp_path):
    mine = Broken()
    mine.info = betterbench.PolicyInfo("team: pi0 50% ?v=2 #1", needs_images=False)
    with pytest.raises(PolicyError, match="out of ideas"):
        betterbench.evaluate(mine, **PLAN, out=tmp_path / "run")
    assert betterbench.load_run(tmp_path / "run").plan["policy"] == mine.info.name


def test_a_name_that_is_an_address_is_refused(tmp_path):
    mine = Broken()
    mine.info = betterbench.PolicyInfo("expert", needs_images=False)
    with pytest.raises(InvalidInputError, match="the name 'expert' is an address of betterbench"):
        betterbench.evaluate(mine, **PLAN, out=tmp_path / "run")


@pytest.mark.parametrize(
    ("policy", "changes", "closest"),
    [
        ("expret", {}, "expert"),
        ("noop", {"tasks": "morning_cofee"}, "morning_coffee"),
        ("noop", {"variations": "T2"}, "T1"),
        ("noop", {"quality": "fats"}, "fast"),
        ("noop", {"observation": "state"}, "state_only"),
        ("noop", {"looks": "unsen"}, "unseen"),
        ("noop", {"action_space": "ee_dleta"}, "ee_delta"),
    ],
)
def test_an_unknown_name_is_answered_with_the_closest_one(policy, changes, closest, tmp_path):
    with pytest.raises(UnknownNameError) as caught:
        betterbench.evaluate(policy, **{**PLAN, **changes}, out=tmp_path / "run")
    assert closest in caught.value.closest


def test_runs_that_are_not_there(tmp_path):
    with pytest.raises(RecordError, match="contains no run"):
        betterbench.load_run(tmp_path)
    with pytest.raises(RecordError, match="contains no run"):
        betterbench.diagnose(tmp_path / "nowhere")
    with pytest.raises(RecordError, match="contains no run"):
        betterbench.compare(tmp_path, tmp_path)
    with pytest.raises(InvalidInputError, match="runs: a comparison needs at least two runs, got 0"):
        betterbench.compare()
    with pytest.raises(InvalidInputError, match="runs: no run was given"):
        betterbench.write_report()


def test_a_report_does_not_count_a_run_twice(runs, tmp_path):
    with pytest.raises(InvalidInputError, match=r"runs: .* is given twice"):
        betterbench.write_report(runs[0], runs[0], out=tmp_path / "report")


def test_a_level_out_of_range_is_named_as_the_argument(runs):
    with pytest.raises(InvalidInputError, match=r"^alpha: 2 is not a significance level"):
        betterbench.compare(runs[0], runs[2], alpha=2)


PROGRAM = """
import betterbench
from wave import Wave
from tests.daily import in_turn
from tests.evaluation.few_steps import in_few_steps
from betterbench.tasks.trial import Trial

Trial.resolve = in_few_steps(20)  # a worker imports this file, too

if __name__ == "__main__":
    run = betterbench.evaluate(
        "noop", tasks="morning_coffee", variations="L1", trials=1, quality="fast", observation="state_only",
        workers=2, out="run",
    )
    print(len(betterbench.load_run("run").entries()))
"""


@in_turn(0, 2)
def test_a_script_starts_workers(wave, tmp_path):
    (tmp_path / "wave.py").write_text(WAVE)
    (tmp_path / "program.py").write_text(PROGRAM)
    command = [sys.executable, "program.py"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=environment)
    assert done.stdout.split() == ["2"], done.stderr
