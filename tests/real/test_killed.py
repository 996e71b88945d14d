"""``kill -9`` in the middle of a motion: no command follows, and the next start marks the attempt and moves nothing."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

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
