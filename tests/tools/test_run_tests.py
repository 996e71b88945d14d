"""Failed tests run a second time on request, and nothing else hides a failure."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"
PASSES_AT_THE_SECOND_RUN = """
from pathlib import Path

def test_sound():
    with Path("calls").open("a") as file:
        file.write("sound\\n")

def test_late():
    seen = Path("seen").exists()
    Path("seen").touch()
    assert seen
"""


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(TOOLS)
    return importlib.import_module("run_tests")


def test_only_the_failed_test_runs_a_second_time(tool, tmp_path, monkeypatch):
    (tmp_path / "test_it.py").write_text(PASSES_AT_THE_SECOND_RUN, encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    assert tool.run_tests(["-q", "--again"]) == 0
    assert (tmp_path / "calls").read_text(encoding="utf-8") == "sound\n"


@pytest.mark.parametrize(
    ("arguments", "statuses", "status"),
    [
        (["--again"], [0], 0),
        ([], [1], 1),
        (["--again"], [1, 1], 1),
        # An interruption, an internal error, a wrong option, and a second run that finds no failed test.
        (["--again"], [2], 2),
        (["--again"], [3], 3),
        (["--again"], [4], 4),
        (["--again"], [1, 5], 5),
    ],
)
def test_only_failed_tests_lead_to_a_second_run(tool, monkeypatch, arguments, statuses, status):
    left = list(statuses)
    monkeypatch.setattr(tool, "_pytest", lambda _: left.pop(0))
    assert tool.run_tests(arguments) == status
    assert not left
