"""Workers: many environments in one thread, policies in others, and results that depend on neither."""

from __future__ import annotations

import dataclasses
import os
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tests.daily import in_turn, others_slow
from tests.evaluation.few_steps import in_few_steps, worker_of_few_steps

from betterbench.errors import InvalidInputError, PolicyError, PolicyUnavailableError, RunConflictError, WorkerError
from betterbench.evaluation import evaluate, make_plan
from betterbench.evaluation.ray_engine.remote_worker import RemoteWorker
from betterbench.evaluation.serving.host import Host, run_address
from betterbench.evaluation.trials.shared_policy import SharedPolicy
from betterbench.evaluation.trials.trial import WorkerSettings
from betterbench.evaluation.workers import pool
from betterbench.evaluation.workers.worker import Worker, even_share, fair_envs, usual_envs
from betterbench.interface import EpisodeStart, PolicyInfo
from betterbench.policies.address import EXECUTION
from betterbench.policies.clients.connection import ConnectionLimits
from betterbench.policies.factory import PolicyFactory
from betterbench.policies.kinds import PolicyNeeds, read_address
from betterbench.records import RunFolder
from betterbench.sim.worlds import OWN_WORLD
from betterbench.tasks.trial import Trial

pytestmark = pytest.mark.physics

STEPS = 40
"""Steps after which each trial ends."""

