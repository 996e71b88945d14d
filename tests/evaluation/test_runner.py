"""Running a plan: resumed by the same command, the same bytes with any number of workers, and safe from everything."""

from __future__ import annotations

import contextlib
import dataclasses
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from tests.evaluation.conftest import tiny
from tests.evaluation.few_steps import in_few_steps, worker_of_few_steps

import betterbench
from betterbench.errors import (
    InvalidInputError,
    PremiseError,
    RecordError,
    RunConflictError,
    UnknownNameError,
    WorkerError,
)
from betterbench.evaluation import Progress, evaluate
from betterbench.evaluation.planning.plan import Trial
from betterbench.evaluation.trials import trial as trial_module
from betterbench.evaluation.workers import pool
from betterbench.evaluation.workers.worker import Worker
from betterbench.jobs import retries
from betterbench.records import RunFolder
from betterbench.sim import scenes
from betterbench.tasks import TrialId

pytestmark = pytest.mark.physics


@pytest.fixture(autouse=True)
def short(request, monkeypatch):
    """Ends each trial after a few steps, and after more of them where a policy has to succeed."""
    steps, still = (60, 60) if "plugin" in request.fixturenames else SHORT
    monkeypatch.setattr(pool, "work", worker_of_few_steps(steps, still=still))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trial, "resolve", in_few_steps(steps, still=still))
        yield


SHORT = (24, 12)
"""Step limits of the trials: of those with something to do, and of those in which nothing is to be done."""


