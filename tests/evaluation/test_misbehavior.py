"""Policies that misbehave in their process, alone and together: each costs at most its own trial."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import shutil
import signal
import threading
import time
import uuid
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from tests.evaluation import misbehaviors
from tests.evaluation.conftest import content, tiny
from tests.evaluation.few_steps import in_few_steps, shortened, worker_of_few_steps
from tests.evaluation.misbehaviors import DO, MOMENTS, WHEN

import betterbench
from betterbench import evaluation
from betterbench.cli.main import main
from betterbench.errors import BetterError
from betterbench.evaluation import check_record
from betterbench.evaluation.running import replay
from betterbench.evaluation.workers import pool
from betterbench.interface import episode_number
from betterbench.records import RunFolder
from betterbench.tasks import TrialId
from betterbench.tasks.trial import Trial

pytestmark = [pytest.mark.physics, pytest.mark.slow]

TRIALS = 3
STEPS = 8
"""Control steps of a trial; the policy misbehaves in the fourth."""
PARTS = 8
TOGETHER = 20
"""Cases of two or three misbehaviors at once."""

PATIENCE_S = (3, 30)
"""Deadlines of an answer [s]: a policy may be late on a busy machine, so what goes wrong is tried with the second."""

LONGEST_S = 600.0
"""Longest time of a run [s] on a busy machine; its policy may load for 30 s, or 300 s."""

SOURCE = str(Path(betterbench.__file__).parent)


@dataclass(frozen=True)
class Case:
    what: tuple[str, ...]
    moment: str
    workers: int

    def __str__(self):
        return f"{'+'.join(self.what)} at {self.moment} with {self.workers}"


def drawn(seed):
    """Returns every misbehavior alone, at a moment drawn for it, and some in pairs and triples."""
    draw = np.random.default_rng(seed)

    def pick(values):
        return values[int(draw.integers(len(values)))]

    cases = [Case((name,), pick(WHEN[name]), 1 + int(draw.random() < 0.15)) for name in DO]
    for _ in range(TOGETHER):
        moment = pick(MOMENTS)
        able = [name for name in DO if moment in WHEN[name] and not name.startswith(("hangs", "closes_slowly"))]
        what = draw.choice(able, int(draw.integers(2, 4)), replace=False)
        cases.append(Case(tuple(what.tolist()), moment, 1 + int(draw.random() < 0.15)))
    return cases


CASES = drawn(15)


def own_state():
    """Returns what nobody but this process may change about it."""
    return {
        "folder": str(Path.cwd()),
        "environment": dict(os.environ),
        "umask": (mask := os.umask(0o22), os.umask(mask))[0],
        "limits": [resource.getrlimit(kind) for kind in (resource.RLIMIT_NOFILE, resource.RLIMIT_AS)],
        "priority": os.nice(0),
        "handlers": [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)],
        "blocking": [os.get_blocking(n) for n in (1, 2)],
        "numbers": np.geterr(),
    }


def left_over(mark):
    """Returns the processes that began with a mark in their environment and still run, workers' own trackers aside."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            state = (place / "stat").read_text().rpartition(")")[2].split()[0]
            line = (place / "cmdline").read_bytes()
            ours = mark.encode() in (place / "environ").read_bytes() and int(place.name) != os.getpid()
            if ours and state != "Z" and b"resource_tracker" not in line:
                found.append((int(place.name), line[:100]))
    return found


class Stage:
    """A folder in which one policy is evaluated again and again, each time with other orders."""

    def __init__(self, folder):
        self.folder, self.number, self.known = folder, 0, {}

    @property
    def address(self):
        return f"python:{self.folder / 'policy' / 'a_policy.py'}:Misbehaving"

    def run(self, case=None, workers=1, patience_s=PATIENCE_S[-1]):
        """Returns the exit status, the folder of the run and how long it took [s]."""
        self.number += 1
        out = self.folder / f"run-{self.number}"
        place = self.folder / "policy"
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        shutil.copy(misbehaviors.__file__, place / "a_policy.py")
        if case is not None:
            orders = {"what": case.what, "moment": case.moment, "episode": episode_number(1), "run": str(out)}
            (place / "orders.json").write_text(json.dumps(orders))
        began = time.monotonic()
        words = ["eval", "--policy", self.address, "--out", str(out), "--uncertified", "--workers", str(workers)]
        status = main([*words, "--policy-timeout", str(patience_s)])
        return status, out, time.monotonic() - began