PLUGIN = '''
import hashlib, os, pathlib, threading, time
import numpy as np
from betterbench.errors import PolicyUnavailableError
from betterbench.interface import Execution, PolicyInfo, episode_number

HERE = pathlib.Path(__file__).parent
MADE = []

class Slow:
    """Answers chunks that depend on the trial and the step alone, after a while that depends on neither."""
    info = PolicyInfo("slow", needs_images=False, execution=Execution(ahead=2))
    def __init__(self):
        MADE.append(self)
        self.draw = np.random.default_rng(len(MADE))
        self.seed = None
        self.closed = 0
    def reset(self, start):
        self.seed = next(seed for seed in range(100) if episode_number(seed) == start.episode)
    def act(self, observation):
        time.sleep(self.draw.uniform(0.0, 0.01))
        draw = np.random.default_rng([self.seed, observation.step])
        return np.hstack([draw.uniform(-1, 1, (8, 6)), -np.ones((8, 1))])
    def close(self):
        self.closed += 1

class Batched:
    """Answers batches; each answer depends on its observation alone."""
    info = PolicyInfo("batched", needs_images=False)
    def reset(self, start):
        pass
    def act(self, observation):
        return self.act_batch([observation])[0]
    def act_batch(self, observations):
        time.sleep(0.005)
        with (HERE / f"batches-{os.getpid()}").open("a") as told:
            told.write(f"{len(observations)}\\n")
        moves = [np.tile(np.sin(10 * o.joint_positions[:6]), (8, 1)) for o in observations]
        return [np.hstack([move, -np.ones((8, 1))]) for move in moves]

class Crashes(Slow):
    def act(self, observation):
        if self.seed == 1 and observation.step >= 8:
            raise RuntimeError("out of memory")
        return super().act(observation)

class Hangs(Slow):
    gate = threading.Event()
    def act(self, observation):
        if self.seed == 1 and observation.step >= 6:
            self.gate.wait(60.0)
        return super().act(observation)

class HangingBatch(Batched):
    gate = threading.Event()
    def act_batch(self, observations):
        if any(o.step >= 16 for o in observations) and not (HERE / "hung").exists():
            (HERE / "hung").touch()
            self.gate.wait(60.0)
        return super().act_batch(observations)

class Gone(Slow):
    def act(self, observation):
        if self.seed == 2:
            raise PolicyUnavailableError("the server is gone")
        return super().act(observation)

class Looking(Slow):
    """Answers what depends on every pixel."""
    info = PolicyInfo("looking", execution=Execution(horizon=4, ahead=1))
    def act(self, observation):
        pixels = b"".join(observation.images[name].tobytes() for name in sorted(observation.images))
        draw = np.random.default_rng(int.from_bytes(hashlib.sha256(pixels).digest()[:8], "little"))
        return np.hstack([draw.uniform(-1, 1, (6, 6)), -np.ones((6, 1))])

class Heavy(Batched):
    """Keeps a mark of every process that it is loaded into."""
    def act_batch(self, observations):
        moves = [np.tile(np.sin(10 * o.joint_positions[:6]), (8, 1)) for o in observations]
        return [np.hstack([move, -np.ones((8, 1))]) for move in moves]
    info = PolicyInfo("heavy", needs_images=False, heavy=True)
    def __init__(self):
        import os
        (HERE / f"loaded-{os.getpid()}").touch()

class HeavyAlone(Slow):
    """Has weights and takes no batches; it acts when as many are loaded as have to be."""
    info = PolicyInfo("heavy alone", needs_images=False, heavy=True)
    def __init__(self, loaded=1):
        super().__init__()
        import os, uuid
        self.loaded = loaded
        (HERE / f"loaded-{os.getpid()}-{uuid.uuid4()}").touch()
    def act(self, observation):
        import time
        until = time.monotonic() + 60.0
        while len(list(HERE.glob("loaded-*"))) < self.loaded and time.monotonic() < until:
            time.sleep(0.05)
        return super().act(observation)

class Assuming(Slow):
    info = PolicyInfo("assuming", needs_images=False, metadata={"assumed": "its actions mean nothing"})

class Odd(Slow):
    """Breaks with a file name that is no text, as those of other operating systems."""
    def act(self, observation):
        raise FileNotFoundError("no such \\udcff file")

class Counting(Slow):
    """Has an attribute with the name of what our clients count."""
    figures = {"attention": float("nan")}

class Raising(Heavy):
    """Breaks at some trials, with the error that stands in their records."""
    def reset(self, start):
        self.seed = next(seed for seed in range(100) if episode_number(seed) == start.episode)
        super().reset(start)
    def act_batch(self, observations):
        for o in observations:
            if o.step >= 8 and o.joint_positions[0] > -9:
                raise ValueError("bad thing\\nin two lines")
        return super().act_batch(observations)

class Bent(Raising):
    def act_batch(self, observations):
        return [np.zeros((3, 5)) for _ in observations]

class Exits(Heavy):
    def act_batch(self, observations):
        raise SystemExit(3)

class HangsOnce(Heavy):
    """One call hangs for ever; its process is replaced, and the trials that follow are as if nothing was."""
    def act_batch(self, observations):
        marker = HERE / "hung"
        if any(o.step >= 8 for o in observations) and not marker.exists():
            marker.touch()
            time.sleep(3600)
        return super().act_batch(observations)

class Closing(Slow):
    """Fails in each trial, and says when it is closed."""
    def act(self, observation):
        if observation.step >= 8:
            raise RuntimeError("out of memory")
        return super().act(observation)
    def close(self):
        (HERE / f"closed-{os.getpid()}").touch()

class LeavesAChild(Slow):
    """Its process is killed while a child of its, forked like those of data loaders, lives on."""
    def act(self, observation):
        import multiprocessing, os, signal
        marker = HERE / "forked"
        if not marker.exists():
            marker.touch()
            child = multiprocessing.get_context("fork").Process(target=time.sleep, args=(20,), daemon=True)
            child.start()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation)

class DiesLoading(Slow):
    """Its process dies while it loads, and leaves such a child."""
    def __init__(self):
        import multiprocessing, os, signal
        multiprocessing.get_context("fork").Process(target=time.sleep, args=(20,), daemon=True).start()
        os.kill(os.getpid(), signal.SIGKILL)

class NotInWorkers(Slow):
    """There is memory for the first instances only."""
    def __init__(self):
        super().__init__()
        import os
        (HERE / f"loaded-{os.getpid()}").touch()
        if len(list(HERE.glob("loaded-*"))) > ROOM:
            raise RuntimeError("CUDA out of memory")

ROOM = 2

class Mortal(Heavy):
    """Its process dies in the middle of the run, once."""
    def act_batch(self, observations):
        import os, signal
        marker = HERE / "died"
        if any(o.step == 16 for o in observations) and not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act_batch(observations)
'''


