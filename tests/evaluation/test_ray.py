"""The same run on a Ray cluster: the same bytes, whatever dies; nothing of it is on a shared file system."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

import betterbench
from betterbench.errors import BetterError, InvalidInputError
from betterbench.evaluation import evaluate
from betterbench.evaluation.ray_engine import pool, replicas
from betterbench.evaluation.ray_engine.cluster import Cluster
from betterbench.evaluation.ray_engine.session import RaySession
from betterbench.records import RunFolder

pytestmark = [
    pytest.mark.physics,
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="needs ray"),
]

PLUGIN = """
import os, pathlib, signal, sys, time
import numpy as np
from betterbench.interface import Execution, PolicyInfo, episode_number

HERE = pathlib.Path(__file__).parent

class Still:
    info = PolicyInfo("still", needs_images=False)
    def reset(self, start):
        self.seed = next(seed for seed in range(100) if episode_number(seed) == start.episode)
    def act(self, observation):
        return np.array([0.0] * 6 + [-1.0])

class Dies(Still):
    '''The worker that asks it is killed in the middle of one trial, the first time.'''
    def act(self, observation):
        marker = HERE / "died"
        if self.seed == 1 and observation.step == 3 and not marker.exists():
            marker.touch()
            os.kill(os.getppid(), signal.SIGKILL)
            time.sleep(20)
        return super().act(observation)

class AlwaysDies(Still):
    def act(self, observation):
        if self.seed == 1 and not (HERE / "cured").exists():
            os.kill(os.getppid(), signal.SIGKILL)
            time.sleep(20)
        return super().act(observation)

class Batches:
    '''Answers many observations at once, by each alone; notes in which processes it is.'''
    info = PolicyInfo("batches", needs_images=False, execution=Execution(horizon=3))  # of chunks of four
    def __init__(self):
        (HERE / f"{type(self).__name__}-{os.getpid()}").touch()
    def reset(self, start):
        pass
    def act(self, observation):
        return self.act_batch([observation])[0]
    def act_batch(self, observations):
        return [np.array([[0.02 * np.sin(o.step), 0.0, 0.0, 0.0, 0.0, 0.0, -1.0]] * 4) for o in observations]

class DyingBatches(Batches):
    '''Its process is killed once, with questions of several environments under way.'''
    def act_batch(self, observations):
        marker = HERE / "replica-died"
        if observations[0].step > 4 and not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act_batch(observations)

class HangingBatches(Batches):
    '''One call hangs for ever.'''
    def act_batch(self, observations):
        marker = HERE / "hung"
        if observations[0].step > 4 and not marker.exists():
            marker.touch()
            time.sleep(3600)
        return super().act_batch(observations)

class NoPlaceInAWorker(Still):
    '''There is memory for the process that is asked before the run, and for no other.'''
    def __init__(self):
        if (HERE / "full").exists():
            raise RuntimeError("CUDA out of memory")
        (HERE / "full").touch()

class NoPlaceInAReplica(Batches):
    def __init__(self):
        if "ray" in sys.modules:
            raise RuntimeError("CUDA out of memory")

class DiesLoading(Batches):
    def __init__(self):
        if "ray" in sys.modules:
            os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    file = tmp_path_factory.mktemp("plugin") / "plugin.py"
    file.write_text(PLUGIN, encoding="utf-8")
    return f"python:{file}"


@pytest.fixture(scope="module")
def two_workers():
    """A cluster of this machine, as small as Ray makes one."""
    with RaySession(Cluster("local"), 2) as session:
        yield session.ray


