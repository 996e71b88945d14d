"""The front door is light: help and lists import neither a simulator nor anything else that takes long."""

from __future__ import annotations

import ast
import gc
import json
import os
import subprocess
import sys

import pytest

from betterbench.cli.main import VERBS, every_command, main

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

VERB = """
import io, sys
from contextlib import redirect_stdout
from betterbench.cli.main import main
out = io.StringIO()
with redirect_stdout(out):
    try:
        status = main({arguments!r})
    except SystemExit as stop:
        status = stop.code or 0
assert status == 0
print(repr(out.getvalue()))
"""


def modules_after(*statements):
    """Return what statements print and the modules that are imported after each, all in one process.

    What one of them imports is imported after the later ones too: the first that is refused is the one to look at.
    """
    told = "\nsys.stderr.write('modules: ' + ' '.join(sys.modules) + '\\n')\n"
    code = "import sys\n" + "".join(f"{statement}{told}" for statement in statements)
    environment = {key: value for key, value in os.environ.items() if key != "BETTERBENCH_TASK_FILES"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    found = [set(line.split()) for line in done.stderr.splitlines() if line.startswith("modules: ")]
    assert len(found) == len(statements), done.stderr
    return done.stdout.splitlines(), found


HELP = [["--help"], *([*verb.split(), "--help"] for verb in every_command())]
LISTS = ["suites", "tasks", "variations", "policies", "assets", "templates"]


def test_help_imports_nothing_heavy():
    lines, found = modules_after(*(VERB.format(arguments=arguments) for arguments in HELP))
    for arguments, line, modules in zip(HELP, lines, found, strict=True):
        assert "usage: better" in ast.literal_eval(line), arguments
        heavy = HEAVY | {"numpy", "betterbench.sim.assets", "betterbench.evaluation", "betterbench.tasks"}
        assert not modules & heavy, arguments
    assert "pydantic" not in found[0]


def test_garbage_is_collected_while_a_command_runs(capsys):
    """The process of ``better`` begins without, until everything is imported."""
    gc.disable()
    try:
        assert main(["list", "suites"]) == 0
        assert gc.isenabled()
    finally:
        gc.enable()


PACKAGES = ["betterbench", "betterbench.tasks", "betterbench.tasks.interventions", "betterbench.records"]


def test_lists_and_packages_that_read_import_nothing_heavy():
    """The names of records are imported at first use."""
    lists = [VERB.format(arguments=["list", what, "--json"]) for what in LISTS]
    named = ["from betterbench.records import *" if p == "betterbench.records" else f"import {p}" for p in PACKAGES]
    lines, found = modules_after(*lists, *named)
    for what, line, modules in zip(LISTS, lines, found[: len(LISTS)], strict=True):
        assert json.loads(ast.literal_eval(line)), what
        assert not modules & HEAVY, what
    for package, modules in zip(PACKAGES, found[len(LISTS) :], strict=True):
        assert not modules & SIMULATORS, package
        assert package in modules
    assert "betterbench.records.run" in modules


def test_the_overview_names_every_verb_on_one_line_of_80_columns(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    for name, verb in VERBS.items():
        (line,) = [line for line in lines if f"• {name} " in line]
        assert verb.summary in line
