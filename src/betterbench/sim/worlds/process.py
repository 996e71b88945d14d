"""Simulator processes that run the trials of a worker. If a simulator process fails, only its current trial is lost."""

from __future__ import annotations

import contextlib
import math
import os
import re
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from typing import IO, Any, Self

import numpy as np

from betterbench.errors import BetterError, last_line, one_line
from betterbench.installation import package_command
from betterbench.jobs.asked_process import AskedProcess
from betterbench.jobs.frames import FrameContent, FrameError
from betterbench.sim.worlds.environment import simulator_environment

START_LIMIT_S = 300.0
"""Maximum time until a process has loaded, built its environment and executed the settling steps [s].

LIBERO takes 10 s, or a minute under load.
"""

PREMISES_LIMIT_S = 1800.0
"""Maximum time until all initial states of a task have settled [s]. LIBERO's 50 states take half a minute."""

STEP_LIMIT_S = 120.0
"""Maximum time for one control step [s]. LIBERO takes 0.15 to 0.5 s without a graphics card."""

_END_S = 5.0
_LONGEST_TEXT = 10_000
"""Maximum number of characters in a name, an instruction or a version that a simulator sends."""
_SAID_BYTES = 4000
"""Number of bytes at the end of a simulator's output that are searched for its last line."""
_MISSING = re.compile(r"No module named '?([\w.]+)")


class WorldError(BetterError):
    """Error of a simulator process: it has ended, does not answer in time, or gives an invalid answer.

    The trial that the process was running is broken and will be repeated.
    """


@contextlib.contextmanager
def as_agreed(what: str) -> Iterator[None]:
    """Convert errors from reading a simulator's answer into a WorldError.

    ``what`` is used in the message to say what the simulator did, for example "sent a state".
    """
    try:
        yield
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as problem:
        found = one_line(f"{type(problem).__name__}: {problem}", most=200)
        raise WorldError(f"the simulator {what} that cannot be read ({found})") from problem


def sent_text(value: object) -> str:
    """Check that a simulator has sent a string, and return it.

    Raises TypeError for other types and ValueError if the string is too long.
    """
    if not isinstance(value, str):
        raise TypeError(f"expected a string, got a {type(value).__name__}")
    if len(value) > _LONGEST_TEXT:
        raise ValueError(f"a string of {len(value)} characters is too long")
    return value


def sent_texts(value: Mapping[str, object]) -> dict[str, str]:
    """Check that a simulator has sent a mapping of strings, such as its versions, and return the mapping."""
    return {sent_text(name): sent_text(found) for name, found in value.items()}