def is_complete(run: RunFolder, plan) -> bool:
    lines = (run.path / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    keys = [e.key for e in run.entries() if e.status == "done"]
    return len(keys) == len(lines) == len(plan.trials) and set(keys) == {t.id for t in plan.trials}


@pytest.mark.usefixtures("two_workers")
@pytest.mark.parametrize("envs", [1, 2])
def test_a_run_on_ray_is_the_run_here(uninterrupted, tiny_plan, tmp_path, run_content, envs):
    run = evaluate(tiny_plan(), tmp_path / "run", workers=2, envs=envs, engine="ray")
    assert is_complete(run, tiny_plan())
    assert run_content(run.path) == run_content(uninterrupted.path)
    assert run.plan == uninterrupted.plan
    workers = {e.wall["worker"] for e in run.entries()}
    assert len(workers) == 2
    assert float(os.getpid()) not in workers
    assert run.context["engine"] == {"name": "ray", "workers": 2, "envs": envs}
    assert not list(run.path.rglob("*.part"))


@pytest.mark.usefixtures("two_workers")
def test_a_replica_that_is_killed_changes_nothing(plugin, tiny_plan, tmp_path, run_content, caplog):
    plan = tiny_plan(f"{plugin}:DyingBatches", trials=3)
    run = evaluate(plan, tmp_path / "run", workers=2, engine="ray")
    assert (Path(plugin.removeprefix("python:")).parent / "replica-died").exists()
    assert "replicas of the policy died and are replaced: 1" in caplog.text
    done = [e.key for e in run.entries() if e.status == "done"]
    assert len(done) == len(set(done)) == len(plan.trials)
    assert run_content(evaluate(plan, tmp_path / "calm").path) == run_content(run.path)


@pytest.mark.usefixtures("two_workers")
def test_a_replica_that_hangs_costs_the_trials_that_asked_it_and_is_replaced(plugin, tiny_plan, tmp_path, caplog):
    plan = tiny_plan(f"{plugin}:HangingBatches", trials=4)
    run = evaluate(plan, tmp_path / "run", workers=2, envs=1, engine="ray", policy_timeout_s=4.0)
    done = [e.key for e in run.entries() if e.status == "done"]
    assert len(done) == len(set(done)) == len(plan.trials)
    assert "replicas of the policy died and are replaced: 1" in caplog.text
    late = [r.outcome.error for r in run.records() if r.outcome.termination == "policy_error"]
    assert 1 <= len(late) <= 2, "those in the batch that hung"
    assert set(late) == {"the policy did not answer within 4 s. Raise --policy-timeout."}


@pytest.mark.usefixtures("two_workers")
def test_a_worker_that_is_killed_changes_nothing(plugin, tiny_plan, tmp_path, run_content, caplog):
    plan = tiny_plan(f"{plugin}:Dies", trials=3)
    run = evaluate(plan, tmp_path / "run", workers=2, engine="ray")
    assert (Path(plugin.removeprefix("python:")).parent / "died").exists()
    assert "a worker of the cluster died" in caplog.text
    assert is_complete(run, plan)
    assert run_content(evaluate(plan, tmp_path / "calm").path) == run_content(run.path)


def test_a_trial_at_which_workers_always_die_is_given_up_and_the_others_are_done(
    two_workers, plugin, tiny_plan, tmp_path
):
    plan = tiny_plan(f"{plugin}:AlwaysDies", trials=3)
    run = evaluate(plan, tmp_path / "run", workers=2, envs=3, engine="ray")
    status = {e.seed: e.status for e in run.entries()}
    assert status[1] == "error"
    assert "3 workers of the cluster died" in next(e.message for e in run.entries() if e.seed == 1)
    assert [status[0], status[2]] == ["done", "done"], "it takes no other trial along"
    (Path(plugin.removeprefix("python:")).parent / "cured").touch()
    again = evaluate(plan, tmp_path / "run", workers=1, engine="ray")
    assert [e.status for e in again.entries()] == ["done"] * 3


def test_a_run_that_was_begun_here_is_finished_on_ray(two_workers, uninterrupted, tiny_plan, tmp_path, run_content):
    out = tmp_path / "half"
    shutil.copytree(uninterrupted.path, out)
    kept = (out / "journal.jsonl").read_text(encoding="utf-8").splitlines()[:2]
    (out / "journal.jsonl").write_text("".join(f"{line}\n" for line in kept), encoding="utf-8")
    run = evaluate(tiny_plan(), out, workers=2, engine="ray")
    assert is_complete(run, tiny_plan())
    assert run_content(out) == run_content(uninterrupted.path)


def test_a_policy_that_takes_batches_is_held_by_replicas(two_workers, plugin, tiny_plan, tmp_path, run_content):
    plan = tiny_plan(f"{plugin}:Batches", trials=4)
    here = Path(plugin.removeprefix("python:")).parent
    run = evaluate(plan, tmp_path / "run", workers=2, envs=2, engine="ray", cluster=Cluster(replicas=2))
    assert is_complete(run, plan)
    held = {float(p.name.removeprefix("Batches-")) for p in here.glob("Batches-*")} - {float(os.getpid())}
    assert len(held) == 3, "one that is asked before the run, one copy per replica, and none in a worker"
    assert not held & {e.wall["worker"] for e in run.entries()}
    calm = evaluate(plan, tmp_path / "calm")
    assert run_content(calm.path) == run_content(run.path)
    assert {r.metadata.policy for r in run.records()} == {plan.policy}, "the record names the policy, not its replica"


def test_a_cluster_with_other_versions_is_refused(two_workers, tiny_plan, tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "versions_here", lambda: {"betterbench": "9.9", "mujoco": "3.17.0"})
    with pytest.raises(InvalidInputError, match=r"betterbench .* \(here 9.9\)"):
        evaluate(tiny_plan(), tmp_path / "run", workers=1, engine="ray")
    assert RunFolder.open(tmp_path / "run").entries() == ()


def test_a_cluster_without_a_place_is_named(two_workers, plugin, tiny_plan, tmp_path, monkeypatch):
    monkeypatch.setattr(replicas, "PLACING_S", 2.0)
    plan = tiny_plan(f"{plugin}:Batches", trials=2)
    with pytest.raises(InvalidInputError, match="replicas with 7 GPUs each"):
        evaluate(plan, tmp_path / "run", workers=1, engine="ray", cluster=Cluster(replica_gpus=7.0))


@pytest.mark.usefixtures("two_workers")
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("NoPlaceInAWorker", "A worker on the cluster cannot start: .*CUDA out of memory"),
        ("NoPlaceInAReplica", "CUDA out of memory"),
        ("DiesLoading", "A replica died while it loaded python:"),
    ],
)
def test_a_policy_that_cannot_be_loaded_there_is_one_line(plugin, tiny_plan, tmp_path, name, text):
    with pytest.raises(BetterError, match=text) as caught:
        evaluate(tiny_plan(f"{plugin}:{name}", trials=2), tmp_path / "run", workers=1, engine="ray")
    assert "\n" not in str(caught.value)


