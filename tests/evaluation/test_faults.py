"""The fault table: whatever goes wrong, no trial is lost, and the record or the message says what it was."""

from __future__ import annotations

import contextlib
import dataclasses
import multiprocessing
import os
import re
import signal
import socket
import tempfile
import threading
import time
from pathlib import Path

import pytest
from tests.daily import others_slow
from tests.evaluation.conftest import FEW_STEPS, tiny
from tests.evaluation.few_steps import in_few_steps, worker_of_few_steps
from tests.evaluation.misbehaving import CHUNK, Misbehaving

from betterbench.errors import PolicyUnavailableError, RunConflictError, StorageError
from betterbench.evaluation import evaluate
from betterbench.evaluation.workers import pool
from betterbench.interface import episode_number
from betterbench.records import RunFolder
from betterbench.tasks.trial import Trial

pytestmark = pytest.mark.physics

STEPS = FEW_STEPS
assert STEPS == 3 * CHUNK


@pytest.fixture(autouse=True)
def short(short_trials):
    """Every trial is short."""


@pytest.fixture(autouse=True)
def nobody_is_left():
    before = set(threading.enumerate())
    yield
    until = time.monotonic() + 5.0
    while set(threading.enumerate()) - before and time.monotonic() < until:
        time.sleep(0.01)
    assert set(threading.enumerate()) - before == set()
    assert multiprocessing.active_children() == []


def never(request, number):
    return None


def at_second(fault):
    """Names a fault for the second question of seed 1, once."""
    left = [fault]

    def script(request, number):
        wanted = request["better/episode"]["episode"] == episode_number(1) and request["better/step"] == CHUNK
        return left.pop() if wanted and left else None

    return script


def entries(run: RunFolder) -> dict[int, tuple[str, str | None]]:
    assert len(run.entries()) == len((run.path / "journal.jsonl").read_text(encoding="utf-8").splitlines())
    return {e.seed: (e.status, e.message) for e in run.entries()}


@pytest.fixture(scope="module")
def calm(tmp_path_factory):
    """The records of a run of three trials in which nothing went wrong, by seed."""
    with pytest.MonkeyPatch.context() as patch, Misbehaving(never) as server:
        patch.setattr(Trial, "resolve", in_few_steps(STEPS))
        run = evaluate(tiny(server.address, trials=3), tmp_path_factory.mktemp("calm") / "run")
        assert entries(run) == dict.fromkeys(range(3), ("done", None))
        return {r.metadata.seed: r for r in run.records()}


def same_as(record, calm) -> bool:
    """Tells whether a record holds the motion of the calm run; the port is part of the policy's name."""
    known = calm[record.metadata.seed]
    return dataclasses.replace(
        record, metadata=dataclasses.replace(record.metadata, policy=known.metadata.policy)
    ).same_bits(known)


BAD = {
    "nan": r"z = nan.* action 7 of a chunk of 8",
    "inf": r"z = inf.* action 7 of a chunk of 8",
    "wrong shape": r"6",
    "three axes": r"2, 8, 7",
    "wrong dtype": r"complex|c16",
    "texts": r"U8|text|number",
    "empty chunk": r"empty|no action|at least one",
    "no actions": r"actions",
    "no map": r"map|list",
    "garbage": r"msgpack|read|decode|unpack",
    "an array that lies": r"byte|array|shape",
    "an error": r"CUDA out of memory",
    "oversized": r"large|big|bytes|size",
}


@pytest.mark.parametrize(("fault", "reason"), others_slow(BAD.items(), 3), ids=BAD.keys())
def test_a_bad_reply_ends_its_trial_with_the_reason_and_no_other(fault, reason, tiny_plan, tmp_path, calm):
    with Misbehaving(at_second(fault)) as server:
        run = evaluate(tiny_plan(server.address, trials=3), tmp_path / "run", envs=3)
    assert server.faults == [fault]
    records = {r.metadata.seed: r for r in run.records()}
    assert {seed: status for seed, (status, _) in entries(run).items()} == dict.fromkeys(range(3), "done")
    assert same_as(records[0], calm)
    assert same_as(records[2], calm)
    outcome = records[1].outcome
    assert (outcome.termination, records[1].n_steps) == ("policy_error", CHUNK)
    assert re.search(reason, outcome.error), outcome.error
    assert "\n" not in outcome.error.splitlines()[0]


def test_what_is_out_of_range_is_clipped_and_counted(tiny_plan, tmp_path):
    with Misbehaving(at_second("out of range")) as server:
        run = evaluate(tiny_plan(server.address, trials=2), tmp_path / "run", envs=2)
    records = {r.metadata.seed: r for r in run.records()}
    assert records[1].outcome.termination == "step_limit"
    assert records[1].outcome.clipped_actions == CHUNK
    assert abs(records[1].applied[1:]).max() == 1.0
    assert records[0].outcome.clipped_actions == 0


