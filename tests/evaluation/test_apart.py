"""Policies that are not ours are asked in a process of their own: what they do to it costs at most their own trial."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tests.daily import others_slow
from tests.evaluation.few_steps import in_few_steps

import betterbench
from betterbench.errors import InvalidInputError, PolicyError, PolicyKilledError, PolicyProcessError
from betterbench.evaluation import evaluate
from betterbench.interface import EpisodeStart, PolicyInfo, episode_number
from betterbench.policies.process import policy_process
from betterbench.policies.process.policy_process import BatchPolicyProcess, PolicyProcess, start_policy
from betterbench.records import RunFolder
from betterbench.tasks.trial import Trial

STEPS = 12

PLUGIN = """
import asyncio, os, pathlib, random, resource, signal, socket, stat, sys, threading, time
import numpy as np
from betterbench.errors import PolicyError
from betterbench.interface import Execution, PolicyInfo, episode_number

STILL = np.array([0.0] * 6 + [-1.0])

class Unspeakable(Exception):
    def __str__(self):
        raise RuntimeError("no words")

class OfMine(PolicyInfo):
    pass

class Calm:
    info = PolicyInfo("misbehaving", needs_images=False)
    def reset(self, start):
        self.second = start.episode == episode_number(1)
    def act(self, observation):
        if observation.step >= STEPS:
            raise RuntimeError("enough")
        if self.second and observation.step == 3:
            self.misbehave()
        return STILL
    def misbehave(self):
        raise RuntimeError("out of memory")

def does(name):
    def named(method):
        globals()[name] = type(name, (Calm,), {"misbehave": method})
        return method
    return named

does("Exits")(lambda self: os._exit(3))
does("LeavesSilently")(lambda self: os._exit(0))
does("Segfaults")(lambda self: os.kill(os.getpid(), signal.SIGSEGV))
does("Alarmed")(lambda self: (signal.setitimer(signal.ITIMER_REAL, 0.3), time.sleep(20)))
does("ClosesAll")(lambda self: os.closerange(0, 4096))
does("Unsayable")(lambda self: (_ for _ in ()).throw(Unspeakable()))
does("Cancelled")(lambda self: (_ for _ in ()).throw(asyncio.CancelledError("now")))
does("Interrupts")(lambda self: (_ for _ in ()).throw(KeyboardInterrupt()))
does("Stops")(lambda self: (_ for _ in ()).throw(GeneratorExit()))
does("Group")(lambda self: os.killpg(0, signal.SIGABRT))
does("Recurses")(lambda self: Recurses.misbehave(self))

@does("Elsewhere")
def elsewhere(self):
    os.chdir("/")
    os.environ.clear()
    np.random.seed(0)
    random.seed(0)
    np.seterr(all="raise")
    sys.path.clear()
    print("on standard output")
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_NOFILE, (20, 20))
    threading.Thread(target=time.sleep, args=(3600,)).start()

class Any(Calm):
    def act(self, observation):
        if observation.what is not None:
            globals()[observation.what].misbehave(self)
        return STILL

class EvilText(str):
    def __str__(self):
        return self
    def encode(self, *_):
        return self
    def decode(self, *_):
        return self
    def __reduce__(self):
        return (pathlib.Path(__file__).with_name("ran").touch, ())

@does("Evil")
def evil(self):
    raise PolicyError(EvilText("wicked"))

@does("Twice")
def twice(self):
    ordinary = socket.socket.sendall
    def sendall(self, data):
        ordinary(self, data)
        ordinary(self, data)
    socket.socket.sendall = sendall

@does("Bits")
def bits(self):
    for number in map(int, os.listdir("/proc/self/fd")):
        try:
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                os.write(number, b"garbage that is no frame, and longer than its head")
        except OSError:
            pass

@does("Nonblocking")
def nonblocking(self):
    os.set_blocking(1, False)
    os.set_blocking(2, False)
    print("\\x1b[2J steers", file=sys.stderr)

@does("Leaves")
def leaves(self):
    if not os.fork():
        os.setsid()
        if not os.fork():
            time.sleep(3600)
        os._exit(0)
    os.wait()

@does("Poisons")
def poisons(self):
    np.asarray = None
    raise RuntimeError("poisoned")

class Hanging:
    def __init__(self):
        time.sleep(3600)

class Killed(Calm):
    def misbehave(self):
        marker = pathlib.Path(__file__).parent / "killed"
        if not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)

class Swallows(Calm):
    def act(self, observation):
        given = super().act(observation)
        return np.zeros(3) if self.second and observation.step == 3 else given
    def misbehave(self):
        there = [int(name) for name in os.listdir("/proc/self/fd") if os.path.exists(f"/proc/self/fd/{name}")]
        link = next(number for number in there if stat.S_ISSOCK(os.fstat(number).st_mode))
        threading.Thread(target=os.read, args=(link, 1 << 20), daemon=True).start()

