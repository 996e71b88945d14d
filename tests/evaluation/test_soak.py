"""A soak: 500 trials, 1,000 random faults, and exactly the planned trials in the journal, each once."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time

import numpy as np
import pytest
from tests.evaluation.conftest import FEW_STEPS
from tests.evaluation.few_steps import worker_of_few_steps
from tests.evaluation.misbehaving import BREAKS, FRAMES, Misbehaving

from betterbench.evaluation import evaluate
from betterbench.evaluation.workers import pool
from betterbench.records import RunFolder
from betterbench.tasks import TrialId

pytestmark = [pytest.mark.physics, pytest.mark.slow]

TRIALS = 500
FAULTS = 1000
KILLS = 6
"""Faults that kill a worker; the others come from the server."""
RESTARTS = 6
"""Faults that take the server away for a moment."""

CHANCE = 0.55
"""Chance of a fault per request: high enough that all faults have happened before the trials are over."""

RETRIED = ("drop", "half a frame", "drop", "half a frame", "late")
"""Faults that cost a retry and no trial; most are of this kind, so that trials go on and meet more of them."""


class Trouble:
    """Draws faults until there have been enough of them."""

    def __init__(self, seed: int) -> None:
        self._draw = np.random.default_rng(seed)
        self._fatal = tuple(sorted({*FRAMES, *BREAKS} - set(RETRIED)))
        self.left = FAULTS
        self.restart = threading.Event()
        self.kills = self.restarts = 0

    def __call__(self, _request, _number):
        if not self.left or self._draw.random() > CHANCE:
            return None
        self.left -= 1
        if self.left % (FAULTS // KILLS) == 1:
            self.kills += self._kill()
            return None
        if self.left % (FAULTS // RESTARTS) == 2:
            self.restarts += 1
            self.restart.set()
            return None
        names = self._fatal if self._draw.random() < 0.1 else RETRIED
        return names[int(self._draw.integers(len(names)))]

    def _kill(self) -> int:
        workers = [p.pid for p in multiprocessing.active_children() if p.name == "betterbench-worker"]
        if workers:
            os.kill(workers[int(self._draw.integers(len(workers)))], signal.SIGKILL)
        return bool(workers)


def test_a_thousand_random_faults_lose_no_trial_and_double_none(tiny_plan, tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "work", worker_of_few_steps(FEW_STEPS))
    trouble, over = Trouble(2026), threading.Event()
    with Misbehaving(trouble) as server:

        def restart():
            while not over.is_set():
                if trouble.restart.wait(0.1):
                    trouble.restart.clear()
                    server.restart()

        thread = threading.Thread(target=restart)
        thread.start()
        address = server.address.replace("timeout=0.7", "timeout=0.5").replace("retries=3", "retries=6")
        plan = tiny_plan(address, trials=TRIALS)
        began = time.monotonic()
        try:
            run = evaluate(plan, tmp_path / "run", workers=2, envs=6)
            # Trials whose workers died three times are run again by the same command.
            run = evaluate(plan, tmp_path / "run", workers=2, envs=6)
        finally:
            over.set()
            thread.join()
    assert trouble.left == 0, f"only {FAULTS - trouble.left} faults in {time.monotonic() - began:.0f} s"
    assert trouble.kills >= KILLS - 1
    assert trouble.restarts >= RESTARTS - 1
    planned = {t.id for t in plan.trials}
    assert len(planned) == TRIALS
    done = [e.key for e in RunFolder.open(tmp_path / "run").entries() if e.status == "done"]
    assert len(done) == len(set(done)) == TRIALS
    assert set(done) == planned
    lines = (tmp_path / "run" / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    assert sum('"done"' in line for line in lines) == TRIALS
    records = {TrialId(r.metadata.task, r.metadata.condition, r.metadata.seed): r for r in run.records()}
    assert set(records) == planned
    ends = {r.outcome.termination for r in records.values()}
    assert ends == {"step_limit", "policy_error"}
    assert all(r.outcome.error for r in records.values() if r.outcome.termination == "policy_error")
    assert not list(run.path.rglob("*.part"))
