"""What needs the distribution betterbench-calibration names the line that installs it where it is missing."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

import betterbench
from betterbench import installation
from betterbench.cli.main import main
from betterbench.errors import MissingDependencyError
from betterbench.installation import calibration_command, calibration_module

NAME = "betterbench_calibration"
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def missing(monkeypatch):
    """Betterbench as from its wheel alone."""
    for module in [name for name in sys.modules if name.partition(".")[0] == NAME]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, NAME, None)


@pytest.mark.parametrize(
    "words",
    [
        ["audit-paper"],
        ["audit-paper", "--help"],
        ["mixture"],
        ["calibrate", "--family", "sixth", "--out", "OUT"],
        ["eval", "--policy", "independent:word-place-calm", "--tasks", "fast_food", "--trials", "1", "--out", "OUT"],
    ],
    ids=lambda words: words[0],
)
def test_without_it_a_command_names_the_line_that_installs_it(missing, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    told = capsys.readouterr().err
    assert "betterbench-calibration" in told or "independent family" in told
    assert f"Run: {calibration_command()}" in told.replace("\n", " ")
    assert not (tmp_path / "OUT").exists()


def test_without_it_help_and_lists_are_whole(missing, capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "audit-paper" in capsys.readouterr().out
    assert main(["list", "policies"]) == 0
    assert "independent:" in capsys.readouterr().out


def test_in_a_clone_the_line_is_make_setup(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "prefix", str(ROOT / ".venv"))
    monkeypatch.chdir(ROOT)
    assert calibration_command() == "make setup"
    monkeypatch.chdir(tmp_path)
    assert calibration_command() == f"make -C {ROOT} setup"


def test_beside_a_wheel_the_other_wheel_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(installation, "clone_folder", lambda: None)
    wheel = tmp_path / "betterbench-0.1.0-py3-none-any.whl"
    monkeypatch.setattr(installation, "_wheel", lambda: wheel)
    assert calibration_command().endswith(f"betterbench-calibration=={betterbench.__version__}")
    other = tmp_path / f"{NAME}-0.1.0-py3-none-any.whl"
    other.touch()
    assert calibration_command().endswith(f" {other}")


def test_an_error_inside_the_distribution_is_not_taken_for_its_absence(monkeypatch, tmp_path):
    package = tmp_path / NAME
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "broken.py").write_text("import no_such_module_at_all\n")
    for module in [name for name in sys.modules if name.partition(".")[0] == NAME]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="no_such_module_at_all"):
        calibration_module("broken", "x")
    with pytest.raises(MissingDependencyError):
        calibration_module("not_there", "x")
    for module in [name for name in sys.modules if name.partition(".")[0] == NAME]:
        del sys.modules[module]  # the next test imports the real one


def test_nothing_in_the_wheel_imports_it():
    texts = {path: path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py")}
    naming = {path: ast.parse(text) for path, text in texts.items() if NAME in text}
    assert naming, "it is found by its name"
    for path, tree in naming.items():
        for node in ast.walk(tree):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.partition(".")[0] == NAME for name in names), path