class WorldProcess(AskedProcess):
    """Simulator process. It ends when its socket is closed, or when the context manager exits."""

    def __init__(self, command: Sequence[str], *, start_limit_s: float = START_LIMIT_S) -> None:
        """Start the process. Raises WorldError if this fails.

        Raises GraphicsError if ``MUJOCO_EGL_DEVICE_ID`` does not name a device
        (:mod:`betterbench.sim.worlds.environment`).
        """
        self._start_limit_s, self._python = start_limit_s, command[0]
        environment = simulator_environment()
        self._said: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        try:
            super().__init__(lambda link: [*command, str(link)], output=self._said, environment=environment)
        except OSError as error:
            self._said.close()
            raise WorldError(f"the simulator cannot be started: {error}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def suite(self, name: str) -> dict[str, Any]:
        """Return the simulator's description of a suite and its tasks. Raises WorldError if the simulator fails."""
        return self._ask({"do": "suite", "suite": name}, {}, self._start_limit_s)[0]

    def premises(self, request: Mapping[str, Any]) -> FrameContent:
        """Check the premises of a task in all initial states. Raises WorldError if the simulator fails."""
        return self._ask({"do": "premises", **request}, {}, PREMISES_LIMIT_S)

    def start(self, request: Mapping[str, Any]) -> FrameContent:
        """Begin an episode in the requested scene. Raises WorldError if the simulator fails."""
        return self._ask({"do": "start", **request}, {}, self._start_limit_s)

    def step(self, action: np.ndarray, *, look: bool) -> FrameContent:
        """Execute one control step. Raises WorldError if the simulator fails."""
        return self._ask({"do": "step", "look": look}, {"action": action}, STEP_LIMIT_S)

    def draw(self, request: Mapping[str, Any], qpos: np.ndarray) -> np.ndarray:
        """Render n states of a task's scene as images (n, size, size, 3). Raises WorldError if the simulator fails."""
        images = self._ask({"do": "draw", **request}, {"qpos": qpos}, self._start_limit_s)[1].get("images")
        size = int(request["size"])
        if images is None or images.shape != (len(qpos), size, size, 3) or images.dtype != np.uint8:
            raise WorldError("the simulator did not send the requested images, or sent them with a different shape")
        return images

    def close(self, within_s: float = _END_S) -> None:
        """End the process, and kill it if it has not ended within the time limit [s].

        Does nothing if it has already ended.
        """
        self.hang_up()
        self.end(within_s)
        self._said.close()

    def _ask(self, request: Mapping[str, Any], arrays: Mapping[str, np.ndarray], limit_s: float) -> FrameContent:
        try:
            document, answer = self.ask(request, arrays, limit_s=limit_s)
        except FrameError as error:
            raise WorldError(
                self._with_cure(f"the simulator did not answer {request['do']!r}: {error}{self._last_words()}")
            ) from None
        if "problem" in document:
            raise WorldError(self._with_cure(f"the simulator failed: {one_line(document['problem'], most=400)}"))
        return document, answer

    def _with_cure(self, message: str) -> str:
        """Append installation advice to an error message if a module is missing in the simulator's environment."""
        missing = _MISSING.search(message)
        if missing is None:
            return message
        name = missing[1].partition(".")[0]
        return (
            f"{message}. The simulator's environment does not contain the module {name}. If its lock file does not "
            f"list it either, install its package (`{package_command(name, python=str(self._python))}`)"
        )

    def _last_words(self) -> str:
        """Return the process's exit status and the last line of its output as text, or "" if the process still runs."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            status = self._process.wait(0.5)
            self._said.seek(max(0, self._said.seek(0, os.SEEK_END) - _SAID_BYTES))
            said = last_line(self._said.read(_SAID_BYTES).decode(errors="backslashreplace"))
            return f"; its process ended with status {status}{f' and printed {said}' if said else ''}"
        return ""


class WorldProcesses:
    """Simulator processes of one worker, one per running trial.

    A process is reused for the next trial of the same task, if possible. A process with the key None runs only one
    trial and ends. The next process is started early, so that it has finished loading when the next trial begins.
    """

    def __init__(self, command: Sequence[str], *, trials: int = 0) -> None:
        """Store the settings. Processes are started when they are needed.

        Args:
            command: Command that starts a process.
            trials: Maximum number of trials to run, or 0 if it is not known. No process is started early for a trial
                beyond this number.
        """
        self._command = tuple(command)
        self._trials = trials or math.inf
        self._taken = 0
        self._idle: list[tuple[object, WorldProcess]] = []
        self._next: WorldProcess | None = None

    def take(self, key: object) -> WorldProcess:
        """Return an idle process, preferably one that has run a trial with the same ``key``, or else a new process.

        Raises:
            WorldError: If a process cannot be started.
        """
        if key is None:
            return self._take_fresh()
        if not self._idle:
            return WorldProcess(self._command)
        best = next((i for i, (known, _) in enumerate(self._idle) if known == key), 0)
        return self._idle.pop(best)[1]

    def give_back(self, key: object, process: WorldProcess) -> None:
        """Keep a process for reuse after a trial without errors. If ``key`` is None, end the process."""
        if key is None:
            process.close(0.0)
        else:
            self._idle.append((key, process))

    def close(self) -> None:
        """End all idle processes."""
        while self._idle:
            self._idle.pop()[1].close()
        self._drop_next()

    def _take_fresh(self) -> WorldProcess:
        """Return a process that has not run a trial yet, and start another process if another trial follows."""
        if self._next is not None and self._next.has_ended:
            self._drop_next()
        process = WorldProcess(self._command) if self._next is None else self._next
        self._next = None
        self._taken += 1
        if self._taken < self._trials:
            with contextlib.suppress(WorldError):  # the next trial tries again, and reports the error if it recurs
                self._next = WorldProcess(self._command)
        return process

    def _drop_next(self) -> None:
        process, self._next = self._next, None
        if process is not None:
            process.close(0.0)