@pytest.fixture(scope="module")
def short_run(tmp_path_factory):
    """The tiny plan with short trials, run in one go by one process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trial, "resolve", in_few_steps(SHORT[0], still=SHORT[1]))
        return evaluate(tiny(), tmp_path_factory.mktemp("short") / "run")


def lines(run: Path) -> list[str]:
    return (run / "journal.jsonl").read_text(encoding="utf-8").splitlines()


def keys(run: RunFolder) -> set[TrialId]:
    return {e.key for e in run.entries()}


def planned(plan) -> set[TrialId]:
    return {t.id for t in plan.trials}


def is_complete(run: RunFolder, plan) -> bool:
    entries = run.entries()
    return (
        len(lines(run.path)) == len(plan.trials) == len(entries)
        and keys(run) == planned(plan)
        and all(e.status == "done" for e in entries)
    )


# -------------------------------------------------------------------------------------------------------------- running


def test_every_planned_trial_is_in_the_journal_once_with_its_record(short_run, tiny_plan):
    plan = tiny_plan()
    assert is_complete(short_run, plan)
    records = list(short_run.records())
    assert [TrialId(r.metadata.task, r.metadata.condition, r.metadata.seed) for r in records] == [
        e.key for e in short_run.entries()
    ]
    for record, entry in zip(records, short_run.entries(), strict=True):
        assert record.metadata.policy == "random"
        assert record.metadata.variation == entry.variation == "T1"
        assert record.metadata.base_condition == "train1"
        assert record.metadata.interventions == ("do(preplace object=red_mug target=coffee_machine)",)
        assert short_run.scene_path(record.metadata.scene_hash).exists()
        assert entry.wall["total_s"] >= entry.wall["duration_s"] > 0.0


def test_no_part_file_is_left(short_run):
    assert not list(short_run.path.rglob("*.part"))


def test_the_same_command_again_runs_nothing(short_run, tiny_plan, monkeypatch):
    before = {p: p.stat().st_mtime_ns for p in short_run.path.rglob("*") if p.is_file() and p.name != ".lock"}

    def run_nothing(worker, trial):
        raise AssertionError("a finished trial was run again")

    monkeypatch.setattr(Worker, "start", run_nothing)
    told: list[Progress] = []
    again = evaluate(tiny_plan(), short_run.path, on_progress=told.append)
    assert again.plan == short_run.plan
    assert [(p.done, p.planned, p.started_with, p.last) for p in told] == [(4, 4, 4, None)]
    assert {p: p.stat().st_mtime_ns for p in before} == before


def test_progress_is_told_after_every_trial(tiny_plan, tmp_path):
    told: list[Progress] = []
    evaluate(tiny_plan(trials=2), tmp_path / "run", on_progress=told.append)
    assert [p.done for p in told] == [0, 1, 2]
    assert told[0].last is None
    assert told[2].last.key in planned(tiny_plan(trials=2))


def test_results_do_not_depend_on_the_order_of_the_plan(short_run, tiny_plan, tmp_path, run_content):
    plan = tiny_plan()
    other = evaluate(dataclasses.replace(plan, trials=plan.trials[::-1]), tmp_path / "run")
    assert run_content(other.path) == run_content(short_run.path)


@pytest.mark.slow
def test_one_and_two_workers_write_the_same_bytes(short_run, tiny_plan, tmp_path, run_content):
    two = evaluate(tiny_plan(), tmp_path / "run", workers=2)
    assert run_content(two.path) == run_content(short_run.path)
    assert keys(two) == keys(short_run)
    assert is_complete(two, tiny_plan())
    assert (two.plan, two.path / "run.json") == (short_run.plan, two.path / "run.json")
    workers = {e.wall["worker"] for e in two.entries()}
    assert float(os.getpid()) not in workers, "the work was done elsewhere"


@pytest.mark.parametrize("workers", [0, -1, 257])
def test_an_impossible_number_of_workers_is_refused_before_anything_is_written(tiny_plan, tmp_path, workers):
    with pytest.raises(InvalidInputError, match="--workers"):
        evaluate(tiny_plan(), tmp_path / "run", workers=workers)
    assert not (tmp_path / "run").exists()


def test_an_unknown_policy_or_convention_is_refused_before_anything_is_written(tiny_plan, tmp_path):
    with pytest.raises(UnknownNameError, match="Did you mean 'random'"):
        evaluate(dataclasses.replace(tiny_plan(), policy="randum"), tmp_path / "run")
    with pytest.raises(InvalidInputError, match="--action-space ee_delta"):
        evaluate(dataclasses.replace(tiny_plan(), action_space="ee_pose"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


# ------------------------------------------------------------------------------------------------------------- resuming


@pytest.fixture
def half(short_run, tmp_path):
    """A copy of the run whose last two trials are missing from the journal; their records are there or not."""
    path = tmp_path / "half"
    shutil.copytree(short_run.path, path)
    kept = lines(path)[:2]
    (path / "journal.jsonl").write_text("".join(f"{line}\n" for line in kept), encoding="utf-8")
    return path


@pytest.mark.parametrize("records", ["kept", "removed", "half written"])
def test_an_unfinished_run_is_finished_to_the_same_bytes(half, short_run, tiny_plan, run_content, records):
    done = {e.seed for e in RunFolder.open(half).entries()}
    for file in (half / "records").rglob("*.parquet"):
        if int(file.stem) not in done and records != "kept":
            file.unlink()
            if records == "half written":
                (file.parent / f".{file.name}.abc.part").write_bytes(b"PAR1")
    told: list[Progress] = []
    run = evaluate(tiny_plan(), half, on_progress=told.append)
    assert told[0].started_with == 2
    assert [p.last.seed for p in told[1:]] == [s for s in range(4) if s not in done]
    assert is_complete(run, tiny_plan())
    assert run_content(half) == run_content(short_run.path)
    assert not list(half.rglob("*.part"))


def test_a_torn_line_costs_that_trial_only(half, short_run, tiny_plan, run_content):
    torn = lines(short_run.path)[2]
    with (half / "journal.jsonl").open("a", encoding="utf-8") as journal:
        journal.write(torn[: len(torn) // 2])
    assert len(RunFolder.open(half).entries()) == 2
    run = evaluate(tiny_plan(), half)
    assert is_complete(run, tiny_plan())
    assert run_content(half) == run_content(short_run.path)


def test_a_corrupt_line_stops_with_its_number(half, tiny_plan):
    text = lines(half)
    (half / "journal.jsonl").write_text(f"{text[0]}\nnonsense\n{text[1]}\n", encoding="utf-8")
    with pytest.raises(RecordError, match="line 2 is corrupt"):
        evaluate(tiny_plan(), half)


def test_a_trial_that_is_done_but_has_no_record_is_run_again(half, tiny_plan, short_run, run_content):
    run = evaluate(tiny_plan(), half)
    lost = run.record_path("morning_coffee", "T1", 1)
    lost.unlink()
    with pytest.raises(RecordError, match=r"1\.parquet: the record does not exist"):
        list(run.records())
    evaluate(tiny_plan(), half)
    assert run_content(half) == run_content(short_run.path)


CHANGES = {
    "policy": {"policy": "noop"},
    "observation": {"observation": "default"},
    "quality": {"quality": "standard"},
}


@pytest.mark.parametrize(("field", "change"), CHANGES.items(), ids=CHANGES.keys())
def test_another_plan_is_refused_with_the_field_that_differs(short_run, tiny_plan, field, change):
    before = lines(short_run.path)
    with pytest.raises(RunConflictError, match=rf"plan\.{field}"):
        evaluate(dataclasses.replace(tiny_plan(), **change), short_run.path)
    assert lines(short_run.path) == before


def test_a_run_grows_by_a_command_with_more_trials_and_not_by_one_with_fewer(short_run, tiny_plan, tmp_path):
    out = tmp_path / "run"
    shutil.copytree(short_run.path, out)
    before = lines(out)
    grown = evaluate(tiny_plan(trials=5), out)
    assert lines(out)[: len(before)] == before
    assert len(grown.entries()) == 5
    assert grown.context["extended"][0]["trials_before"] == 4
    assert grown.context["started_utc"] == short_run.context["started_utc"]
    with pytest.raises(RunConflictError, match=r"has 5 trials, but this command requests only 4 of them"):
        evaluate(tiny_plan(), out)


def test_a_folder_with_other_things_is_left_alone(tiny_plan, tmp_path):
    (tmp_path / "thesis.tex").write_text("do not touch", encoding="utf-8")
    with pytest.raises(RunConflictError, match="contains other files"):
        evaluate(tiny_plan(), tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("how", ["removed", "moved"])
def test_a_run_whose_folder_vanishes_is_finished_to_the_same_bytes(short_run, tiny_plan, tmp_path, run_content, how):
    out = tmp_path / "run"
    vanished = []

    def vanish(progress):
        if progress.done == 2 and not vanished:
            vanished.append(out)
            shutil.rmtree(out) if how == "removed" else out.rename(tmp_path / "elsewhere")

    run = evaluate(tiny_plan(), out, workers=1, on_progress=vanish)
    assert vanished
    assert keys(run) == planned(tiny_plan())
    assert all(e.status == "done" for e in run.entries())
    assert run_content(run.path) == run_content(short_run.path)


def test_two_runs_into_one_folder_are_refused(short_run, tiny_plan):
    with short_run.journal(), pytest.raises(RunConflictError, match=r"another run .* is writing here"):
        evaluate(tiny_plan(), short_run.path)
    evaluate(tiny_plan(), short_run.path)


# ------------------------------------------------------------------------------------------------- trials that go wrong


PLUGIN = """
import os, pathlib, signal
import numpy as np
from betterbench.interface import PolicyInfo, episode_number

