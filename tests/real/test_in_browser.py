"""A whole protocol as its operator meets it: 18 cells x 2 policies on the mock arm, in a headless Chromium.

On the way, the program is stopped by Ctrl-C and by kill -9, a camera is unplugged and a servo stalls. Nothing that was
complete is lost, and nothing moves afterwards.
"""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "report"))

from chromium import COMMAND, browser

from betterbench.real.plan import RealPolicy, make_plan, write_plan
from betterbench.real.record import read_header, read_run

SCRIPTED = f"python:{Path(__file__).parent / 'scripted.py'}:Reach"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.render,
    pytest.mark.physics,
    pytest.mark.skipif(COMMAND is None, reason="no Chromium is installed"),
]
PATIENCE_S = 180.0


class Program:
    """``better real run`` on a mock arm, and the page that an operator has open."""

    def __init__(self, folder, chromium, *faults):
        command = [sys.executable, "-m", "betterbench.cli", "real", "run", str(folder), "--robot", "mock"]
        command += ["--cameras", "front", "wrist", "--camera-size", "160", "120", "--port", "0", "--author", "ada"]
        command += ["--mock-faults", *faults] if faults else []
        self.process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        found = re.fullmatch(r"open (http://localhost:\d+/[\w-]{32}/)\n", self.process.stdout.readline())
        assert found is not None, self.process.stderr.read()
        self.said = []  # a full pipe would stop the program
        self._listener = threading.Thread(target=lambda: self.said.extend(self.process.stderr), daemon=True)
        self._listener.start()
        self.page = chromium
        self.page.open(found[1], 1280, 900)
        self.wait("state !== null && state.code !== ''")

    def wait(self, expression):
        self.page.wait_until(expression, patience_s=PATIENCE_S)

    def press(self, code, key=None):
        for kind in ("keyDown", "keyUp"):
            self.page.key(kind, code, key or code[-1].lower())

    def value(self, expression):
        return self.page.value(expression)

    def start(self):
        """Switch the arm on and start the trial that is shown, as soon as the scene fits."""
        self.wait("state.stage === 'setup' && state.agreement !== null && state.agreement.accepted")
        code = self.value("state.code")
        self.press("KeyA")
        self.wait("state.armed")
        self.press("KeyS")
        return code

    def run_trial(self, outcome="3"):
        """Run the trial that is shown, enter what happened, and return its code."""
        code = self.start()
        self.wait("state.stage === 'enter'")
        self.press(f"Digit{outcome}", outcome)
        self.wait(f"state.code !== '{code}' || state.stage === 'done'")
        return code

    def end(self, number=signal.SIGKILL):
        if self.process.poll() is None:
            self.process.send_signal(number)
        self.process.wait(timeout=60)
        self._listener.join(timeout=30)
        self.process.stdout.close()
        self.process.stderr.close()
        return self.process.returncode


@pytest.fixture
def folder(tmp_path):
    policies = (RealPolicy("left", f"{SCRIPTED}?amount=14.0"), RealPolicy("right", f"{SCRIPTED}?amount=-14.0"))
    made = tmp_path / "bench"
    write_plan(made, make_plan(policies, time_limit_s=1.5, seed=7))  # a camera may be silent for 1 s
    return made


@pytest.fixture
def open_program(folder, tmp_path, monkeypatch):
    """Return a function that starts the program with faults; all of them show their pages in one browser."""
    monkeypatch.setenv("LP_NUM_THREADS", "0")
    made = []
    with browser(tmp_path / "profile") as chromium:

        def start(*faults):
            made.append(Program(folder, chromium, *faults))
            return made[-1]

        yield start
        for program in made:
            program.end()


def test_a_whole_protocol_survives_whatever_happens(open_program, folder):
    plan = read_run(folder).plan
    assert len(plan.trials) == 36
    done = []

    program = open_program()
    done += [program.run_trial() for _ in range(2)]
    pictures = os.environ.get("BETTERBENCH_TEST_PICTURES")
    if pictures:
        program.wait("state.agreement !== null && document.getElementById('live').complete")
        time.sleep(1.5)
        Path(pictures, "setup.png").write_bytes(program.page.screenshot())

    # kill -9 in the middle of a trial: its attempt is cut off, everything before it stays
    killed = program.start()
    program.wait("state.stage === 'running' && state.elapsed_s > 0.2")
    assert program.end() == -signal.SIGKILL
    assert read_run(folder).states[killed].state == "running"
    assert [t.code for t in read_run(folder).trials] == done

    # Ctrl-C in the middle of a trial
    program = open_program()
    assert read_run(folder).states[killed].state == "open"
    assert program.value("state.code") == killed
    assert "will be repeated" in program.value("state.message")
    assert program.value("state.armed") is False
    assert program.start() == killed
    program.wait("state.stage === 'running' && state.elapsed_s > 0.2")
    assert program.end(signal.SIGINT) == 0
    run = read_run(folder)
    assert [(e.code, e.attempt) for e in run.aborted] == [(killed, 1), (killed, 2)]
    assert "stopped" in run.aborted[-1].reason
    assert (folder / "aborted" / f"{killed}-2" / "samples.parquet").exists()

    # an unplugged camera, and a servo that stalls
    for fault, attempt, says in (
        (("unplugged=front", "after_s=0"), 3, "Camera front has sent no frame"),
        (("stalled=shoulder_pan", "after_s=0"), 4, "shoulder_pan does not follow"),
    ):
        program = open_program(*fault)
        assert program.start() == killed
        program.wait("state.message.includes('will be repeated')")
        assert says in program.value("state.message")
        assert program.value("state.armed") is False
        header = read_header(folder / "aborted" / f"{killed}-{attempt}")
        assert header.ending is None
        assert program.end(signal.SIGTERM) == 0

    # the rest of the protocol
    program = open_program()
    while len(done) < len(plan.trials):
        done.append(program.run_trial("123456"[len(done) % 6]))
        if pictures and len(done) == 5:
            program.start()
            program.wait("state.stage === 'running'")
            Path(pictures, "running.png").write_bytes(program.page.screenshot())
            program.wait("state.stage === 'enter'")
            Path(pictures, "enter.png").write_bytes(program.page.screenshot())
            code = program.value("state.code")
            program.press("Digit1", "1")
            program.wait(f"state.code !== '{code}'")
            done.append(code)
    program.wait("state.stage === 'done'")
    # Addresses of programs that were ended no longer answer; scripts must not have failed.
    assert [each for each in program.page.complaints() if '"source": "network"' not in each] == []
    assert program.process.wait(timeout=60) == 0

    run = read_run(folder)
    assert done == [t.code for t in plan.trials] == [t.code for t in run.trials]
    assert {(t.planned.condition, t.planned.policy) for t in run.trials} == {
        (c, p) for c in plan.conditions for p in ("left", "right")
    }
    for trial in run.trials:
        samples = trial.samples()
        assert len(samples) == round(plan.time_limit_s * plan.rate_hz)
        assert trial.film("front").stat().st_size > 1000
        assert len(trial.seen_by("operator")) == 1
        moved = samples.command[-1, 0] - samples.state[0, 0]
        assert (moved > 1.0) if trial.planned.policy == "left" else (moved < -1.0)
        assert np.abs(np.diff(samples.command[:, 0])).max() <= np.degrees(1.5) / 20.0 + 1e-6
