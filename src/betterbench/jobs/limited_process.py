"""Child processes with memory and time limits, for reading untrusted files.

A malicious file can make C++ readers of meshes, images and binary models crash, hang or exhaust the memory. Such
readers therefore run in a limited process, which replies with bytes or text and never with pickled objects.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import resource
import select
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from betterbench.errors import BetterError, InvalidInputError, MissingDependencyError, one_line

LONGEST_REASON = 2000
"""Maximum number of characters in the message of a rejection."""

_ANSWER, _REFUSED, _WRONG_INPUT, _MISSING = range(4)
_QUESTION = struct.Struct("!QQ")
_HEADER = struct.Struct("!BQ")
_SLICE_S = 10.0
"""Maximum duration of a single wait [s]. Longer waits are divided into several (see :class:`_Patience`)."""
_ENDS_WITHIN_S = 5.0
"""Maximum time that a process may take to exit after it has closed its pipe [s]."""
_BLOCK = 1 << 16
_PIPE_BYTES = 1 << 20
"""Size of the pipe for replies [byte]. It is the largest size that Linux allows unprivileged users."""


class LimitedProcessError(BetterError):
    """A limited process did not reply. The message gives the reason, such as "it took more than 60 s"."""


class ProcessEndedError(LimitedProcessError):
    """The process ended unexpectedly: it crashed, exceeded a limit or was killed."""


class ProcessLateError(LimitedProcessError):
    """The process did not reply in time."""


class RefusedError(LimitedProcessError):
    """The process rejected the request. The message gives the reason."""


class LimitedProcess:
    """Child process that answers requests in order, within memory and time limits. It communicates over pipes."""

    def __init__(
        self, main: str, *arguments: object, cpu_s: float, environment: Mapping[str, str] | None = None
    ) -> None:
        """Start a process.

        Args:
            main: Function that the process calls ("module:function"), with the arguments as strings. The function must
                end with a call of :func:`answer_requests`.
            arguments: Arguments of the function.
            cpu_s: CPU time limit of a request [s]. This class only mentions the limit in messages;
                :func:`answer_requests` enforces it.
            environment: Additional environment variables of the child process.
        """
        module, _, function = main.partition(":")
        paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path)
        self._cpu_s, self._told_to_end, self._is_closed = cpu_s, False, False
        self._process = subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-c", _MAIN.format(module=module, function=function), *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=tempfile.gettempdir(),  # a folder into which libraries may write logs
            env={**os.environ, "PYTHONPATH": paths, **(environment or {})},
        )
        os.set_blocking(_opened(self._process.stdin).fileno(), False)
        with contextlib.suppress(OSError):  # the size may exceed the pipe limit of the user
            fcntl.fcntl(_opened(self._process.stdout), fcntl.F_SETPIPE_SZ, _PIPE_BYTES)

    @property
    def pid(self) -> int:
        """Process id (PID)."""
        return self._process.pid

    @property
    def returncode(self) -> int | None:
        """Exit status of the process, or None while it runs."""
        return self._process.returncode

    @property
    def is_closed(self) -> bool:
        """Whether the process has ended or has been asked to end."""
        return self._is_closed or self._told_to_end or self._process.poll() is not None

    def stop(self) -> None:
        """End the process. This method may be called from another thread.

        If a thread is waiting for the process, LimitedProcessError is raised in that thread.
        """
        self._told_to_end = True
        self._process.kill()

    def close(self) -> None:
        """End the process and close its pipes."""
        self._is_closed = True
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()

    def send(self, request: Mapping[str, object], data: bytes, *, within_s: float) -> None:
        """Send a request and its data within a time limit [s]. Raises the same errors as :meth:`receive`."""
        text = json.dumps(request).encode()
        left, patience = memoryview(_QUESTION.pack(len(text), len(data)) + text + data), _Patience(within_s)
        try:
            pipe = _opened(self._process.stdin)
            while left:
                self._wait(patience, within_s, to_write=True)
                left = left[os.write(pipe.fileno(), left[:_BLOCK]) :]
        except (OSError, EOFError):
            raise self._ended() from None

    def receive(self, *, most: int, within_s: float) -> bytes | bytearray:
        """Wait up to ``within_s`` seconds for the reply, and return it. The reply may have at most ``most`` bytes.

        Raises:
            LimitedProcessError: If the process has ended, is late, rejects the request or sends too much. The process
                is then closed, unless it only rejected the request.
            InvalidInputError: If this error was raised in the process.
            MissingDependencyError: If this error was raised in the process.
        """
        patience = _Patience(within_s)
        try:
            kind, size = _HEADER.unpack(self._read(_HEADER.size, patience, within_s))
            if size > most:
                self.close()
                raise LimitedProcessError("its answer is too long")
            answer = self._read(size, patience, within_s)
        except (OSError, EOFError):
            raise self._ended() from None
        if kind == _ANSWER:
            return answer
        raise _error_of(kind, bytes(answer))

    def _wait(self, patience: _Patience, within_s: float, *, to_write: bool) -> None:
        """Wait until the pipe can be written or read.

        If this takes too long, close the process and raise ProcessLateError.
        """
        pipe = _opened(self._process.stdin if to_write else self._process.stdout)
        if not patience.lasts_until_ready(pipe, to_write=to_write):
            self.close()
            raise ProcessLateError(f"it did not answer within {within_s:g} s")

    def _read(self, count: int, patience: _Patience, within_s: float) -> bytearray:
        pipe, answer = _opened(self._process.stdout), bytearray(count)
        left = memoryview(answer)
        while left:
            self._wait(patience, within_s, to_write=False)
            got = os.readv(pipe.fileno(), [left])
            if not got:
                raise EOFError
            left = left[got:]
        return answer

    def _ended(self) -> LimitedProcessError:
        """Return the error to raise after the process has ended."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_ENDS_WITHIN_S)
        said = _end_in_words(self._process.returncode, self._cpu_s)
        self.close()
        return LimitedProcessError(said) if self._told_to_end else ProcessEndedError(said)