HERE = pathlib.Path(__file__).parent

class Base:
    info = PolicyInfo("test", needs_images=False)
    def reset(self, start):
        self.seed = next(seed for seed in range(100) if episode_number(seed) == start.episode)
    def act(self, observation):
        return np.array([0.0] * 6 + [-1.0])

class Crashes(Base):
    def act(self, observation):
        if self.seed == 1 and observation.step == 3:
            raise RuntimeError("out of memory")
        return super().act(observation)

class Dies(Base):
    '''Its process is killed in the middle of one trial, the first time.'''
    def act(self, observation):
        marker = HERE / "died"
        if self.seed == 1 and observation.step == 3 and not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation)

class AlwaysDies(Base):
    def act(self, observation):
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def plugin(tmp_path):
    file = tmp_path / "plugin.py"
    file.write_text(PLUGIN, encoding="utf-8")
    return f"python:{file}"


def test_a_crash_of_the_policy_is_a_result_and_the_run_goes_on(plugin, tiny_plan, tmp_path):
    run = evaluate(tiny_plan(f"{plugin}:Crashes", trials=3), tmp_path / "run")
    entries = {e.seed: e for e in run.entries()}
    assert [e.status for e in entries.values()] == ["done"] * 3
    assert re.fullmatch(r"RuntimeError: out of memory \(.*plugin\.py, line \d+, in act\)", entries[1].message or "")
    records = {r.metadata.seed: r for r in run.records()}
    assert records[1].outcome.termination == "policy_error"
    assert records[1].n_steps == 3
    assert records[0].outcome.success
    assert records[2].outcome.success


