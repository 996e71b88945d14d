"""A run that another process still writes to is diagnosed and reported; what it has not reached is no failure."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

import betterbench
from betterbench.cli.main import main
from betterbench.diagnosis import Label, diagnose_run
from betterbench.errors import RunConflictError
from betterbench.jobs import lock as lock_module
from betterbench.jobs.lock import RunLock, is_locked
from betterbench.records import RunFolder

pytestmark = pytest.mark.physics

WAITS = """
import pathlib, time
import numpy as np
from betterbench.interface import PolicyInfo, episode_number

GO = pathlib.Path(__file__).with_name("go")

class Policy:
    '''Stands still in the trials of seed 0 and 1, and waits in the others until a file appears.'''
    info = PolicyInfo("waits", needs_images=False)
    def reset(self, start):
        self.seed = next(seed for seed in range(100) if episode_number(seed) == start.episode)
    def act(self, observation):
        while self.seed > 1 and not GO.exists():
            time.sleep(0.02)
        return np.array([0.0] * 6 + [-1.0])
"""

SCRIPT = """
import dataclasses, sys
from pathlib import Path
from tests.evaluation.few_steps import in_few_steps
from betterbench.evaluation import evaluate, make_plan
from betterbench.tasks.trial import Trial

Trial.resolve = in_few_steps(40)

if __name__ == "__main__":
    plan = make_plan(
        sys.argv[2], tasks=["morning_coffee"], variations=["T1"], trials=4, observation="state_only", quality="fast"
    )
    plan = dataclasses.replace(plan, trials=tuple(t for t in plan.trials if t.variation == "T1"))
    evaluate(plan, Path(sys.argv[1]))
"""


@contextlib.contextmanager
def running(folder: Path):
    """Runs four trials in another process, of which the last two do not end before the file ``go`` appears."""
    (folder / "waits.py").write_text(textwrap.dedent(WAITS), encoding="utf-8")
    script = folder / "run_waiting.py"
    script.write_text(textwrap.dedent(SCRIPT), encoding="utf-8")
    out = folder / "run"
    sources = (Path(betterbench.__file__).parents[1], Path(__file__).parents[2])
    process = subprocess.Popen(
        [sys.executable, str(script), str(out), f"python:{folder / 'waits.py'}:Policy"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, sources))},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        deadline = time.monotonic() + 60.0
        while not out.exists() or len(RunFolder.open(out).entries() if (out / "run.json").exists() else ()) < 2:
            assert process.poll() is None, "the run ended early"
            assert time.monotonic() < deadline, "the run makes no progress"
            time.sleep(0.02)
        yield RunFolder.open(out), process
    finally:
        (folder / "go").touch()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=60)
        process.kill()
        process.wait(timeout=10)


def test_a_run_is_diagnosed_and_reported_while_another_process_writes_it(tmp_path, capsys):
    with running(tmp_path) as (run, process):
        assert run.is_running
        found = diagnose_run(run)
        assert [t.seed for t in found.trials] == [0, 1]
        assert found.pending == ("morning_coffee/T1/2", "morning_coffee/T1/3")
        assert found.planned == 4
        assert {t.label for t in found.trials} == {Label.CORRECT_FREEZE}
        rate = found.metric("success_rate", "overall")
        assert (rate.k, rate.n) == (2, 2), "what was not run is in no number"
        assert "in progress. 2 of 4 planned trials are done" in found.notes[0]
        assert [t.label for t in diagnose_run(run, whole=True).trials][2:] == [Label.UNFINISHED] * 2

        assert main(["diagnose", str(run.path), "--json"]) == 0
        shown = capsys.readouterr()
        assert json.loads(shown.out)["pending"] == list(found.pending)
        assert "2 of 4 trials are done" in shown.err.replace("\n", " ")
        assert not (run.path / "diagnosis.json").exists(), "half a diagnosis is not kept"

        assert main(["report", str(run.path), "--out", str(tmp_path / "page"), "--films", "0"]) == 0
        page = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
        assert (
            "Unfinished: 2 of 4 trials were done when this page was written. The 2 not yet run are not counted" in page
        )
        assert "<li>morning_coffee/T1: 2</li>" in page
        assert "<title>Unfinished: " in page
        assert process.poll() is None, "it was really running all the time"

    assert process.returncode == 0, "looking at it did no harm"
    assert not run.is_running
    whole = diagnose_run(run)
    assert (len(whole.trials), whole.pending) == (4, ())
    assert main(["report", str(run.path), "--out", str(tmp_path / "page"), "--films", "0"]) == 0
    assert "Unfinished" not in (tmp_path / "page" / "index.html").read_text(encoding="utf-8")


def test_a_lock_is_seen_by_others_as_long_as_it_is_held(tmp_path):
    lock = tmp_path / ".lock"
    assert not is_locked(lock)
    with RunLock(lock):
        assert is_locked(lock)
        assert is_locked(lock), "asking does not release it"
        with pytest.raises(RunConflictError, match="another run"):
            RunLock(lock)
    assert not is_locked(lock)


def test_a_run_that_starts_while_somebody_asks_waits_for_the_answer(tmp_path, monkeypatch):
    lock = tmp_path / ".lock"
    lock.touch()
    asking = os.open(lock, os.O_RDONLY)
    fcntl.flock(asking, fcntl.LOCK_SH)
    waited: list[float] = []

    def wait(seconds):
        waited.append(seconds)
        if len(waited) == 2:
            os.close(asking)

    monkeypatch.setattr(lock_module.time, "sleep", wait)
    with RunLock(lock):
        assert len(waited) == 2