@pytest.fixture
def plugin(tmp_path):
    file = tmp_path / "plugin_of_workers.py"
    file.write_text(PLUGIN, encoding="utf-8")
    return f"python:{file}"


@pytest.fixture
def four_processors(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 4)


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Ends each trial after a few steps, here and in workers."""
    monkeypatch.setattr(pool, "work", worker_of_few_steps(STEPS))
    monkeypatch.setattr(Trial, "resolve", in_few_steps(STEPS))


@pytest.fixture(autouse=True)
def no_thread_is_left():
    yield
    until = time.monotonic() + 5.0
    while any(t.name in ("policy", "collector") for t in threading.enumerate()) and time.monotonic() < until:
        time.sleep(0.01)
    assert [t.name for t in threading.enumerate() if t.name in ("policy", "collector")] == []


def outcomes(run: RunFolder) -> dict[int, tuple[int, str]]:
    """Returns the steps of each trial and its error, without the place where that was raised."""
    return {r.metadata.seed: (r.n_steps, (r.outcome.error or "").partition(" (")[0]) for r in run.records()}


OVER = (STEPS, "")
"""How a trial ends that nothing goes wrong with."""


def test_records_do_not_depend_on_environments_order_or_latency(plugin, tiny_plan, tmp_path, run_content):
    plan = tiny_plan(f"{plugin}:Slow", trials=3)
    one = evaluate(plan, tmp_path / "one", envs=1)
    assert outcomes(one) == {0: OVER, 1: OVER, 2: OVER}
    other = evaluate(dataclasses.replace(plan, trials=plan.trials[::-1]), tmp_path / "other", envs=3)
    assert run_content(other.path) == run_content(one.path)


@pytest.mark.render
def test_images_do_not_depend_on_what_else_is_simulated(plugin, tmp_path, run_content, monkeypatch):
    monkeypatch.setattr(Trial, "resolve", in_few_steps(16))
    plan = make_plan(
        f"{plugin}:Looking",
        tasks=["morning_coffee"],
        variations=["T1"],
        trials=2,
        observation="default",
        quality="fast",
    )
    plan = dataclasses.replace(plan, trials=plan.trials[:3])
    one = evaluate(plan, tmp_path / "one", envs=1)
    assert {r.n_steps for r in one.records()} == {16}
    assert len({r.metadata.scene_hash for r in one.records()}) == 2, "some share a renderer"
    assert run_content(evaluate(plan, tmp_path / "three", envs=3).path) == run_content(one.path)


@pytest.mark.slow
def test_records_do_not_depend_on_workers(plugin, tiny_plan, tmp_path, run_content):
    plan = tiny_plan(f"{plugin}:Slow", trials=3)
    one = evaluate(plan, tmp_path / "one", envs=1)
    two = evaluate(plan, tmp_path / "two", workers=2, envs=2)
    assert len({e.wall["worker"] for e in two.entries()}) == 2
    assert run_content(two.path) == run_content(one.path)


def test_the_journal_says_where_the_time_went(plugin, tiny_plan, tmp_path):
    run = evaluate(tiny_plan(f"{plugin}:Slow", trials=2), tmp_path / "run", envs=2)
    for entry in run.entries():
        wall = entry.wall
        assert 0.0 < wall["policy_latency_p50_s"] <= wall["policy_latency_max_s"] <= wall["policy_s"]
        assert min(wall["simulation_s"], wall["setup_s"], wall["write_s"]) > 0.0
        assert wall["simulation_s"] + wall["observe_s"] <= wall["duration_s"] <= wall["total_s"]


def test_each_environment_has_an_instance_of_a_plain_policy_in_a_process_of_its_own_and_closes_it(
    plugin, tiny_plan, tmp_path
):
    evaluate(tiny_plan(f"{plugin}:Closing", trials=3), tmp_path / "run", envs=2)
    closed = {int(p.name.partition("-")[2]) for p in tmp_path.glob("closed-*")}
    assert len(closed) == 3, "the third trial begins in a process in which none has failed"
    assert os.getpid() not in closed


def test_a_policy_that_takes_batches_is_made_once_and_gets_what_waits_together(plugin, tiny_plan, tmp_path):
    plan = tiny_plan(f"{plugin}:Batched", trials=4)
    run = evaluate(plan, tmp_path / "run", envs=4)
    assert [e.status for e in run.entries()] == ["done"] * 4
    (told,) = tmp_path.glob("batches-*")
    batches = [int(line) for line in told.read_text().splitlines()]
    assert sum(batches) == 4 * 5
    assert max(batches) > 1


def test_the_size_of_batches_changes_no_record(plugin, tiny_plan, tmp_path, run_content):
    plan = tiny_plan(f"{plugin}:Batched", trials=3)
    one = evaluate(plan, tmp_path / "one", envs=1)
    assert run_content(evaluate(plan, tmp_path / "three", envs=3).path) == run_content(one.path)


def test_a_policy_may_use_the_memory_of_its_answers_again():
    def answer(observations):
        memory[0] = observations[0]
        return memory[: len(observations)]

    memory = np.zeros((4, 7))
    shared = SharedPolicy(SimpleNamespace(info=PolicyInfo("reusing"), act_batch=answer, act=answer, reset=answer), 1)
    try:
        first = shared.seat().act(1.0)
        second = shared.seat().act(2.0)
    finally:
        shared.close()
    assert (first[0], second[0]) == (1.0, 2.0)


def test_retries_of_a_shared_client_count_for_each_trial_of_the_batch():
    def answer(observations):
        client.figures["policy_retries"] += 2.0
        if observations == ["bad"]:
            raise PolicyError("no answer")
        return np.zeros((len(observations), 7))

    client = SimpleNamespace(info=PolicyInfo("c"), act_batch=answer, act=answer, reset=len)
    client.figures = {"policy_requests": 5.0, "policy_retries": 7.0}
    shared = SharedPolicy(client, 1, client=True)
    try:
        first, second = shared.seat(), shared.seat()
        first.act("good")
        with pytest.raises(PolicyError):
            second.act("bad")
        first.act("good")
        assert first.figures == {"policy_requests": 0.0, "policy_retries": 4.0}
        assert second.figures == {"policy_requests": 0.0, "policy_retries": 2.0}
        first.reset(EpisodeStart("go", 1, "ee_delta"))
        assert first.figures == {}
    finally:
        shared.close()


def test_the_process_of_a_policy_is_asked_as_the_policy_and_the_run_say():
    client = read_address(run_address("openpi://127.0.0.1:5", timeout_s=450.0, patience_s=9.0))
    assert not client.given(EXECUTION), "its server says how chunks are played"
    terms = ConnectionLimits.of(client)
    # The server ends the wait itself, after 450 s; the client only sees to it that a server which does not is left.
    assert (terms.timeout_s, terms.warmup_s, terms.patience_s) == (480.0, 489.0, 9.0)


def test_a_policy_that_raises_ends_its_own_trial_only(plugin, tiny_plan, tmp_path):
    run = evaluate(tiny_plan(f"{plugin}:Crashes", trials=3), tmp_path / "run", envs=3)
    assert outcomes(run) == {0: OVER, 1: (14, "RuntimeError: out of memory"), 2: OVER}


@pytest.mark.parametrize("envs", others_slow([1, 2], 2))
def test_a_policy_that_hangs_ends_its_own_trial_and_gets_a_new_process(plugin, tiny_plan, tmp_path, envs):
    run = evaluate(tiny_plan(f"{plugin}:Hangs", trials=3), tmp_path / "run", envs=envs, policy_timeout_s=2.0)
    reason = "the policy did not answer within 2 s. Raise --policy-timeout."
    assert outcomes(run) == {0: OVER, 1: (8, reason), 2: OVER}


def test_a_batch_that_hangs_costs_no_trial_that_waited_behind_it(plugin, tiny_plan, tmp_path):
    run = evaluate(tiny_plan(f"{plugin}:HangingBatch", trials=3), tmp_path / "run", envs=3, policy_timeout_s=2.0)
    ends = list(outcomes(run).values())
    assert any("did not answer within 2 s" in reason for _, reason in ends)
    assert OVER in ends, "another instance answers the others"


def test_a_server_that_is_gone_stops_the_run_and_the_trial_is_run_again(plugin, tiny_plan, tmp_path):
    plan = tiny_plan(f"{plugin}:Gone", trials=4)
    with pytest.raises(PolicyUnavailableError, match="the server is gone"):
        evaluate(plan, tmp_path / "run")
    entries = {e.seed: (e.status, e.message) for e in RunFolder.open(tmp_path / "run").entries()}
    assert entries == {0: ("done", None), 1: ("done", None), 2: ("error", "the server is gone")}
    Path(plugin.removeprefix("python:")).write_text(PLUGIN.replace("self.seed == 2", "False"), encoding="utf-8")
    with pytest.raises(RunConflictError, match=r"policy\.metadata\.source file was"):
        evaluate(plan, tmp_path / "run")
    again = evaluate(plan, tmp_path / "run", allow_changed_policy=True)
    assert {e.seed: e.status for e in again.entries()} == dict.fromkeys(range(4), "done")


@pytest.mark.parametrize("workers", others_slow([1, 2], 2))
def test_a_server_that_is_gone_in_the_last_trial_stops_the_run_too(plugin, tiny_plan, tmp_path, workers):
    plan = tiny_plan(f"{plugin}:Gone", trials=3)
    with pytest.raises(PolicyUnavailableError, match="the server is gone"):
        evaluate(plan, tmp_path / "run", workers=workers)
    entries = {e.seed: e.status for e in RunFolder.open(tmp_path / "run").entries()}
    # The other worker of two may still be at its trial when the run stops.
    assert entries == {0: "done", 1: "done", 2: "error"} or (workers == 2 and entries == {0: "done", 2: "error"})


def test_a_worker_of_a_cluster_tells_of_a_server_that_is_gone_with_the_trial_that_it_cost(plugin, tiny_plan, tmp_path):
    # There may be no later turn to tell it in: the trial may be the last one of the run.
    plan = tiny_plan(f"{plugin}:Gone", trials=3)
    run = RunFolder.start(tmp_path / "run", plan.to_json())
    settings = WorkerSettings(
        str(run.path), plan.policy, plan.action_space, plan.observation, plan.quality, plan.robot, 1
    )
    remote = RemoteWorker(settings, (run.path / "run.json").read_bytes(), ())
    try:
        remote.prepare({})
        turn = remote.turn(plan.trials[2:])
        while not turn.deliveries:
            turn = remote.turn(())
    finally:
        remote.close()
    assert [(d.entry.seed, d.entry.status) for d in turn.deliveries] == [(2, "error")]
    assert isinstance(turn.problem, PolicyUnavailableError)


def test_a_worker_is_used_by_hand(plugin, tiny_plan, tmp_path):
    plan = tiny_plan(f"{plugin}:Slow", trials=3)
    RunFolder.start(tmp_path / "run", plan.to_json())
    settings = WorkerSettings(
        str(tmp_path / "run"), plan.policy, plan.action_space, plan.observation, plan.quality, plan.robot, envs=2
    )
    with Worker(settings) as worker:
        assert worker.finished(0.0) == []
        assert worker.free == 2
        worker.start(plan.trials[0])
        worker.start(plan.trials[1])
        assert worker.free == 0
        with pytest.raises(InvalidInputError, match="no environment of the worker is free"):
            worker.start(plan.trials[2])
        assert worker.finished(0.0) == [], "it goes on for as long as it is told to"
        entries = []
        while len(entries) < 2:
            entries += worker.finished(1.0)
        assert {e.seed for e in entries} == {0, 1}
        worker.start(plan.trials[2])
    assert worker.free == 2, "a trial that had not ended is dropped"


def test_the_deadline_of_an_answer_begins_when_the_policy_is_loaded(plugin, tiny_plan, tmp_path):
    plan = tiny_plan(f"{plugin}:Slow", trials=1)
    RunFolder.start(tmp_path / "run", plan.to_json())
    settings = WorkerSettings.of(plan, tmp_path / "run", policy_timeout_s=0.05)
    loaded = threading.Event()

    def take():
        assert loaded.wait(60.0)
        raise PolicyError("there is no memory for it")

    policies = SimpleNamespace(
        needs=PolicyNeeds(thread=True, process=True),
        check=lambda *_, **__: PolicyInfo("slow to load", needs_images=False),
        takes_batches=False,
        take=take,
        close=lambda: None,
    )
    with Worker(settings, policies=policies) as worker:
        worker.start(plan.trials[0])
        until = time.monotonic() + 1.0
        while time.monotonic() < until:
            assert worker.finished(0.1) == []
        loaded.set()
        entries = []
        while not entries:
            entries = worker.finished(1.0)
    assert entries[0].message == "there is no memory for it"


@pytest.mark.parametrize(
    ("policy", "envs"),
    [("expert", 1), ("noop", 1), ("random", 1), ("Slow", 1), ("Batched", 8)],
)
def test_the_usual_number_of_environments(plugin, policy, envs):
    with PolicyFactory(f"{plugin}:{policy}" if policy[0].isupper() else policy) as policies:
        assert usual_envs(policies) == envs


def test_what_a_run_takes_for_granted_is_told_once(plugin, tiny_plan, tmp_path, caplog):
    run = evaluate(tiny_plan(f"{plugin}:Assuming", trials=2), tmp_path / "run", envs=2)
    assert [r.getMessage() for r in caplog.records if r.name.endswith("runner")] == ["its actions mean nothing"]
    assert run.context["policy"]["metadata"]["assumed"] == "its actions mean nothing"


@pytest.mark.parametrize(("workers", "envs"), [(1, 8), (2, 8), (4, 8), (5, 6), (16, 2), (32, 1), (256, 1)])
def test_many_workers_do_not_queue_up_before_a_server(workers, envs):
    assert fair_envs(8, workers) == envs
    assert fair_envs(1, workers) == 1


@pytest.mark.parametrize(
    ("left", "workers", "envs", "share"),
    [
        (24, 2, 8, 6),
        (18, 2, 8, 5),
        (16, 2, 8, 8),
        (12, 2, 8, 6),
        (1000, 2, 8, 8),
        (1, 2, 8, 1),
        (0, 2, 8, 0),
        (5, 4, 1, 1),
    ],
)
def test_the_last_trials_are_shared_out_evenly(left, workers, envs, share):
    assert even_share(left, workers, envs) == share


def test_long_tasks_come_first_and_trials_of_a_scene_together(monkeypatch):
    monkeypatch.undo()  # with the limits of the tasks
    plan = make_plan("noop", tasks=["morning_coffee", "fast_food"], trials=2)
    ordered = OWN_WORLD.in_order(plan.trials, last=0)
    limits = {}
    for trial in plan.trials:
        found = trial.resolve()
        limits[trial.task] = max(limits.get(trial.task, 0), found.task.step_limit(found.condition))
    tasks = list(dict.fromkeys(t.task for t in ordered))
    assert len(tasks) == 2, "each task is one block"
    assert limits[tasks[0]] > limits[tasks[1]]
    for task in tasks:
        seeds = [t.seed for t in ordered if t.task == task]
        assert seeds == sorted(seeds)
    assert sorted(map(str, ordered)) == sorted(map(str, plan.trials))


def test_the_last_trials_begin_with_the_longest(monkeypatch):
    monkeypatch.undo()  # with the limits of the tasks
    plan = make_plan("noop", tasks=["morning_coffee"], variations=["T1"], trials=6)
    limits = {t.id: t.resolve().task.step_limit(t.resolve().condition) for t in plan.trials}
    assert len(set(limits.values())) == 2
    together, ordered = OWN_WORLD.in_order(plan.trials, last=0), OWN_WORLD.in_order(plan.trials, last=8)
    assert ordered[:4] == together[:4]
    assert [limits[t.id] for t in ordered[4:]] == sorted((limits[t.id] for t in together[4:]), reverse=True)
    assert set(map(str, ordered)) == set(map(str, plan.trials))


@pytest.mark.parametrize("envs", [0, 257])
def test_an_impossible_number_of_environments_is_refused_before_anything_is_written(tiny_plan, tmp_path, envs):
    with pytest.raises(InvalidInputError, match="--envs"):
        evaluate(tiny_plan(), tmp_path / "run", envs=envs)
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_several_workers_share_one_process_with_the_weights(plugin, tiny_plan, tmp_path, run_content):
    plan = tiny_plan(f"{plugin}:Heavy", trials=2)
    run = evaluate(plan, tmp_path / "run", workers=2)
    assert len(list(tmp_path.glob("loaded-*"))) == 1, "its weights are there once, in the host"
    assert all(e.status == "done" for e in run.entries())
    assert len({e.wall["worker"] for e in run.entries()}) == 2
    assert {r.metadata.policy for r in run.records()} == {plan.policy}
    assert run_content(evaluate(plan, tmp_path / "alone").path) == run_content(run.path)


@in_turn(0, 2)
@pytest.mark.usefixtures("four_processors")
@pytest.mark.parametrize(("workers", "loaded"), [(None, 1), pytest.param(2, 2, marks=pytest.mark.slow)])
def test_weights_that_cannot_be_shared_are_loaded_once_unless_more_workers_are_asked_for(
    plugin, tiny_plan, tmp_path, workers, loaded
):
    run = evaluate(tiny_plan(f"{plugin}:HeavyAlone?loaded={loaded}", trials=2), tmp_path / "run", workers=workers)
    assert len(list(tmp_path.glob("loaded-*"))) == loaded
    assert [e.status for e in run.entries()] == ["done"] * 2
    assert run.context["engine"] == {"name": "local", "workers": workers or 1, "envs": 1}


@in_turn(1, 2)
@pytest.mark.parametrize(
    "policy", ["Raising", pytest.param("Bent", marks=pytest.mark.slow), pytest.param("Exits", marks=pytest.mark.slow)]
)
def test_what_a_policy_breaks_with_is_told_in_the_same_words_whoever_asks(
    plugin, tiny_plan, tmp_path, run_content, policy
):
    plan = tiny_plan(f"{plugin}:{policy}", trials=2)
    hosted = evaluate(plan, tmp_path / "hosted", workers=2)
    alone = evaluate(plan, tmp_path / "alone", workers=1)
    assert all(error and "127.0.0.1" not in error for _, error in outcomes(hosted).values())
    assert outcomes(hosted) == outcomes(alone)
    assert run_content(hosted.path) == run_content(alone.path)


@pytest.mark.slow
def test_a_host_whose_policy_hangs_is_replaced_and_later_trials_are_not_harmed(plugin, tiny_plan, tmp_path, caplog):
    plan = tiny_plan(f"{plugin}:HangsOnce", trials=6)
    run = evaluate(plan, tmp_path / "run", workers=2, envs=1, policy_timeout_s=4.0)
    assert "hangs and is restarted" in caplog.text
    told = [error for _, error in outcomes(run).values()]
    late = [error for error in told if error]
    assert 1 <= len(late) <= 2, "those in the batch that hung"
    assert set(late) == {"the policy did not answer within 4 s. Raise --policy-timeout."}
    assert [e.status for e in run.entries()] == ["done"] * 6


def test_the_process_that_was_asked_closes_its_policy(plugin, tiny_plan, tmp_path):
    with Host(f"{plugin}:Closing", run=("ee_delta", "state_only")) as host:
        assert not host.takes_batches
        assert not list(tmp_path.glob("closed-*"))
    assert len(list(tmp_path.glob("closed-*"))) == 1


def test_a_policy_whose_process_dies_while_loading_is_told_at_once(plugin, tiny_plan, tmp_path):
    with pytest.raises(PolicyError, match="the process of the policy ended while loading"):
        evaluate(tiny_plan(f"{plugin}:DiesLoading"), tmp_path / "run", workers=2)
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_a_dead_process_is_noticed_although_a_child_of_its_lives_on(plugin, tiny_plan, tmp_path):
    plan = tiny_plan(f"{plugin}:LeavesAChild", trials=3)
    run = evaluate(plan, tmp_path / "run", workers=2)
    assert (tmp_path / "forked").exists()
    assert outcomes(run) == dict.fromkeys(range(3), OVER)


@pytest.mark.slow
@pytest.mark.parametrize("room", [1, 2])
def test_workers_that_cannot_start_cost_no_trial(plugin, tiny_plan, tmp_path, caplog, room):
    file = Path(plugin.removeprefix("python:"))
    file.write_text(PLUGIN.replace("ROOM = 2", f"ROOM = {room}"), encoding="utf-8")
    plan = tiny_plan(f"{plugin}:NotInWorkers", trials=4)
    if room == 1:  # for the process that was asked before the run, and no worker
        with pytest.raises(WorkerError, match="3 worker processes died during their start"):
            evaluate(plan, tmp_path / "run", workers=2)
        assert [e.status for e in RunFolder.open(tmp_path / "run").entries()] == []
        return
    run = evaluate(plan, tmp_path / "run", workers=2)
    assert "a worker process died during its start" in caplog.text
    assert outcomes(run) == dict.fromkeys(range(4), OVER)


def test_an_error_with_what_is_no_text_is_the_policys_error_too(plugin, tiny_plan, tmp_path):
    run = evaluate(tiny_plan(f"{plugin}:Odd", trials=1), tmp_path / "run")
    ((_, error),) = outcomes(run).values()
    assert error is not None
    assert error.startswith("FileNotFoundError")
    assert "no such" in error


def test_an_attribute_of_the_policy_is_no_figure_of_a_client(plugin, tiny_plan, tmp_path):
    run = evaluate(tiny_plan(f"{plugin}:Counting", trials=1), tmp_path / "run")
    assert outcomes(run) == {0: OVER}
    assert all("attention" not in e.wall for e in run.entries())


@pytest.mark.slow
def test_a_shared_policy_whose_process_is_killed_is_loaded_again_and_no_record_changes(
    plugin, tiny_plan, tmp_path, run_content
):
    plan = tiny_plan(f"{plugin}:Mortal", trials=2)
    run = evaluate(plan, tmp_path / "run", workers=2)
    assert (tmp_path / "died").exists()
    assert len(list(tmp_path.glob("loaded-*"))) == 2
    assert all(e.status == "done" for e in run.entries())
    assert run_content(evaluate(plan, tmp_path / "alone").path) == run_content(run.path)