@pytest.mark.slow
def test_a_trial_whose_policy_was_killed_is_done_again(plugin, tiny_plan, tmp_path, run_content, caplog):
    plan = tiny_plan(f"{plugin}:Dies", trials=3)
    run = evaluate(plan, tmp_path / "run")
    assert (tmp_path / "died").exists()
    assert "the trial is repeated" in caplog.text
    assert is_complete(run, plan)
    assert {r.outcome.success for r in run.records()} == {True}
    assert run_content(evaluate(plan, tmp_path / "calm").path) == run_content(run.path)


@pytest.mark.slow
def test_a_policy_that_is_always_killed_ends_its_trials_with_errors_that_are_run_again(plugin, tiny_plan, tmp_path):
    plan = tiny_plan(f"{plugin}:AlwaysDies", trials=2)
    run = evaluate(plan, tmp_path / "run", workers=2)
    assert [e.status for e in run.entries()] == ["error", "error"]
    assert all(
        "the process of the policy ended during a request (SIGKILL, for example because memory ran out), 3 times"
        in e.message
        for e in run.entries()
    )
    cured = PLUGIN.replace("os.kill(os.getpid(), signal.SIGKILL)", "return np.array([0.0] * 6 + [-1.0])")
    Path(plugin.removeprefix("python:")).write_text(cured, encoding="utf-8")
    again = evaluate(plan, tmp_path / "run", workers=2, allow_changed_policy=True)
    assert [e.status for e in again.entries()] == ["done", "done"]


def _leave(settings, connection):
    os._exit(3)


def _get_ready_and_leave(settings, connection):
    connection.send(None)
    os._exit(3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("work", "text"),
    [
        (_leave, r"3 worker processes died during their start \(exit status 3\)"),
        (_get_ready_and_leave, r"2 worker processes died one after another \(exit status 3\)"),
    ],
)
def test_workers_that_die_one_after_the_other_stop_the_run_in_one_line(tiny_plan, tmp_path, monkeypatch, work, text):
    monkeypatch.setattr(pool, "work", work)
    monkeypatch.setattr(retries, "MAX_DEATHS_IN_A_ROW", 2)
    with pytest.raises(WorkerError, match=text):
        evaluate(tiny_plan(), tmp_path / "run", workers=2)
    assert RunFolder.open(tmp_path / "run").entries() == ()
    assert multiprocessing.active_children() == []


def test_a_trial_that_breaks_down_outside_the_policy_is_run_again(
    tiny_plan, tmp_path, monkeypatch, short_run, run_content
):
    ordinary = scenes.Scene

    def broken(task, condition, **arguments):
        if arguments["seed"] == 2:
            raise MemoryError("no memory for the model")
        return ordinary(task, condition, **arguments)

    monkeypatch.setattr(scenes, "Scene", broken)
    run = evaluate(tiny_plan(), tmp_path / "run")
    failed = [e for e in run.entries() if e.status == "error"]
    assert [e.seed for e in failed] == [2]
    assert re.fullmatch(
        r"MemoryError: no memory for the model \(.*\.py, line \d+, in broken\)", failed[0].message or ""
    )
    monkeypatch.undo()
    told: list[Progress] = []
    run = evaluate(tiny_plan(), tmp_path / "run", on_progress=told.append)
    assert [p.last.seed for p in told[1:]] == [2]
    assert all(e.status == "done" for e in run.entries())
    assert run_content(run.path) == run_content(short_run.path)


def test_a_broken_premise_stops_the_run_instead_of_lowering_a_score(tiny_plan, tmp_path, monkeypatch):
    plan = tiny_plan()
    ordinary = trial_module.run_episode

    def checked(scene, policy, **arguments):
        if scene.seed == 1:
            raise PremiseError("morning_coffee/T1 seed 1: the scene does not show it")
        return ordinary(scene, policy, **arguments)

    monkeypatch.setattr(trial_module, "run_episode", checked)
    with pytest.raises(PremiseError, match="seed 1"):
        evaluate(plan, tmp_path / "run")
    assert {e.seed for e in RunFolder.open(tmp_path / "run").entries()} == {0}
    monkeypatch.undo()
    assert is_complete(evaluate(plan, tmp_path / "run"), plan)


@pytest.mark.slow
def test_a_broken_premise_in_a_worker_stops_the_run_too(tiny_plan, tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "work", _premise_in_worker)
    with pytest.raises(PremiseError, match="a stranger stands in the slot"):
        evaluate(tiny_plan(), tmp_path / "run", workers=2)
    assert RunFolder.open(tmp_path / "run").entries() == ()


