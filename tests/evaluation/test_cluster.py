"""Workers elsewhere: what they deliver is what a worker here writes, and they leave nothing behind."""

from __future__ import annotations

import dataclasses
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.daily import others_slow
from tests.evaluation.conftest import FEW_STEPS, tiny
from tests.evaluation.few_steps import in_few_steps

from betterbench.errors import InvalidInputError, MissingDependencyError, PremiseError
from betterbench.evaluation import evaluate
from betterbench.evaluation.ray_engine import cluster
from betterbench.evaluation.ray_engine.cluster import Cluster
from betterbench.evaluation.ray_engine.remote_worker import RemoteWorker, Turn, versions_here
from betterbench.evaluation.trials.trial import WorkerSettings
from betterbench.records import RunFolder
from betterbench.tasks.trial import Trial

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module", autouse=True)
def brief_trials() -> Iterator[None]:
    """Ends all trials after a few steps, in runs and in workers alike; both are in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trial, "resolve", in_few_steps(FEW_STEPS))
        yield


@pytest.fixture(scope="module")
def uninterrupted(brief_trials, tmp_path_factory) -> RunFolder:
    """The tiny plan with brief trials, run in one go by one process."""
    return evaluate(tiny(), tmp_path_factory.mktemp("brief") / "run")


def remote_worker(run, *, envs: int = 1, policy: str = "random", known: tuple[str, ...] = ()) -> RemoteWorker:
    settings = WorkerSettings("/nowhere/else", policy, "ee_delta", "state_only", "fast", "panda", envs)
    return RemoteWorker(settings, (run.path / "run.json").read_bytes(), known)


def delivered(worker: RemoteWorker, trials) -> Turn:
    """Returns what comes of trials, in one turn."""
    turns = [worker.turn(trials)]
    while sum(len(t.deliveries) for t in turns) < len(trials):
        turns.append(worker.turn(()))
        assert turns[-1].problem is None
    scenes = {name: data for t in turns for name, data in t.scenes.items()}
    return Turn(tuple(d for t in turns for d in t.deliveries), scenes)


@pytest.mark.parametrize("envs", others_slow([1, 3], 2))
def test_what_an_outpost_delivers_is_what_a_run_here_writes(uninterrupted, tiny_plan, run_content, envs):
    worker = remote_worker(uninterrupted, envs=envs)
    try:
        assert worker.prepare({}) == versions_here()
        found = delivered(worker, tiny_plan().trials)
    finally:
        worker.close()
    content = {f"scenes/{name}.zip": data for name, data in found.scenes.items()}
    for delivery in found.deliveries:
        entry = delivery.entry
        content[f"records/{entry.task}/{entry.condition}/{entry.seed}.parquet"] = delivery.record
    assert content == run_content(uninterrupted.path)
    assert not Path("/nowhere").exists()


def test_scenes_that_the_run_holds_already_are_not_sent(uninterrupted, tiny_plan):
    known = tuple(path.stem for path in uninterrupted.path.glob("scenes/*.zip"))
    worker = remote_worker(uninterrupted, known=known)
    try:
        worker.prepare({})
        found = delivered(worker, tiny_plan(trials=2).trials)
        assert not found.scenes
        assert all(d.record for d in found.deliveries)
    finally:
        worker.close()


def test_a_scene_is_sent_once(uninterrupted, tiny_plan):
    worker = remote_worker(uninterrupted)
    sent: list[str] = []
    try:
        worker.prepare({})
        for trial in [*tiny_plan().trials, *tiny_plan().trials]:
            sent += delivered(worker, (trial,)).scenes
    finally:
        worker.close()
    assert sorted(sent) == sorted(path.stem for path in uninterrupted.path.glob("scenes/*.zip"))


def test_an_outpost_leaves_nothing_behind(uninterrupted, tiny_plan, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    worker = remote_worker(uninterrupted)
    worker.prepare({})
    assert list(tmp_path.iterdir())
    worker.turn(tiny_plan(trials=2).trials)
    worker.close()
    worker.close()
    assert not list(tmp_path.iterdir())
    with pytest.raises(InvalidInputError, match="not prepared"):
        worker.turn(())


def test_what_stops_a_run_is_delivered_too(uninterrupted, tiny_plan, monkeypatch):
    worker = remote_worker(uninterrupted)
    try:
        worker.prepare({})

        def broken(timeout_s):
            raise PremiseError("a stranger stands in the slot")

        monkeypatch.setattr(worker._worker, "finished", broken)
        turn = worker.turn(tiny_plan(trials=1).trials)
        assert isinstance(turn.problem, PremiseError)
        assert turn.deliveries == ()
    finally:
        worker.close()


def test_a_trial_that_breaks_down_has_no_record(uninterrupted, tiny_plan):
    trial = dataclasses.replace(tiny_plan().trials[0], task="no_such_task")
    worker = remote_worker(uninterrupted)
    try:
        worker.prepare({})
        (delivery,) = delivered(worker, (trial,)).deliveries
        assert delivery.entry.status == "error"
        assert delivery.record is None
    finally:
        worker.close()


def test_an_outpost_that_cannot_work_says_why(uninterrupted):
    worker = remote_worker(uninterrupted, policy="randum")
    try:
        assert "randum" in worker.prepare({})["problem"]
    finally:
        worker.close()


@pytest.mark.parametrize(
    ("arguments", "text"), [({"replicas": 0}, "--replicas"), ({"replica_gpus": -1.0}, "--replica-gpus")]
)
def test_impossible_numbers_are_refused(arguments, text):
    with pytest.raises(InvalidInputError, match=text):
        Cluster(**arguments)


def test_a_cluster_that_is_not_there_is_named_at_once(tiny_plan, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
    for given in (address, f"ray://{address}"):
        with pytest.raises(InvalidInputError, match=f"no Ray cluster at {given}"):
            evaluate(tiny_plan(), tmp_path / "run", engine="ray", cluster=Cluster(given))
    assert not (tmp_path / "run").exists()


def test_without_ray_nothing_is_written(tiny_plan, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(MissingDependencyError, match=r"make .*setup EXTRAS=ray"):
        evaluate(tiny_plan(), tmp_path / "run", engine="ray")
    assert not (tmp_path / "run").exists()
