"""The environment of a world is made once, however many ask for it at the same time."""

import os
import signal
import subprocess
import sys
import time

import pytest

from betterbench.errors import MissingDependencyError
from betterbench.sim.worlds import world_named

UV = """#!{python}
import os, sys, time
from pathlib import Path
folder = Path({folder!r})
with (folder / "steps").open("a") as steps:
    steps.write(f"{{sys.argv[1]}}\\n")
if sys.argv[1] == "venv":
    Path(sys.argv[-1]).mkdir(parents=True)
while not (folder / "go on").exists():
    time.sleep(0.02)
if (folder / "fails").exists():
    sys.exit("no matching distribution")
"""

INSTALL = """
from betterbench.sim.worlds.installation import Installation
print(Installation('calvin', 'world-calvin.lock', '', '', '').install(waits=lambda: print('waits')))
"""
"""Installs the simulator of CALVIN; importing the worlds would take four times as long."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a stand-in of uv, which waits for a file named "go on"."""
    uv = tmp_path / "bin" / "uv"
    uv.parent.mkdir()
    uv.write_text(UV.format(python=sys.executable, folder=str(tmp_path)))
    uv.chmod(0o755)
    monkeypatch.setenv("PATH", f"{uv.parent}:{os.environ['PATH']}")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path


def _started():
    return subprocess.Popen([sys.executable, "-uc", INSTALL], stdout=subprocess.PIPE, text=True)


def _steps(folder):
    file = folder / "steps"
    return file.read_text().split() if file.exists() else []


def _until(condition):
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_of_two_installations_at_once_the_second_waits_and_finds_it_made(folder):
    first = _started()
    _until(lambda: _steps(folder))
    second = _started()
    assert second.stdout.readline() == "waits\n"
    (folder / "go on").touch()
    where = f"{world_named('calvin').installation.folder}\n"
    assert first.communicate()[0] == where
    assert second.communicate()[0] == where
    assert _steps(folder) == ["venv", "pip"]


def test_a_step_that_outlives_its_installation_is_waited_for(folder):
    first = _started()
    _until(lambda: _steps(folder))
    first.send_signal(signal.SIGKILL)
    first.communicate()
    second = _started()
    assert second.stdout.readline() == "waits\n"
    assert _steps(folder) == ["venv"]
    (folder / "go on").touch()
    assert second.communicate()[0] == f"{world_named('calvin').installation.folder}\n"
    assert _steps(folder) == ["venv", "venv", "pip"]


def test_an_installation_that_fails_is_no_environment(folder):
    (folder / "go on").touch()
    (folder / "fails").touch()
    with pytest.raises(MissingDependencyError, match="uv reported: no matching distribution"):
        world_named("calvin").installation.install()
    assert not world_named("calvin").installation.is_installed
    (folder / "fails").unlink()
    assert (world_named("calvin").installation.install() / "complete").exists()
