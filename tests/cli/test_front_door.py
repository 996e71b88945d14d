"""The front door is light: help and lists import neither a simulator nor anything else that takes long."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from betterbench.cli.main import VERBS

HEAVY = {
    *(
        "av",
        "gymnasium",
        "jinja2",
        "lerobot",
        "manifold3d",
        "matplotlib",
        "mink",
        "msgpack",
        "mujoco",
        "PIL",
        "pyarrow",
    ),
    *("ray", "scipy", "torch", "trimesh", "vla_eval", "websockets", "zmq"),
    *(f"betterbench.{name}" for name in ("calibration", "certification", "comparison", "diagnosis", "episodes")),
    *(f"betterbench.policies.{name}" for name in ("clients", "conventions", "process", "protocols", "serving")),
    *(f"betterbench.{name}" for name in ("records", "report", "sim.robots", "sim.scenes")),
    *("betterbench_calibration.audit", "betterbench_calibration.independent"),
}
SIMULATORS = {
    "mujoco",
    "mink",
    "gymnasium",
    "scipy",
    "matplotlib",
    "av",
    "betterbench.sim.robots",
    "betterbench.sim.scenes",
}

RUN = """
import sys
{statement}
sys.stderr.write("modules: " + " ".join(sys.modules))
"""
VERB = """
from betterbench.cli.main import main
try:
    status = main({arguments!r})
except SystemExit as stop:
    status = stop.code or 0
assert status == 0
"""


def modules_after(statement):
    command = [sys.executable, "-c", RUN.format(statement=statement)]
    environment = {key: value for key, value in os.environ.items() if key != "BETTERBENCH_TASK_FILES"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout, set(done.stderr.rpartition("modules: ")[2].split())


HELP = [["--help"], *([verb, "--help"] for verb in VERBS)]


@pytest.mark.parametrize("arguments", HELP, ids=lambda a: a[0])
def test_help_imports_nothing_heavy(arguments):
    out, modules = modules_after(VERB.format(arguments=arguments))
    assert "usage: better" in out
    assert not modules & (HEAVY | {"numpy", "betterbench.sim.assets", "betterbench.evaluation", "betterbench.tasks"})


@pytest.mark.parametrize("what", ["tasks", "variations", "policies", "assets", "templates"])
def test_lists_import_nothing_heavy(what):
    out, modules = modules_after(VERB.format(arguments=["list", what, "--json"]))
    assert json.loads(out)
    assert not modules & HEAVY


@pytest.mark.parametrize(
    "package", ["betterbench", "betterbench.tasks", "betterbench.tasks.interventions", "betterbench.records"]
)
def test_packages_that_read_import_no_simulator(package):
    _, modules = modules_after(f"import {package}")
    assert not modules & SIMULATORS


def test_the_overview_names_every_verb_on_one_line_of_80_columns():
    command = [sys.executable, "-m", "betterbench.cli", "--help"]
    done = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, "COLUMNS": "80", "PYTHONUTF8": "1"}, check=True
    )
    for name, verb in VERBS.items():
        (line,) = [line for line in done.stdout.splitlines() if f"• {name} " in line]
        assert verb.summary in line
