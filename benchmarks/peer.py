"""The peer that speed is compared with: an installation of robosuite of its own, and a process to ask."""

from __future__ import annotations

import json
import os
import selectors
import shutil
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import platformdirs

REQUIREMENTS = ("robosuite==1.5.2", "mujoco==3.3.7")
"""robosuite's last release and the last MuJoCo of the series it names; it does not run with MuJoCo 3.10 and later."""

INSTALL_LIMIT_S = 900.0
ANSWER_LIMIT_S = 180.0
"""Longest wait for one answer [s]; building an environment with cameras takes 2 to 8 s here."""

_COMPLETE = "complete"


class PeerUnavailableError(Exception):
    """The peer cannot be installed or does not answer; the text says why."""


def installed_peer() -> Path:
    """Return the Python of the peer's environment, which is built on first use in the user's cache directory.

    Raises:
        PeerUnavailableError: If it cannot be built.
    """
    name = "-".join(r.replace("==", "-") for r in REQUIREMENTS)
    folder = platformdirs.user_cache_path("betterbench") / "peers" / name
    python = folder / "bin" / "python"
    if (folder / _COMPLETE).exists():
        return python
    print(f"Building the peer's environment ({', '.join(REQUIREMENTS)}) in {folder}", file=sys.stderr)
    shutil.rmtree(folder, ignore_errors=True)
    uv = shutil.which("uv") or shutil.which("uv", path=str(Path(sys.executable).parent))
    if uv is not None:
        _run([uv, "venv", "--quiet", "--python", sys.executable, str(folder)])
        _run([uv, "pip", "install", "--quiet", "--python", str(python), *REQUIREMENTS])
    else:
        _run([sys.executable, "-m", "venv", str(folder)])
        _run([str(python), "-m", "pip", "install", "--quiet", *REQUIREMENTS])
    (folder / _COMPLETE).touch()
    return python


def _run(command: list[str]) -> None:
    """Run a command.

    Raises:
        PeerUnavailableError: If it fails, with the last line it said.
    """
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_LIMIT_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise PeerUnavailableError(f"{Path(command[0]).name}: {error}") from error
    if done.returncode != 0:
        said = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()
        raise PeerUnavailableError(f"{Path(command[0]).name} {command[1]} failed: {said[-1][:160]}")


class Peer:
    """A running process that steps robosuite on request. Use it as a context manager.

    Raises:
        PeerUnavailableError: If it cannot be installed or started.
    """

    def __init__(self) -> None:
        self.versions: dict[str, str] = {}
        script = Path(__file__).with_name("robosuite_peer.py")
        # Its own libraries only, and the same GL back end and number of threads as this process.
        environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
        self._process = subprocess.Popen(
            [str(installed_peer()), str(script)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            text=True,
        )

    def __enter__(self) -> Self:
        """Return the peer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the process."""
        self._process.terminate()
        self._process.communicate()

    def make(self, *, everything: bool) -> None:
        """Build the environment, with depth and instance masks if everything is asked for.

        Raises:
            PeerUnavailableError: If that fails.
        """
        answer = self._ask({"do": "make", "all": everything})
        self.versions = {k: str(v) for k, v in answer.items() if k != "seconds"}

    def step(self, count: int, *, everything: bool) -> float:
        """Take control steps and return the seconds they took together."""
        return float(self._ask({"do": "step", "all": everything, "count": count})["seconds"])

    def reset(self, *, everything: bool) -> float:
        """Reset to a new layout and return the seconds it took."""
        return float(self._ask({"do": "reset", "all": everything})["seconds"])

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        process = self._process
        if process.stdin is None or process.stdout is None:
            raise AssertionError("the process was started with pipes")
        try:
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
        except BrokenPipeError:
            raise PeerUnavailableError(f"its process has ended with status {process.wait()}") from None
        with selectors.DefaultSelector() as selector:
            selector.register(process.stdout, selectors.EVENT_READ)
            if not selector.select(ANSWER_LIMIT_S):
                raise PeerUnavailableError(f"no answer to {request['do']!r} within {ANSWER_LIMIT_S:g} s")
        line = process.stdout.readline()
        if not line:
            raise PeerUnavailableError(f"its process has ended with status {process.wait()} on {request['do']!r}")
        answer: dict[str, Any] = json.loads(line)
        return answer
