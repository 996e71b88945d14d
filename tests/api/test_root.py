"""The root package: cheap to import, with its public names typed and imported when they are first used."""

from __future__ import annotations

import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import betterbench

LONGEST_IMPORT_S = 0.05


def run(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def test_importing_it_takes_no_time_and_imports_no_library():
    code = "import sys, time; a = time.process_time(); import betterbench; print(time.process_time() - a, *sys.modules)"
    took, *modules = min((run(code).split() for _ in range(3)), key=lambda words: float(words[0]))
    assert float(took) < LONGEST_IMPORT_S
    assert not {"numpy", "pydantic", "mujoco", "gymnasium"} & set(modules)
    assert {m for m in modules if m.startswith("betterbench")} == {
        "betterbench",
        "betterbench.lazy_names",
        "betterbench.version",
    }


def test_there_are_about_fifteen_names_and_each_is_there():
    assert 12 <= len(betterbench.__all__) <= 18
    assert all(getattr(betterbench, name).__doc__ for name in betterbench.__all__)
    assert set(betterbench.__all__) <= set(dir(betterbench))


LAZY = re.compile(r"^ +\"[\w.]+\": \(([^)]*)\)", re.MULTILINE)


def test_no_lazy_name_is_hidden_by_a_module_of_its_package():
    """The import of a submodule sets an attribute of its package, which is then found before the lazy name."""
    checked = 0
    for file in Path(betterbench.__path__[0]).rglob("__init__.py"):
        text = file.read_text(encoding="utf-8")
        if "lazy_names(" in text:
            modules = {path.stem for path in file.parent.iterdir() if not path.name.startswith("__")}
            names = {name for listed in LAZY.findall(text) for name in re.findall(r"\"(\w+)\"", listed)}
            names |= set(re.findall(r"\"(\w+)\"", text.partition("__all__")[2].partition("]")[0]))
            assert not names & modules, file
            checked += len(names)
    assert checked > 100


def test_the_type_of_a_policy_imports_no_simulator():
    modules = run("import sys; from betterbench import EpisodeStart, Observation, PolicyInfo; print(*sys.modules)")
    assert not {"mujoco", "gymnasium", "scipy"} & set(modules.split())


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'betterbench' has no attribute 'evaluat'"):
        betterbench.evaluat  # noqa: B018


@pytest.mark.slow
def test_a_type_checker_sees_the_names(tmp_path):
    (tmp_path / "program.py").write_text(
        textwrap.dedent(
            """
            import betterbench

            run = betterbench.evaluate("expert", trials=1)
            reveal_type(run)
            reveal_type(betterbench.diagnose(run))
            reveal_type(betterbench.compare(run, run))
            betterbench.evaluate("expert", trails=1)
            betterbench.evaluat("expert")
            """
        )
    )
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), "program.py"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    for text in (
        'Revealed type is "betterbench.records.run.RunFolder"',
        'Revealed type is "betterbench.diagnosis.verdict.RunDiagnosis"',
        'Revealed type is "betterbench.comparison.compare.Comparison"',
        'Unexpected keyword argument "trails" for "evaluate"',
        'has no attribute "evaluat"',
    ):
        assert text in done.stdout, done.stdout
    assert "Found 2 errors" in done.stdout