def _premise_in_worker(settings, connection):
    def stranger(scene, policy, **arguments):
        raise PremiseError("a stranger stands in the slot")

    trial_module.run_episode = stranger
    pool.work(settings, connection)


# ------------------------------------------------------------------------------------------------------------- kill -9


SCRIPT = """
import dataclasses, sys, time
from pathlib import Path
from tests.evaluation.few_steps import in_few_steps
from betterbench.evaluation import evaluate, make_plan
from betterbench.sim.scenes import Scene
from betterbench.tasks.trial import Trial

def slowly(scene, action):
    time.sleep(float(sys.argv[3]))
    return step(scene, action)

step, Scene.step = Scene.step, slowly
Trial.resolve = in_few_steps(24, still=12)

if __name__ == "__main__":
    plan = make_plan(
        "random", tasks=["morning_coffee"], variations=["T1"], trials=4, observation="state_only", quality="fast"
    )
    plan = dataclasses.replace(plan, trials=tuple(t for t in plan.trials if t.variation == "T1"))
    evaluate(plan, Path(sys.argv[1]), workers=int(sys.argv[2]))
"""


@contextlib.contextmanager
def in_another_process(folder: Path, out: Path, *, workers: int, step_s: float = 0.05):
    """Runs the tiny plan with slow steps in a session of its own, and leaves none of its processes behind."""
    script = folder / "run_tiny.py"
    script.write_text(textwrap.dedent(SCRIPT), encoding="utf-8")
    sources = (Path(betterbench.__file__).parents[1], Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, sources))}
    process = subprocess.Popen(
        [sys.executable, str(script), str(out), str(workers), str(step_s)],
        env=environment,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(timeout=30)


def wait_for_lines(out: Path, count: int, process: subprocess.Popen, *, seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    journal = out / "journal.jsonl"
    while time.monotonic() < deadline:
        if journal.exists() and journal.read_bytes().count(b"\n") >= count:
            return
        assert process.poll() is None, "the run ended early"
        time.sleep(0.02)
    raise AssertionError("the run makes no progress")


def test_kill_9_and_the_same_command_again_give_the_same_run(short_run, tiny_plan, tmp_path, run_content):
    out = tmp_path / "run"
    with in_another_process(tmp_path, out, workers=1) as process:
        wait_for_lines(out, 1, process)
        with pytest.raises(RunConflictError, match=f"process {process.pid}"):
            evaluate(tiny_plan(), out)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait(timeout=30)
    finished = len(RunFolder.open(out).entries())
    assert 1 <= finished <= 4
    told: list[Progress] = []
    run = evaluate(tiny_plan(), out, on_progress=told.append)
    assert told[0].started_with == finished
    assert is_complete(run, tiny_plan())
    assert run_content(out) == run_content(short_run.path)
    assert not list(out.rglob("*.part"))


@pytest.mark.slow
def test_ten_kills_at_random_moments_lose_nothing(short_run, tiny_plan, tmp_path, run_content):
    out = tmp_path / "run"
    draw = np.random.default_rng(2026)
    before = 0
    for attempt, wait in enumerate(draw.uniform(0.5, 6.0, 10)):
        with in_another_process(tmp_path, out, workers=1 + attempt % 2, step_s=0.2) as process:
            time.sleep(float(wait))
            os.killpg(process.pid, signal.SIGKILL)
            process.wait(timeout=30)
        done = len(RunFolder.open(out).entries()) if (out / "run.json").exists() else 0
        assert done >= before, "a finished trial was lost"
        before = done
    run = evaluate(tiny_plan(), out)
    assert is_complete(run, tiny_plan())
    assert run_content(out) == run_content(short_run.path)
    assert not list(out.rglob("*.part"))


def _alive(pid: int) -> bool:
    """Tells whether a process runs; a zombie that nobody has waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads the list of processes")
def test_workers_do_not_outlive_a_run_that_was_killed_alone(tmp_path):
    out = tmp_path / "run"
    with in_another_process(tmp_path, out, workers=2) as process:
        wait_for_lines(out, 1, process)
        workers = {int(e.wall["worker"]) for e in RunFolder.open(out).entries()}
        os.kill(process.pid, signal.SIGKILL)
        process.wait(timeout=30)
        deadline = time.monotonic() + 15.0
        while any(_alive(w) for w in workers) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert not [w for w in workers if _alive(w)]
