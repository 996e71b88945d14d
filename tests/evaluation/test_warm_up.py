"""Runs whose number of environments a warm-up chooses: the records stay those of any other number."""

from __future__ import annotations

import dataclasses
import os
import threading
import time

import numpy as np
import pytest
from tests.evaluation.conftest import check_steps, tiny

from betterbench.evaluation import Plan, evaluate, make_plan
from betterbench.evaluation.workers import memory
from betterbench.policies.serving.server import PolicyServer
from betterbench.records import RunFolder

LATENCY_S = 0.15
CHUNK = 2
STEPS = 10
"""Steps after which a trial ends, because the policy answers with what is no number."""


class Slow:
    """Answers after a while with a chunk of small motions, until it has had enough; the first answer takes longer."""

    first_s = 0.0
    drops = 0
    lock = threading.Lock()

    def answer(self, request):
        with Slow.lock:
            waits_s, Slow.first_s = Slow.first_s, 0.0
            Slow.drops, dropped = max(0, Slow.drops - 1), Slow.drops > 0
        if dropped:
            raise ConnectionError("dropped")
        time.sleep(LATENCY_S + waits_s)
        step = float(np.asarray(request["better/step"]))
        first = 0.2 * np.sin(step) if step < STEPS else np.nan
        return {"actions": np.tile([first, 0.1, 0.0, 0.0, 0.0, 0.0, -1.0], (CHUNK, 1))}

    def close(self):
        pass


@pytest.fixture(scope="module")
def address():
    Slow.first_s, Slow.drops = 0.0, 0
    with PolicyServer(Slow, metadata={}, port=0) as server:
        yield f"{server.address}?preset=native"


def many(policy: str, trials: int = 16) -> Plan:
    """Returns the plan of many trials in few scenes: conditions that differ in words or layout share one."""
    variations = ["L1", "L2", "L3", "L4"]
    plan = make_plan(
        policy, tasks=["morning_coffee"], variations=variations, trials=3, observation="state_only", quality="fast"
    )
    return dataclasses.replace(plan, trials=plan.trials[:trials])


@pytest.fixture(scope="module")
def chosen(address, tmp_path_factory):
    """A run of sixteen trials, whose warm-up chose its number of environments."""
    Slow.first_s = 1.0
    return evaluate(many(address), tmp_path_factory.mktemp("chosen") / "run")


@pytest.fixture(scope="module")
def alone(address, tmp_path_factory):
    """A run of two trials in a single environment."""
    return evaluate(tiny(address, trials=2), tmp_path_factory.mktemp("alone") / "run", envs=1)


def numbers(run: RunFolder) -> list[float]:
    return [e.wall["envs"] for e in run.entries()]


def test_a_warm_up_opens_more_environments_and_changes_no_record(chosen, address, tmp_path, run_content):
    assert chosen.context["engine"] == {"name": "local", "workers": 1, "envs": 8, "most_envs": 96}
    assert max(numbers(chosen)) > 8
    plan = many(address)
    last = evaluate(dataclasses.replace(plan, trials=plan.trials[8:]), tmp_path / "six", envs=6)
    assert last.context["engine"] == {"name": "local", "workers": 1, "envs": 6}
    assert set(numbers(last)) == {6.0}, "a number that was asked for is kept"
    assert run_content(last.path).items() <= run_content(chosen.path).items()


def test_a_single_environment_can_be_forced(alone):
    assert set(numbers(alone)) == {1.0}


def test_a_run_is_resumed_with_another_number(chosen, address, tmp_path, run_content):
    plan = many(address, trials=12)
    interrupted = []

    def stop(progress):
        interrupted.append(progress)
        if progress.done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(plan, tmp_path / "run", envs=4, on_progress=stop)
    again = evaluate(plan, tmp_path / "run")
    assert len(again.entries()) == 12
    assert run_content(again.path).items() <= run_content(chosen.path).items()
    assert 4.0 in numbers(again)
    assert max(numbers(again)) >= 8.0


def test_more_workers_than_trials_tell_their_steps_before_a_trial_ends_and_change_no_record(
    alone, address, tmp_path, run_content, monkeypatch
):
    monkeypatch.setattr(Slow, "first_s", 1.0)
    told = []
    run = evaluate(
        tiny(address, trials=2),
        tmp_path / "run",
        workers=3,
        on_progress=lambda state: told.append(("trial", state.done)),
        on_steps=lambda steps: told.append(("steps", steps)),
    )
    assert len(run.entries()) == 2
    assert float(os.getpid()) not in {e.wall["worker"] for e in run.entries()}, "the work was done elsewhere"
    assert run_content(run.path) == run_content(alone.path)
    check_steps(told)


def test_a_server_that_takes_few_connections_gets_no_more(tmp_path, caplog):
    Slow.first_s, Slow.drops = 0.0, 0
    with PolicyServer(Slow, metadata={}, port=0, clients=9) as server:
        address = f"{server.address}?preset=native&patience=1&retries=1"
        run = evaluate(many(address), tmp_path / "run")
    assert {e.status for e in run.entries()} == {"done"}
    assert {r.n_steps for r in run.records()} == {STEPS}
    # On a busy machine, fewer may be open at the end: the server frees the place of an ended connection after a while.
    assert max(numbers(run)) > 4.0
    assert numbers(run)[-1] <= 9.0
    assert "the policy accepts no further connection" in caplog.text


def test_a_wait_is_told_apart_from_work(alone):
    for entry in alone.entries():
        wall = entry.wall
        assert wall["policy_answers"] * LATENCY_S <= wall["policy_s"]
        assert 0.8 * wall["policy_s"] <= wall["idle_s"] <= wall["total_s"] + 0.5
        assert 0.0 < wall["wire_s"] < wall["policy_s"]


def test_memory_of_a_container_counts(tmp_path):
    proc, groups = tmp_path / "proc", tmp_path / "groups"
    (proc / "self").mkdir(parents=True)
    (proc / "meminfo").write_text("MemTotal: 100 kB\nMemAvailable: 8000000 kB\n")
    (proc / "self" / "cgroup").write_text("0::/job/step\n")
    assert memory.free_bytes(proc=proc, groups=groups) == 8_000_000 * 1024
    (groups / "job" / "step").mkdir(parents=True)
    (groups / "job" / "memory.max").write_text("3000000000\n")
    (groups / "job" / "memory.current").write_text("1000000000\n")
    (groups / "job" / "memory.stat").write_text("anon 5\ninactive_file 250000000\n")
    (groups / "job" / "step" / "memory.max").write_text("max\n")
    assert memory.free_bytes(proc=proc, groups=groups) == 2_250_000_000
    (proc / "self" / "cgroup").write_text("4:cpu,memory:/job\n")
    (groups / "memory" / "job").mkdir(parents=True)
    (groups / "memory" / "job" / "memory.limit_in_bytes").write_text("500\n")
    (groups / "memory" / "job" / "memory.usage_in_bytes").write_text("900\n")
    assert memory.free_bytes(proc=proc, groups=groups) == 0
    assert memory.free_bytes(proc=tmp_path / "none", groups=groups) is None


def test_environments_get_half_of_the_free_memory_shared_by_the_workers():
    def room(**changes):
        known = {"used_before": 0, "sharing": 2, "free": 8 << 30, "used": 8 << 30}
        return memory.room_for(8, **{**known, **changes})

    assert room() == 8 + 2, "1 GiB each, and 2 GiB for this worker"
    assert room(sharing=1) == 8 + 4
    assert room(free=0) == 8
    assert room(used=0) == 8 + 128, "none is taken for smaller than 16 MiB"
    assert memory.used_bytes() > 1 << 20