SCRIPT = """
import dataclasses, sys
from pathlib import Path
from betterbench.evaluation import evaluate, make_plan

if __name__ == "__main__":
    plan = make_plan(
        "random", tasks=["morning_coffee"], variations=["T1"], trials=4, observation="state_only", quality="fast"
    )
    plan = dataclasses.replace(plan, trials=tuple(t for t in plan.trials if t.variation == "T1"))
    try:
        evaluate(plan, Path(sys.argv[1]), workers=1, engine="ray")
    except KeyboardInterrupt:
        sys.exit(130)
"""


def test_ctrl_c_ends_a_run_with_its_cluster_and_the_run_can_go_on(uninterrupted, tiny_plan, tmp_path, run_content):
    script, out = tmp_path / "run_ray.py", tmp_path / "run"
    script.write_text(textwrap.dedent(SCRIPT), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(Path(betterbench.__file__).parents[1])}
    process = subprocess.Popen(
        [sys.executable, str(script), str(out)], env=environment, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        deadline = time.monotonic() + 180.0
        while not (out / "journal.jsonl").exists() or not (out / "journal.jsonl").stat().st_size:
            assert process.poll() is None, "the run ended early"
            assert time.monotonic() < deadline, "the run makes no progress"
            time.sleep(0.05)
        worker = int(json.loads((out / "journal.jsonl").read_text(encoding="utf-8").splitlines()[0])["wall"]["worker"])
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) in (130, 0)
        until = time.monotonic() + 20.0
        while Path(f"/proc/{worker}").exists() and time.monotonic() < until:
            time.sleep(0.1)
        assert not Path(f"/proc/{worker}").exists(), "a worker outlived the run"
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(timeout=30)
    run = evaluate(tiny_plan(), out)
    assert is_complete(run, tiny_plan())
    assert run_content(out) == run_content(uninterrupted.path)
