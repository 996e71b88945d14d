"""Child process that answers requests over a socket: a policy process, or the simulator of another world."""

from __future__ import annotations

import contextlib
import math
import os
import select
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from typing import IO, Any

import numpy as np

from betterbench.jobs.frames import FrameContent, FrameError, receive_frame, send_frame

_POLL_S = 0.2
_PIECE = 1 << 20


class AskedProcess:
    """Child process that answers requests. Requests and replies are sent as frames (:mod:`betterbench.jobs.frames`).

    The process runs in its own session. Signals sent to the run, such as Ctrl-C, therefore do not reach the process,
    and signals sent to the process do not reach the run.
    """

    def __init__(
        self,
        command: Callable[[int], Sequence[str]],
        *,
        output: int | IO[bytes],
        environment: Mapping[str, str],
        keeps: Sequence[int] = (),
        any_type: bool = False,
    ) -> None:
        """Start the process. Raises OSError if this fails.

        Args:
            command: Function that returns the command line, given the file descriptor of the child's socket.
            output: File or file descriptor for the standard output and standard error of the process.
            environment: Environment variables of the process.
            keeps: Other file descriptors that the process inherits.
            any_type: Whether replies may contain arrays of any type, such as strings.
        """
        self._any_type, self._asked, self._until, self._is_over = any_type, 0, math.inf, False
        self._link, theirs = socket.socketpair()
        self._link.settimeout(_POLL_S)
        try:
            self._process = subprocess.Popen(  # noqa: S603 - our own modules, or the command of an installed world
                [*command(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                pass_fds=(theirs.fileno(), *keeps),
                env=environment,
                start_new_session=True,
            )
        except OSError:
            self._link.close()
            raise
        finally:
            theirs.close()

    @property
    def pid(self) -> int:
        """Process id (PID)."""
        return self._process.pid

    @property
    def has_ended(self) -> bool:
        """Whether the process has ended, for any reason."""
        return self._process.poll() is not None

    @property
    def waits(self) -> bool:
        """Whether the process is ready for a request: it is running, and no unread frame from it has arrived."""
        try:
            said = bool(select.select([self._link], [], [], 0.0)[0])
        except (OSError, ValueError):
            return False
        return not said and not self.has_ended

    def ask(
        self, document: Mapping[str, Any], arrays: Mapping[str, np.ndarray], *, limit_s: float = math.inf
    ) -> FrameContent:
        """Send a request and return the reply. Replies to earlier requests are ignored.

        Raises:
            FrameEndError: If the process has ended.
            FrameTimeoutError: If the process does not reply within ``limit_s``.
            FrameError: If the process sends an invalid reply.
        """
        self._asked, self._until = self._asked + 1, time.monotonic() + limit_s
        send_frame(self, document, arrays, number=self._asked)
        return self._answer()

    def greeting(self, *, limit_s: float) -> FrameContent:
        """Return the first frame, which the process sends without a request. Raises the same errors as :meth:`ask`."""
        self._until = time.monotonic() + limit_s
        return self._answer()

    def _answer(self) -> FrameContent:
        while True:
            number, document, arrays = receive_frame(self, any_type=self._any_type)
            if number == self._asked:
                return document, arrays
            if number > self._asked:
                raise FrameError(f"expected frame number {self._asked}, got {number}")

    def sendall(self, data: bytes) -> None:
        """Send all bytes. Raises TimeoutError if they are not received in time and OSError if the process has ended."""
        left = memoryview(data)
        while left:
            self._require_time()
            try:
                left = left[self._link.send(left[:_PIECE]) :]
            except TimeoutError:
                if self.has_ended:
                    raise BrokenPipeError("the process has exited") from None

    def recv(self, size: int) -> bytes:
        """Return the next bytes, or ``b""`` if the process has ended.

        Raises TimeoutError if nothing arrives in time.
        """
        ended = False
        while True:
            self._require_time()
            try:
                return self._link.recv(min(size, _PIECE))
            except TimeoutError:
                if ended:  # a child of the process may keep the socket open
                    return b""
                ended = self.has_ended

    def _require_time(self) -> None:
        if time.monotonic() > self._until:
            raise TimeoutError

    def hang_up(self) -> None:
        """Tell the process that there will be no more requests."""
        with contextlib.suppress(OSError):
            self._link.shutdown(socket.SHUT_WR)

    def kill(self) -> None:
        """Kill the process and its process group. A call of :meth:`ask` that is waiting for a reply raises an error."""
        if self._is_over:
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        with contextlib.suppress(OSError):
            self._link.shutdown(socket.SHUT_RDWR)

    def end(self, within_s: float) -> int | None:
        """Wait until the process ends, and kill it if it takes longer than the time limit [s].

        Return the exit status, or None if the process was killed.
        """
        status = None
        with contextlib.suppress(subprocess.TimeoutExpired):
            status = self._process.wait(within_s)
        self.kill()
        self._process.wait()
        self._link.close()
        self._is_over = True
        return status
