"""Termination of child processes that are still running after their parent process has ended.

The child processes are recognized by an environment variable that they have inherited.
"""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterator
from pathlib import Path

_ROUNDS = 5


def end_leftovers(variable: str, value: str, session: int) -> None:
    """End all processes of a session, and all processes with the given value of the environment variable ``variable``.

    A child process may leave the process group and the session of its parent, but it keeps the environment. On a system
    without ``/proc``, this function does nothing.
    """
    mark = f"{variable}={value}".encode()
    for _ in range(_ROUNDS):  # several rounds, because the processes may start further processes
        found = list(_marked(mark, session))
        if not found:
            return
        for process in found:
            with contextlib.suppress(OSError):
                os.kill(process, signal.SIGKILL)


def _marked(mark: bytes, session: int) -> Iterator[int]:
    """Yield the running processes that have the given variable in their environment or belong to the session."""
    for place in Path("/proc").glob("[0-9]*"):
        process = int(place.name)
        if process == os.getpid():
            continue
        with contextlib.suppress(OSError, ValueError):
            state, _, _, leader, *_ = (place / "stat").read_bytes().rpartition(b")")[2].split()
            if state in b"ZX":
                continue
            if int(leader) == session or mark in (place / "environ").read_bytes().split(b"\0"):
                yield process