class Batched:
    info = OfMine("batched", needs_images=False, metadata={"mine": "yes"})
    def reset(self, start):
        pass
    def act(self, observation):
        return self.act_batch([observation])[0]
    def act_batch(self, observations):
        if "crash" in observations:
            os._exit(4)
        if "kill" in observations:
            os.kill(os.getpid(), signal.SIGKILL)
        return [np.full(7, len(observations), dtype=np.float32) for o in observations]

class Objects(Calm):
    def act(self, observation):
        return observation if isinstance(observation, int) else [object(), object()]

class Large(Calm):
    def act(self, observation):
        return np.zeros(10_000_000)

class Unloadable:
    def __init__(self):
        raise RuntimeError("CUDA out of memory")

class Gone:
    def __init__(self):
        os._exit(9)
""".replace("STEPS", str(STEPS))


@pytest.fixture
def plugin(tmp_path):
    (tmp_path / "misbehaving_policy.py").write_text(PLUGIN, encoding="utf-8")
    return f"python:{tmp_path / 'misbehaving_policy.py'}"


@pytest.fixture(autouse=True)
def no_thread_is_left():
    yield
    until = time.monotonic() + 5.0
    while any(t.name in ("policy", "collector") for t in threading.enumerate()) and time.monotonic() < until:
        time.sleep(0.01)
    assert [t.name for t in threading.enumerate() if t.name in ("policy", "collector")] == []


START = EpisodeStart("do it", episode_number(1), "ee_delta")

ENDS = {
    "Calm": "RuntimeError: out of memory",
    "Exits": r"the process of the policy ended during a request \(exit status 3\)",
    "LeavesSilently": r"ended during a request \(exit status 0\)",
    "Segfaults": r"ended during a request \(SIGSEGV\)",
    "Alarmed": r"ended during a request \(SIGALRM\)",
    "ClosesAll": "ended during a request",
    "Unsayable": "Unspeakable: the error cannot be shown as text",
    "Cancelled": "CancelledError: now",
    "Interrupts": "KeyboardInterrupt",
    "Stops": "GeneratorExit",
    "Group": r"ended during a request \(SIGABRT\)",
    "Recurses": "RecursionError",
    "Evil": "wicked",
    "Poisons": "poisoned",
    "Bits": "sent an invalid answer",
}


def seen(step, what=None):
    """Return what stands for an observation; to read a class of this module, each process would import pytest."""
    return SimpleNamespace(step=step, what=what)


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    """A policy that does what the observation says, in one process for as long as that lives."""
    file = tmp_path_factory.mktemp("one") / "misbehaving_policy.py"
    file.write_text(PLUGIN, encoding="utf-8")
    policy = start_policy(f"python:{file}:Any")
    yield policy
    policy.close()


@pytest.fixture(autouse=True)
def nothing_that_a_policy_sends_is_run(one):
    yield
    ran = Path(one._address.removeprefix("python:").rpartition(":")[0]).with_name("ran")
    assert not ran.exists()


def test_an_answer_that_is_sent_twice_shifts_no_other_and_an_episode_begins_with_a_clean_process(one):
    one.reset(START)
    one.act(seen(3, "Twice"))
    process = one._running._process.pid
    assert [one.act(seen(step)).shape for step in (4, 5)] == [(7,), (7,)]
    time.sleep(0.05)  # until the second copy of the last one is there
    one.reset(START)
    assert one._running._process.pid != process
    with pytest.raises(PolicyError, match="out of memory"):
        one.act(seen(3, "Calm"))
    failed = one._running._process.pid
    one.reset(START)
    assert one._running._process.pid != failed, "what it did before it failed harms no other trial"


def test_a_process_says_since_when_it_can_be_asked(plugin, monkeypatch):
    policy = start_policy(f"{plugin}:Calm")
    began, first, during = time.perf_counter(), policy.ready_at, []
    ordinary = policy_process._Started.loaded

    def loaded(started, timeout_s):
        during.append(policy.ready_at)
        return ordinary(started, timeout_s)

    monkeypatch.setattr(policy_process._Started, "loaded", loaded)
    policy.reset(START)
    with pytest.raises(PolicyError, match="enough"):
        policy.act(seen(STEPS))
    assert first <= began
    assert policy.ready_at == first
    policy.reset(START)  # in another process
    policy.close()
    assert during == [math.inf]
    assert began < policy.ready_at < math.inf


def test_what_a_policy_does_to_its_outputs_is_not_done_to_ours(one, capsys):
    one.reset(START)
    one.act(seen(3, "Nonblocking"))
    assert os.get_blocking(1)
    assert os.get_blocking(2)
    until = time.monotonic() + 5.0
    said = ""
    while "steers" not in said and time.monotonic() < until:
        said += capsys.readouterr().err
        time.sleep(0.02)
    assert "\ufffd[2J steers" in said


def test_what_a_policy_has_started_ends_with_its_process(plugin):
    policy = start_policy(f"{plugin}:Leaves")
    policy.reset(START)
    policy.act(seen(3))
    mark = f"{policy_process.MARK}={policy._running._mark}".encode()

    def running():
        for place in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                alive = place.joinpath("stat").read_text().rpartition(")")[2].split()[0] != "Z"
                if alive and mark in place.joinpath("environ").read_bytes():
                    yield place.name

    assert len(list(running())) == 2
    policy.close()
    until = time.monotonic() + 5.0
    while list(running()) and time.monotonic() < until:
        time.sleep(0.02)
    assert list(running()) == []


def test_a_policy_that_never_loads_is_one_line(plugin):
    with pytest.raises(PolicyProcessError, match=r"loading took more than 1 s.*--policy-timeout"):
        start_policy(f"{plugin}:Hanging", load_s=1.0)


@pytest.mark.parametrize(
    ("name", "text"),
    others_slow(ENDS.items(), 4),
    ids=ENDS.keys(),
)
def test_whatever_a_policy_does_is_an_error_of_one_question(one, name, text):
    one.reset(START)
    with pytest.raises(PolicyError, match=text) as raised:
        one.act(seen(3, name))
    assert not isinstance(raised.value, PolicyKilledError)
    one.reset(START)
    assert one.act(seen(3)).tolist() == [0.0] * 6 + [-1.0]


def test_a_process_that_is_killed_while_it_loads_again_is_no_fault_of_the_policy(tmp_path):
    file, due = tmp_path / "frail.py", tmp_path / "due"
    code = f"""