resolve_shortly = in_few_steps(STEPS)
work_shortly = worker_of_few_steps(STEPS)


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    """The stage, and the records of a run in which the policy behaves well."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluation, "make_plan", lambda policy, **_: tiny(policy, trials=TRIALS))
        patch.setattr(Trial, "resolve", resolve_shortly)
        patch.setattr(pool, "work", work_shortly)
        resolve = replay.resolve_condition
        patch.setattr(replay, "resolve_condition", lambda *names: shortened(resolve(*names), STEPS))
        made = Stage(tmp_path_factory.mktemp("misbehavior"))
        status, out, _ = made.run()
        assert status == 0
        made.known = content(out)
        assert len(made.known) == 2 * TRIALS  # a record and a scene each
        for path in (out / "records").rglob("*.parquet"):
            assert check_record(path).identical
        yield made


def problems_of(case, stage, capfd, patience_s):
    """Yields what is wrong after a run with a misbehaving policy."""
    before, mark = own_state(), uuid.uuid4().hex
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BETTERBENCH_TEST_MARK", mark)
        status, out, took_s = stage.run(case, case.workers, patience_s)
    said = capfd.readouterr()
    if status not in (0, 2):
        yield f"status {status}"
    if took_s > LONGEST_S:
        yield f"took {took_s:.0f} s"
    if f'File "{SOURCE}' in said.err + said.out:
        yield f"a traceback of ours: {said.err[-1500:]}"
    if status == 2 and said.err.count("error:") != 1:
        yield f"no single error: {said.err[-500:]}"
    if any(c in said.err + said.out for c in "\x1b\x9b\u202e"):
        yield "what steers a terminal"
    if own_state() != before:
        yield f"changed here: {own_state()} from {before}"
    until = time.monotonic() + 5.0
    while (left := left_over(mark)) and time.monotonic() < until:
        time.sleep(0.05)
    for process, line in left:
        yield f"left over: {line}"
        os.kill(process, signal.SIGKILL)
    while any(t.name in ("policy", "collector", "policy output") for t in threading.enumerate()):
        if time.monotonic() > until + 5.0:
            yield f"threads are left: {[t.name for t in threading.enumerate()]}"
            break
        time.sleep(0.01)
    yield from problems_of_folder(case, stage, out, status)


def problems_of_folder(case, stage, out, status):
    """Yields what is wrong with the folder of a run."""
    planned = {t.id for t in tiny(trials=TRIALS).trials}
    # Whoever removes the records whenever it is closed leaves none: then the journal says so.
    removes = case.moment == "close" and any("records" in w or "scenes" in w or "all_of" in w for w in case.what)
    at_once = case.moment in ("import", "init") or removes
    if not (out / "run.json").exists():
        if status == 0 or not at_once:
            yield "no run"
        return
    try:
        run = RunFolder.open(out)
        entries = {e.key: e for e in run.entries()}
        if status == 0 or not at_once:
            if set(entries) != planned:
                yield f"the journal has {sorted(map(str, entries))}"
            if status:
                yield f"status {status}"
        records = {p.stem: p for p in (out / "records").rglob("*.parquet")}
        for key, entry in entries.items():
            same = entry.status == "done" and all(
                stage.known[name] == data
                for name, data in content(out).items()
                if name.endswith(f"/{key.seed}.parquet")
            )
            if (entry.status == "done") != (str(key.seed) in records):
                yield f"{key} is {entry.status}, and there are {sorted(records)}"
            elif entry.status == "done":
                run.read_record(key.task, key.condition, key.seed)
                if not same and not check_record(records[str(key.seed)]).identical:
                    yield f"{key} does not replay"
            elif not entry.message:
                yield f"{key} has no message"
            own = at_once or (case.moment != "close" and key.seed == 1)
            if not own and not same:
                yield f"{key} is another one: {entry.status} {entry.message}"
    except BetterError as problem:
        yield f"cannot be read: {problem}"
    if list(out.rglob("*.part")) and "litters_the_folder_of_the_run" not in case.what:
        yield "half-written files"


def test_there_are_more_than_a_hundred_misbehaviors():
    assert len(DO) > 200
    assert {case.moment for case in CASES} == set(MOMENTS)
    assert TrialId("morning_coffee", "T1", 1) in {t.id for t in tiny(trials=TRIALS).trials}


@pytest.mark.parametrize("part", range(PARTS))
def test_whatever_a_policy_does_costs_at_most_its_own_trial(part, stage, capfd):
    wrong = []
    for case in CASES[part::PARTS]:
        for patience_s in PATIENCE_S:
            found = [f"{case}: {problem}" for problem in problems_of(case, stage, capfd, patience_s)]
            if not found:
                break
        wrong += found
    assert not wrong, "\n".join(wrong)
