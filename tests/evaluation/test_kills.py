"""Forty kills at random moments, of the run, a worker or the policy's process; the same command finishes the run."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import time
import uuid
from pathlib import Path

import numpy as np
import pytest
from tests.evaluation import misbehaviors
from tests.evaluation.conftest import content, tiny
from tests.evaluation.test_misbehavior import left_over, resolve_shortly

import betterbench
from betterbench.evaluation import evaluate
from betterbench.records import RunFolder
from betterbench.tasks.trial import Trial

pytestmark = [pytest.mark.physics, pytest.mark.slow]

KILLS = 40
TRIALS = 10
LONGEST_S = 600.0
"""Longest time of one start of the run [s], on a busy machine."""
SESSIONS = 80
"""So many starts are enough for all kills; more would be a run that makes no progress."""

SCRIPT = """
import sys
sys.path.insert(0, {tests!r})
from tests.evaluation.conftest import tiny
from tests.evaluation.test_misbehavior import evaluation, main, pool, resolve_shortly, Trial, work_shortly

if __name__ == "__main__":
    Trial.resolve, pool.work = resolve_shortly, work_shortly
    evaluation.make_plan = lambda policy, **_: tiny(policy, trials={trials})
    words = ["eval", "--policy", sys.argv[1], "--out", sys.argv[2], "--workers", sys.argv[3], "--uncertified"]
    sys.exit(main(words))
"""


def processes_of(mark, process):
    """Returns what a run consists of at the moment: the run itself, its workers and the processes of its policies."""
    found = {"run": [process.pid], "worker": [], "policy": []}
    for pid, line in left_over(mark):
        if pid != process.pid:
            found["policy" if b"asked_process" in line or b"import sys; sys.path" in line else "worker"].append(pid)
    return found


def kills(process, mark, kind, delay_s, draw):
    """Kills one process of a kind, some time after the first one was there; returns whether there was one by then."""
    there = []
    while not there and process.poll() is None:
        there = processes_of(mark, process)[kind]
        time.sleep(0.05)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(delay_s)
    there = processes_of(mark, process)[kind] if process.poll() is None else []
    if not there:
        return False
    with contextlib.suppress(ProcessLookupError):
        os.kill(there[int(draw.integers(len(there)))], signal.SIGKILL)
        return True
    return False


@pytest.fixture
def address(tmp_path):
    place = tmp_path / "policy"
    place.mkdir()
    shutil.copy(misbehaviors.__file__, place / "a_policy.py")
    return f"python:{place / 'a_policy.py'}:Misbehaving"


def test_forty_kills_at_random_moments_lose_nothing_and_change_nothing(address, tmp_path, monkeypatch):
    monkeypatch.setattr(Trial, "resolve", resolve_shortly)
    began = time.monotonic()
    known = content(evaluate(tiny(address, trials=TRIALS), tmp_path / "undisturbed").path)
    script = tmp_path / "run_tiny.py"
    tests = str(Path(__file__).parents[2])
    script.write_text(textwrap.dedent(SCRIPT).format(tests=tests, trials=TRIALS), encoding="utf-8")
    # A kill comes as late after what it kills has begun as this whole run took: in the middle, on any machine.
    longest_s = time.monotonic() - began
    draw, mark = np.random.default_rng(4015), uuid.uuid4().hex
    environment = {
        **os.environ,
        "PYTHONPATH": str(Path(betterbench.__file__).parents[1]),
        "BETTERBENCH_TEST_MARK": mark,
    }
    killed = {"run": 0, "worker": 0, "policy": 0}
    runs, sessions, before = 0, 0, 0
    said = tmp_path / "said"
    while sum(killed.values()) < KILLS or before:
        assert (sessions := sessions + 1) < SESSIONS
        out = tmp_path / f"run-{runs}"
        with said.open("ab") as stream:
            process = subprocess.Popen(
                [sys.executable, str(script), address, str(out), "2"],
                env=environment,
                start_new_session=True,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=stream,
            )
        try:
            until = time.monotonic() + LONGEST_S
            while process.poll() is None:
                assert time.monotonic() < until, "the run hangs"
                if sum(killed.values()) < KILLS:
                    kind = ("run", "worker", "policy", "policy")[int(draw.integers(4))]
                    killed[kind] += kills(process, mark, kind, float(draw.uniform(0.0, longest_s)), draw)
                else:
                    with contextlib.suppress(subprocess.TimeoutExpired):
                        process.wait(1.0)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process.pid, signal.SIGKILL)
            process.wait(30.0)
        done = 0
        if (out / "run.json").exists():
            done = sum(e.status == "done" for e in RunFolder.open(out).entries())
        assert done >= before, "a finished trial was lost"
        before = done
        if done == TRIALS and process.returncode == 0:
            assert content(out) == known, f"run {runs} differs after {killed}"
            assert not list(out.rglob("*.part"))
            runs, before = runs + 1, 0
    assert min(killed.values()) >= KILLS // 8, killed
    assert f'File "{Path(betterbench.__file__).parent}' not in said.read_text(encoding="utf-8", errors="replace")
    until = time.monotonic() + 10.0
    while (left := left_over(mark)) and time.monotonic() < until:
        time.sleep(0.1)
    assert not left