@pytest.mark.parametrize("fault", others_slow(["drop", "half a frame", "late"], 3))
def test_a_broken_request_is_asked_again_and_changes_no_record(fault, tiny_plan, tmp_path, calm):
    with Misbehaving(at_second(fault)) as server:
        run = evaluate(tiny_plan(server.address, trials=3), tmp_path / "run", envs=3)
    assert server.faults == [fault]
    assert entries(run) == dict.fromkeys(range(3), ("done", None))
    assert all(same_as(r, calm) for r in run.records())
    walls = {e.seed: e.wall for e in run.entries()}
    assert walls[1]["policy_retries"] == walls[1]["policy_reconnects"] == 1.0
    assert walls[0]["policy_retries"] == 0.0


def test_a_request_that_fails_for_ever_ends_its_trial_and_not_the_run(tiny_plan, tmp_path, calm):
    def script(request, number):
        return (
            "drop"
            if request["better/episode"]["episode"] == episode_number(1) and request["better/step"] == CHUNK
            else None
        )

    with Misbehaving(script) as server:
        run = evaluate(tiny_plan(server.address, trials=3), tmp_path / "run", envs=3)
    assert len(server.faults) == 4, "asked once and three times again"
    records = {r.metadata.seed: r for r in run.records()}
    assert records[1].outcome.termination == "policy_error"
    assert "failed to answer 4 times" in records[1].outcome.error
    assert same_as(records[0], calm)
    assert same_as(records[2], calm)


def test_a_server_that_is_restarted_is_found_again_and_changes_no_record(tiny_plan, tmp_path, calm):
    turn = threading.Event()

    def script(request, number):
        if number == 4:
            turn.set()

    with Misbehaving(script) as server:

        def restart():
            turn.wait(30.0)
            server.restart()

        thread = threading.Thread(target=restart)
        thread.start()
        run = evaluate(tiny_plan(server.address, trials=3), tmp_path / "run", envs=2)
        thread.join()
    assert entries(run) == dict.fromkeys(range(3), ("done", None))
    assert all(same_as(r, calm) for r in run.records())


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        return listening.getsockname()[1]


def test_a_server_that_was_never_there_is_one_line_and_nothing_is_written(tiny_plan, tmp_path):
    address = f"openpi://127.0.0.1:{free_port()}?preset=native&patience=0.3"
    with pytest.raises(PolicyUnavailableError, match=r"could not be reached for 0\.3 s") as raised:
        evaluate(tiny_plan(address), tmp_path / "run")
    assert len(str(raised.value).splitlines()) == 1
    assert not (tmp_path / "run").exists()


def test_a_server_that_goes_away_for_good_stops_the_run_which_the_same_command_finishes(tiny_plan, tmp_path, calm):
    gone = threading.Event()

    def script(request, number):
        if request["better/episode"]["episode"] == episode_number(1):
            gone.set()
            return "drop"
        return None

    with Misbehaving(script) as server:
        address = server.address.replace("patience=20", "patience=1")

        def leave():
            gone.wait(30.0)
            server.stop()

        thread = threading.Thread(target=leave)
        thread.start()
        with pytest.raises(PolicyUnavailableError, match="could not be reached for 1 s"):
            evaluate(tiny_plan(address, trials=3), tmp_path / "run", envs=1)
        thread.join()
        found = entries(RunFolder.open(tmp_path / "run"))
        assert found[0] == ("done", None)
        assert found[1][0] == "error"
        assert "could not be reached" in found[1][1]
        assert 2 not in found, "the rest of the trials is not burnt"
        server.script = never
        server.start()
        run = evaluate(tiny_plan(address, trials=3), tmp_path / "run")
    assert {e.seed: e.status for e in run.entries()} == dict.fromkeys(range(3), "done")
    assert all(same_as(r, calm) for r in run.records())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device that is always full")
