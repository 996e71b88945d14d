"""``better real`` on the command line: a plan, its state, a run by lines of a terminal, and refusals."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from betterbench.cli.main import main
from betterbench.real.plan import RealPolicy, make_plan, write_plan
from betterbench.real.record import read_run

SCRIPTED = f"python:{Path(__file__).parent / 'scripted.py'}:Reach"


def plan(folder, *options):
    arguments = ["real", "plan", "--out", str(folder), "--policies", f"a={SCRIPTED}", "b=noop", *options]
    return main(arguments)


def test_a_plan_is_written_and_its_state_shown(tmp_path, capsys):
    assert plan(tmp_path, "--conditions", "O1", "T1", "--trials", "2") == 0
    assert "with 8 trials (2 conditions x 2 policies x 2)" in capsys.readouterr().err
    assert main(["real", "status", str(tmp_path), "--json"]) == 0
    state = json.loads(capsys.readouterr().out)
    assert (state["planned"], state["done"], state["open"], state["trials"]) == (8, 0, 8, [])
    assert state["next"] == read_run(tmp_path).plan.trials[0].code
    assert main(["real", "status", str(tmp_path)]) == 0
    assert "0 of 8 trials are done; next:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["plan", "--out", "x", "--policies", "openpi"], "--policies: expected NAME=ADDRESS, got 'openpi'"),
        (["plan", "--out", "x", "--policies", "a=zoom:lexical"], "Unknown policy kind 'zoom'"),
        (["plan", "--out", "x", "--policies", "a=openpi://h:99999"], "is not a host with a port from 1 to 65535"),
        (["plan", "--out", "x", "--policies", "a=openpi://h:1?fps=1"], "Unknown option of openpi 'fps'"),
        (["plan", "--out", "x", "--policies", "a=zoo:nope"], "Unknown policy 'zoo:nope'"),
        (["plan", "--out", "x", "--policies", "a=noop", "A=random"], "differ only in case, spaces or Unicode forms"),
        (["plan", "--out", "x", "--policies", "a=noop", "--conditions", "O77"], "O77"),
        (["plan", "--out", "x", "--policies", "a=noop", "--trials", "0"], "--trials: 0 is out of range"),
        (["status", "nowhere"], "plan.json: not found"),
        (["run", "nowhere"], "plan.json: not found"),
        (["dance"], "Unknown command of better real 'dance'"),
    ],
)
def test_bad_arguments_are_one_clear_line(arguments, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["real", *arguments]) == 2
    assert says in capsys.readouterr().err
    assert not Path("x/plan.json").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ([], "--arm-port: the serial port of the arm is missing"),
        (["--arm-port", "/dev/none", "--cameras", "top=0"], "--cameras: no camera is named front"),
        (
            ["--arm-port", "/dev/none", "--cameras", "front"],
            "--cameras: expected NAME=VALUE with each name given once, got 'front'",
        ),
        (["--arm-port", "/dev/none"], "lerobot[feetech]"),
        (["--mock-faults", "latency_s=1"], "--mock-faults: they apply only to the mock arm"),
        (["--robot", "mock", "--mock-faults", "stalled=knee"], "'knee' is not a motor"),
        (["--robot", "mock", "--mock-faults", "speed=3"], "speed"),
        (["--robot", "mock", "--limits", "limits.json"], "speed_rad_s: expected a positive number, got -1.0"),
        (["--robot", "mock", "--camera-size", "320", "0"], "--camera-size: 0 is out of range"),
        (["--robot", "mock", "--author", " "], "--author: ' ' is not a valid name"),
        (["--robot", "mock", "--author", "Ben "], "'Ben ' is not a valid name. Use a name of 1 to 80 printable"),
    ],
)
def test_a_run_with_bad_options_moves_nothing(options, says, tmp_path, monkeypatch, capsys):
    if "lerobot" in says and "lerobot" in sys.modules:
        pytest.skip("lerobot is installed")
    monkeypatch.chdir(tmp_path)
    Path("limits.json").write_text('{"speed_rad_s": -1.0}')
    assert plan(tmp_path, "--conditions", "O1") == 0
    assert main(["real", "run", str(tmp_path), *options]) == 2
    assert says in capsys.readouterr().err
    assert not any((tmp_path / "trials").glob("*"))


def test_a_policy_that_reads_the_simulator_is_refused(tmp_path, capsys):
    assert main(["real", "plan", "--out", str(tmp_path), "--policies", "a=expert", "--conditions", "O1"]) == 2
    assert "policy a: expert reads the state of the simulator" in capsys.readouterr().err
    assert not (tmp_path / "plan.json").exists()
    write_plan(tmp_path, make_plan((RealPolicy("a", "expert"),), conditions=["O1"]))
    assert main(["real", "run", str(tmp_path), "--robot", "mock", "--no-page"]) == 2
    assert "policy a: expert reads the state of the simulator" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.physics
def test_a_run_by_lines_of_the_terminal(tmp_path):
    options = ["--conditions", "O1", "--time-limit-s", "1"]
    assert main(["real", "plan", "--out", str(tmp_path), "--policies", f"a={SCRIPTED}", *options]) == 0
    command = [sys.executable, "-m", "betterbench.cli", "real", "run", str(tmp_path), "--robot", "mock", "--no-page"]
    command += ["--camera-size", "160", "120", "--author", "ada"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:

        def until(words):
            for line in process.stderr:
                if words in line:
                    return
            raise AssertionError(words)

        def type_lines(*lines):
            process.stdin.write("".join(f"{line}\n" for line in lines))
            process.stdin.flush()

        type_lines("a", "s")
        until("has ended. Enter the outcome")
        type_lines("9 it waved")
        until("every trial is done")
    assert process.returncode == 0
    (trial,) = read_run(tmp_path).trials
    assert trial.header.robot == "mock"
    (entry,) = trial.entries
    assert (entry.author, entry.decision.outcome, entry.decision.note) == ("ada", "other", "it waved")
