"""Forwarding of a policy process's output to standard error, up to a limit and without control characters."""

from __future__ import annotations

import contextlib
import math
import os
import select
import sys
import threading
import time

from betterbench.errors import printable

MAX_SHOWN_BYTES = 1 << 20
"""Maximum amount of output that is shown per process [byte]."""

_LONGEST_LINE = 2000
_PIECE = 1 << 16
_DRAIN_S = 0.5


class ProcessOutput:
    """Pipe that replaces the standard output and the standard error of a process.

    The child process does not inherit the standard error of this process. If standard error were redirected to a file,
    the child process could truncate the file or change its flags.

    Attributes:
        theirs: The child process's end of the pipe, as a file descriptor.
    """

    def __init__(self) -> None:
        self._ours, self.theirs = os.pipe()
        self._left, self._line = MAX_SHOWN_BYTES, b""
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._pass_on, name="policy output", daemon=True)

    def begin(self) -> None:
        """Start forwarding the output. Call this after the process has been started."""
        os.close(self.theirs)
        self._thread.start()

    def end(self) -> None:
        """Forward the remaining output and close the pipe, even if other processes still have it open."""
        self._ending.set()
        self._thread.join(_DRAIN_S + 1.0)

    def _pass_on(self) -> None:
        try:
            waiting = select.poll()
            waiting.register(self._ours, select.POLLIN)
            until = math.inf
            while time.monotonic() < until:
                if self._ending.is_set():
                    until = min(until, time.monotonic() + _DRAIN_S)
                if waiting.poll(1000.0 * _DRAIN_S / 5):
                    piece = os.read(self._ours, _PIECE)
                    if not piece:
                        break
                    self._take(piece)
                elif until < math.inf:
                    break
        finally:
            os.close(self._ours)
            self._show(self._line)

    def _take(self, piece: bytes) -> None:
        """Forward the complete lines.

        If a line was overwritten repeatedly, like a progress bar, only its last state is forwarded.
        """
        *lines, self._line = (self._line + piece).split(b"\n")
        self._line = self._line[-2 * _LONGEST_LINE :]
        for line in lines:
            self._show(line)

    def _show(self, line: bytes) -> None:
        text = line.rstrip(b"\r").rpartition(b"\r")[2].decode("utf-8", "replace")
        if not text or self._left <= 0:
            return
        self._left -= len(line) + 1
        shown = printable(text, most=_LONGEST_LINE)
        if self._left <= 0:
            shown += "\nFurther output of the policy is not shown."
        with contextlib.suppress(OSError, ValueError, AttributeError):  # standard error may be closed
            sys.stderr.write(f"{shown}\n")
            sys.stderr.flush()