@pytest.mark.parametrize("what", others_slow(["record", "journal"], 2))
def test_a_full_disk_stops_the_run_which_the_same_command_finishes(what, tiny_plan, tmp_path, monkeypatch, calm):
    count = [0]
    with Misbehaving(never) as server:
        plan = tiny_plan(server.address, trials=3)
        if what == "record":
            ordinary = tempfile.mkstemp

            def full(**names):
                handle, name = ordinary(**names)
                if not names["prefix"].startswith(".1.parquet"):
                    return handle, name
                count[0] += 1
                os.close(handle)
                return os.open("/dev/full", os.O_WRONLY), name

            monkeypatch.setattr("betterbench.jobs.durable.tempfile.mkstemp", full)
        else:
            write = os.pwrite

            def full(handle, data, offset):
                count[0] += b'"seed":1' in data.replace(b" ", b"")
                if b'"seed":1' in data.replace(b" ", b""):
                    write(handle, data[:20], offset)
                    with open("/dev/full", "wb", buffering=0) as device:  # noqa: PTH123
                        device.write(data)
                return write(handle, data, offset)

            monkeypatch.setattr("betterbench.jobs.line_journal.os.pwrite", full)
        with pytest.raises(StorageError, match=r"No space left on device.* run the same command again"):
            evaluate(plan, tmp_path / "run", envs=1)
        monkeypatch.undo()
        assert count == [1]
        assert entries(RunFolder.open(tmp_path / "run")) == {0: ("done", None)}
        run = evaluate(plan, tmp_path / "run")
    assert entries(run) == dict.fromkeys(range(3), ("done", None))
    assert all(same_as(r, calm) for r in run.records())
    assert not list(run.path.rglob("*.part"))


def test_ctrl_c_stops_at_once_and_the_same_command_finishes(tiny_plan, tmp_path, calm):
    def script(request, number):
        if request["better/episode"]["episode"] == episode_number(1):
            os.kill(os.getpid(), signal.SIGINT)
            return "late"
        return None

    with Misbehaving(script) as server:
        plan = tiny_plan(server.address, trials=3)
        with pytest.raises(KeyboardInterrupt):
            evaluate(plan, tmp_path / "run", envs=1)
        assert entries(RunFolder.open(tmp_path / "run")) == {0: ("done", None)}
        server.script = never
        run = evaluate(plan, tmp_path / "run")
    assert entries(run) == dict.fromkeys(range(3), ("done", None))
    assert all(same_as(r, calm) for r in run.records())


def test_two_runs_into_one_folder_are_refused_and_the_first_one_is_not_disturbed(tiny_plan, tmp_path, calm):
    refused = []
    with Misbehaving(never) as server:
        plan = tiny_plan(server.address, trials=3)

        def second(progress):
            if progress.done == 1:
                with pytest.raises(RunConflictError, match="is writing here"):
                    evaluate(plan, tmp_path / "run")
                refused.append(True)

        run = evaluate(plan, tmp_path / "run", on_progress=second)
    assert refused == [True]
    assert entries(run) == dict.fromkeys(range(3), ("done", None))
    assert all(same_as(r, calm) for r in run.records())


# ----------------------------------------------------------------------------------------------------- worker processes


@pytest.mark.slow
def test_a_worker_that_is_killed_is_replaced_and_its_trials_are_done_again(tiny_plan, tmp_path, monkeypatch, calm):
    monkeypatch.setattr(pool, "work", worker_of_few_steps(STEPS))
    killed = []

    def script(request, number):
        if not killed and request["better/episode"]["episode"] == episode_number(1) and request["better/step"] == CHUNK:
            killed.extend(p.pid for p in multiprocessing.active_children())
            for pid in killed:
                os.kill(pid, signal.SIGKILL)

    with Misbehaving(script) as server:
        run = evaluate(tiny_plan(server.address, trials=3), tmp_path / "run", workers=2)
    assert len(killed) == 2
    assert entries(run) == dict.fromkeys(range(3), ("done", None))
    (worker,) = (int(e.wall["worker"]) for e in run.entries() if e.seed == 1)
    assert worker not in killed  # On a busy machine, a worker may finish another trial before it is killed.
    assert all(same_as(r, calm) for r in run.records())


@pytest.mark.slow
def test_ctrl_c_ends_all_worker_processes(tiny_plan, tmp_path, monkeypatch, calm):
    monkeypatch.setattr(pool, "work", worker_of_few_steps(STEPS))
    children = []

    def script(request, number):
        if request["better/episode"]["episode"] == episode_number(1) and not children:
            children.extend(p.pid for p in multiprocessing.active_children())
            for pid in (*children, os.getpid()):  # as a terminal does
                os.kill(pid, signal.SIGINT)
        return "late" if request["better/episode"]["episode"] == episode_number(1) and request["better/step"] else None

    with Misbehaving(script) as server:
        plan = tiny_plan(server.address, trials=3)
        with pytest.raises(KeyboardInterrupt):
            evaluate(plan, tmp_path / "run", workers=2, envs=1)
        for pid in children:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, 0)
                raise AssertionError(f"worker {pid} lives on")
        server.script = never
        run = evaluate(plan, tmp_path / "run")
    assert len(children) == 2
    assert {e.seed: e.status for e in run.entries()} == dict.fromkeys(range(3), "done")
    assert all(same_as(r, calm) for r in run.records())
