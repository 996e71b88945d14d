"""``kill -9`` in the middle of a motion: no command follows, and the next start marks the attempt and moves nothing."""

import itertools
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.real.plan import RealPolicy, make_plan, write_plan
from betterbench.real.record import read_run
from betterbench.real.robots.mock import MockRobot
from betterbench.real.session import RealSession, Stage

pytestmark = [pytest.mark.render, pytest.mark.physics]
SCRIPTED = f"python:{Path(__file__).parent / 'scripted.py'}:Reach?amount=14.0"
CHILD = """
import sys
from pathlib import Path
from betterbench.real.record import read_run
from betterbench.real.robots.mock import MockRobot
from betterbench.real.session import Command, RealSession

folder, log = Path(sys.argv[1]), Path(sys.argv[2])
robot = MockRobot(read_run(folder).plan, cameras=("front",), size=(160, 120), log=log)
with RealSession(folder, robot, person="ada", apart=False, size=(160, 120)) as session:
    session.begin()
    session.obey(Command("arm"))
    session.obey(Command("force"))
"""


def test_a_killed_program_leaves_a_still_arm_and_a_marked_attempt(tmp_path):
    folder, log = tmp_path / "bench", tmp_path / "commands.txt"
    plan = make_plan((RealPolicy("a", SCRIPTED),), conditions=["O1"], time_limit_s=60.0)
    write_plan(folder, plan)
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(folder), str(log)])
    end = time.monotonic() + 120.0
    while not (log.exists() and log.read_text().count("\n") > 10):
        assert child.poll() is None
        assert time.monotonic() < end
        time.sleep(0.05)
    child.kill()
    assert child.wait() == -signal.SIGKILL
    sent = log.read_bytes()
    time.sleep(0.5)
    assert log.read_bytes() == sent

    commands = np.loadtxt([line for line in sent.decode().splitlines(keepends=True) if line.endswith("\n")])
    assert np.isfinite(commands).all()
    assert np.abs(np.diff(commands[:, :5], axis=0)).max() <= np.degrees(1.5) / 20.0 + 1e-5

    code = plan.trials[0].code
    assert read_run(folder).states[code].state == "running"
    robot = MockRobot(plan, cameras=("front",), size=(160, 120))
    with RealSession(folder, robot, person="ada", apart=False, size=(160, 120)) as session:
        session.begin()
        assert (session.view.stage, session.view.code, session.view.armed) == (Stage.SETUP, code, False)
        assert f"The program ended during {code}" in session.view.message
    assert robot.commands == []
    (event,) = read_run(folder).aborted
    assert event.reason == "the program ended before the trial did"


WRITER = """
import os, signal, sys
from pathlib import Path
from betterbench.jobs import durable
from betterbench.real.record import RealJournal, write_attempt
from tests.real.protocols import header_of, packs

folder, at, when = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
done, finish = [0], durable.DurableFile.finish

def die():
    os.kill(os.getpid(), signal.SIGKILL)

def killed(self):
    done[0] += 1
    if done[0] == at and when == "before":
        self.file.flush()
        die()
    finish(self)
    if done[0] == at:
        die()

with RealJournal(folder) as journal:
    code = journal.next_trial.code
    place = journal.begin(code)
    samples = packs()
    durable.DurableFile.finish = killed
    write_attempt(place, header_of(code, 1, len(samples), instruction="x"), samples, {"front": b"film" * 100000})
    journal.end(code, "time_limit")
"""


@pytest.mark.parametrize(("at", "when"), others_slow(itertools.product([1, 2, 3], ["before", "after"]), 6))
def test_a_kill_while_samples_film_or_header_are_written_loses_that_attempt_alone(tmp_path, at, when):
    from tests.real.protocols import header_of, packs

    from betterbench.real.record import RealJournal, enter, write_attempt

    plan = make_plan((RealPolicy("a", "noop"), RealPolicy("b", "random")), conditions=["O1"])
    write_plan(tmp_path, plan)
    samples, (first, second) = packs(), [t.code for t in plan.trials]
    with RealJournal(tmp_path) as journal:
        place = journal.begin(first)
        write_attempt(place, header_of(first, 1, len(samples), instruction="x"), samples, {"front": b"a film"})
        journal.end(first, "time_limit")
    enter(tmp_path, first, 1, author="olga", role="operator", outcome="done")
    root = Path(__file__).parents[2]
    child = subprocess.run([sys.executable, "-c", WRITER, str(tmp_path), str(at), when], cwd=root, check=False)
    assert child.returncode == -signal.SIGKILL
    run = read_run(tmp_path)
    assert [t.code for t in run.trials] == [first]
    assert run.states[second].state == "running"
    with RealJournal(tmp_path) as journal:
        assert journal.settle() == [second]
        place = journal.begin(second)
        write_attempt(place, header_of(second, 2, len(samples), instruction="x"), samples, {"front": b"again"})
        journal.end(second, "time_limit")
    run = read_run(tmp_path)
    assert [(t.code, t.header.attempt, len(t.samples())) for t in run.trials] == [
        (first, 1, len(samples)),
        (second, 2, len(samples)),
    ]
    assert run.trial(second).film("front").read_bytes() == b"again"
    assert len(run.trial(first).seen_by("operator")) == 1
    assert (tmp_path / "aborted" / f"{second}-1").is_dir()