_MAIN = "import sys; from {module} import {function}; {function}(*sys.argv[1:])"


@dataclass(slots=True)
class _Patience:
    """Remaining time to wait for a process [s].

    The clock keeps running while both processes are suspended by Ctrl-Z. The wait is therefore divided into slices, and
    each slice reduces the remaining time by at most its nominal duration.
    """

    left_s: float

    def lasts_until_ready(self, pipe: BinaryIO, *, to_write: bool) -> bool:
        """Wait until a pipe is ready. Return False if no time is left."""
        pipes: list[BinaryIO] = [pipe]
        while True:
            slice_s, began = min(_SLICE_S, max(0.0, self.left_s)), time.monotonic()
            ready = select.select([] if to_write else pipes, pipes if to_write else [], [], slice_s)
            self.left_s -= min(slice_s, time.monotonic() - began)
            if ready[0] or ready[1]:
                return True
            if self.left_s <= 0.0:
                return False


def _error_of(kind: int, said: bytes) -> BetterError:
    text = said.decode("utf-8", "replace")
    if kind == _WRONG_INPUT:
        with contextlib.suppress(ValueError, TypeError):
            where, problem, cure = (one_line(part, most=LONGEST_REASON) for part in json.loads(text))
            return InvalidInputError(where, problem, cure)
    reason = one_line(text, most=LONGEST_REASON)
    return MissingDependencyError(reason) if kind == _MISSING else RefusedError(reason)


def _end_in_words(status: int | None, cpu_s: float) -> str:
    """Describe the exit status of a process. A negative status is the number of the signal that ended the process."""
    if status is None or status >= 0:
        return f"its process ended (exit status {status})"
    if -status == signal.SIGPROF:
        return f"its process took more than {cpu_s:g} s of CPU time"
    if -status == signal.SIGKILL:
        return "its process was killed, perhaps because memory ran out"
    return f"its process crashed ({signal.Signals(-status).name})"


def _opened(pipe: object) -> BinaryIO:
    if pipe is None:
        raise EOFError
    return pipe  # type: ignore[return-value]


# ----------------------------------------------------------------------------------------------- child process


def answer_requests(
    answers: Callable[[Mapping[str, Any], bytes], Iterator[bytes]],
    *,
    memory_bytes: int,
    cpu_s: float,
    unexpected: Callable[[Exception], str],
) -> None:
    """Main loop of the child process: read requests from standard input and write replies to standard output.

    Args:
        answers: Function that yields the replies to a request and its data.
        memory_bytes: Maximum size of this process's address space [byte].
        cpu_s: Maximum CPU time of each request [s].
        unexpected: Function that returns the reason to send for an error that is not a BetterError.
    """
    written = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not get between the replies
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGPROF, signal.SIG_DFL)  # do not depend on the handler of the parent
    asked = sys.stdin.buffer

    def send(kind: int, parts: Sequence[bytes]) -> None:
        written.write(_HEADER.pack(kind, sum(map(len, parts))))
        for part in parts:
            written.write(part)
        written.flush()

    while header := asked.read(_QUESTION.size):
        text, data = (asked.read(size) for size in _QUESTION.unpack(header))
        try:
            _limit_time(cpu_s)
            for answer in answers(json.loads(text), data):
                send(_ANSWER, [answer])
                _limit_time(cpu_s)
        except InvalidInputError as problem:
            parts = (
                one_line(part, most=LONGEST_REASON // 4) for part in (problem.where, problem.problem, problem.cure)
            )
            send(_WRONG_INPUT, [json.dumps([*parts]).encode()])
        except MissingDependencyError as problem:
            send(_MISSING, [str(problem).encode()[:LONGEST_REASON]])
        except BetterError as problem:
            send(_REFUSED, [str(problem).encode()[:LONGEST_REASON]])
        except Exception as problem:  # noqa: BLE001 - any error is reported to the parent
            send(_REFUSED, [unexpected(problem).encode("utf-8", "replace")[:LONGEST_REASON]])


def _limit_time(cpu_s: float) -> None:
    """Set the CPU time limit of the next request. When it is reached, the signal SIGPROF ends this process.

    RLIMIT_CPU is not used for two reasons. It limits the total CPU time of the process instead of the time of a single
    request. Also, the kernel counts CPU time for it in ticks, which in a rendering process gives up to 6 % more than
    :func:`time.process_time`, for example one minute too much after 15 minutes.
    """
    signal.setitimer(signal.ITIMER_PROF, cpu_s)