import os, pathlib
from betterbench.interface import PolicyInfo
due = pathlib.Path({str(due)!r})
if due.exists():
    due.unlink()
    os.kill(os.getpid(), 9)
class Frail:
    info = PolicyInfo("frail", needs_images=False)
    def reset(self, start): pass
    def act(self, observation): return [0.0] * 7
"""
    file.write_text(code, encoding="utf-8")
    due.touch()
    with pytest.raises(PolicyProcessError, match=r"ended while loading \(SIGKILL"):
        start_policy(f"python:{file}:Frail")
    policy = start_policy(f"python:{file}:Frail")
    due.touch()
    os.kill(policy._running._process.pid, signal.SIGKILL)
    policy._running._process.wait()
    with pytest.raises(PolicyKilledError, match=r"ended while loading \(SIGKILL"):
        policy.reset(START)
    policy.reset(START)
    assert policy.act(seen(0)).tolist() == [0.0] * 7
    policy.close()


def test_what_a_policy_changes_in_its_process_is_not_changed_here(plugin, capfd):
    before = (Path.cwd(), dict(os.environ), list(sys.path), np.geterr(), signal.getsignal(signal.SIGTERM))
    policy = start_policy(f"{plugin}:Elsewhere")
    policy.reset(START)
    assert policy.act(seen(3)).shape == (7,)
    began = time.monotonic()
    policy.close()
    assert time.monotonic() - began < 3.0, "its threads do not keep it"
    assert before == (Path.cwd(), dict(os.environ), list(sys.path), np.geterr(), signal.getsignal(signal.SIGTERM))
    assert capfd.readouterr().out == ""


def test_a_batch_that_ends_its_process_is_told_and_one_that_was_killed_is_asked_again(plugin, monkeypatch):
    policy = start_policy(f"{plugin}:Batched")
    assert isinstance(policy, BatchPolicyProcess)
    assert type(policy.info) is PolicyInfo
    assert policy.info.metadata == {"mine": "yes"}
    with pytest.raises(PolicyError, match="exit status 4"):
        policy.act_batch(["well", "crash"])
    assert [a.tolist() for a in policy.act_batch(["well", "too"])] == [[2.0] * 7] * 2
    monkeypatch.setattr(policy_process, "MAX_KILLS", 2)
    with pytest.raises(PolicyKilledError, match="SIGKILL, for example because memory ran out"):
        policy.act_batch(["kill"])
    policy.close()
    with pytest.raises(PolicyError, match="the policy is closed"):
        policy.act_batch(["well"])


def test_answers_arrive_as_arrays_or_as_an_error(plugin):
    policy = PolicyProcess(f"{plugin}:Objects")
    assert policy.act(3).tolist() == 3
    assert policy.act(None).dtype == object
    assert policy.act(None).shape == (2,)
    policy.close()
    policy = PolicyProcess(f"{plugin}:Large")
    with pytest.raises(PolicyError, match="80000000 bytes is too large"):
        policy.act(seen(0))
    policy.close()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (
            "Unloadable",
            r"Unloadable cannot be created: RuntimeError: CUDA out of memory \(misbehaving_policy\.py, line",
        ),
        ("Gone", r"the process of the policy ended while loading \(exit status 9\)"),
    ],
)
def test_a_policy_that_cannot_be_loaded_is_one_line(plugin, name, text):
    with pytest.raises((InvalidInputError, PolicyProcessError), match=text) as raised:
        start_policy(f"{plugin}:{name}")
    assert len(str(raised.value).splitlines()) == 1


def test_closing_ends_a_question_that_hangs(plugin):
    policy = PolicyProcess(f"{plugin}:Alarmed")
    policy.reset(START)
    told = []

    def ask():
        with pytest.raises(PolicyError) as raised:
            policy.act(seen(3))
        told.append(raised.value)

    thread = threading.Thread(target=ask)
    thread.start()
    time.sleep(0.1)
    policy.close()
    thread.join(5.0)
    assert not thread.is_alive()
    assert len(told) == 1


@pytest.fixture
def short(monkeypatch):
    """Ends each trial before the policy has had enough."""
    monkeypatch.setattr(Trial, "resolve", in_few_steps(STEPS))


@pytest.mark.physics
@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("name", others_slow(["Elsewhere", "Killed"], 2))
def test_a_run_keeps_its_records_whatever_its_policy_does(plugin, tiny_plan, tmp_path, monkeypatch, name):
    """The relative path of a run is meant where the run began."""
    monkeypatch.chdir(tmp_path)
    run = evaluate(tiny_plan(f"{plugin}:{name}", trials=3), Path(name))
    entries = {e.seed: (e.status, e.message) for e in run.entries()}
    assert entries == dict.fromkeys(range(3), ("done", None))
    assert len(list((tmp_path / name / "records").rglob("*.parquet"))) == 3
    assert len(list(run.records())) == 3


@pytest.mark.physics
@pytest.mark.usefixtures("short")
def test_what_a_policy_did_before_its_action_was_refused_harms_no_other_trial(plugin, tiny_plan, tmp_path, monkeypatch):
    monkeypatch.setattr(policy_process, "CLOSE_S", 0.5)
    run = evaluate(tiny_plan(f"{plugin}:Swallows", trials=3), tmp_path / "run", policy_timeout_s=20.0)
    messages = {e.seed: e.message and e.message.partition(":")[0] for e in run.entries()}
    assert messages == {0: None, 1: "InvalidActionError", 2: None}


@pytest.mark.physics
@pytest.mark.usefixtures("short")
def test_the_last_trial_of_a_policy_that_ends_its_process_is_run_on_resuming(plugin, tiny_plan, tmp_path):
    """With one trial left, two workers are one, in this process."""
    plan = tiny_plan(f"{plugin}:Exits", trials=2)
    run = evaluate(plan, tmp_path / "run")
    first, second = run.journal_path.read_text().splitlines()
    assert json.loads(second)["seed"] == 1
    run.journal_path.write_text(f"{first}\n")
    run = evaluate(plan, tmp_path / "run", workers=2)
    assert {e.seed: e.status for e in run.entries()} == {0: "done", 1: "done"}
    assert "exit status 3" in str({e.seed: e.message for e in run.entries()}[1])


def test_a_run_folder_stays_where_it_was_when_the_working_directory_changes(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    run = RunFolder.start(Path("run"), {"policy": "noop"})
    opened = RunFolder.open(Path("run"))
    monkeypatch.chdir(tmp_path / "elsewhere")
    with run.journal():
        assert run.journal_path == opened.journal_path == tmp_path / "run" / "journal.jsonl"
    assert (tmp_path / "run" / "journal.jsonl").exists()


def test_the_process_of_a_policy_does_not_outlive_a_run_that_was_killed(plugin, tmp_path):
    code = (
        "import sys, time; from betterbench.policies.process.policy_process import start_policy\n"
        "policy = start_policy(sys.argv[1]); print(policy._running._process.pid, flush=True); time.sleep(60)"
    )
    source = str(Path(betterbench.__file__).parents[1])
    parent = subprocess.Popen(
        [sys.executable, "-c", code, f"{plugin}:Calm"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": source},
    )
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    parent.kill()
    parent.wait(10.0)
    parent.stdout.close()
    until = time.monotonic() + 10.0
    while Path(f"/proc/{child}").exists() and time.monotonic() < until:
        time.sleep(0.05)
    assert not Path(f"/proc/{child}").exists()
