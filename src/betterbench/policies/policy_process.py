"""A policy that is not ours, in a process of its own: whatever it does to that process costs at most its own trial."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from multiprocessing import Pipe
from typing import Any

import numpy as np

from betterbench import errors
from betterbench.errors import (
    BetterError,
    InvalidInputError,
    PolicyError,
    PolicyKilledError,
    PolicyProcessError,
    UnknownNameError,
)
from betterbench.interface import EpisodeStart, Observation, PolicyInfo
from betterbench.policies.asked_process import ERRORS, array_of

logger = logging.getLogger(__name__)

CLOSE_S = 5.0
"""How long a policy may take to close [s]; then its process is ended."""

MAX_KILLS = 3
"""How often a batch is asked for whose process is killed meanwhile."""

_POLL_S = 0.2
_LEAVE_S = 0.5
_FROM_OUTSIDE = ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")
_START = "import sys; sys.path[:] = {path!r}; from betterbench.policies.asked_process import main; main({arguments})"


class PolicyProcess:
    """A policy in a process of its own, as the run asks it.

    When it is asked after its process has ended, another one is started, with a policy that is made anew. The process
    leads a session, so that no signal to the group of the run reaches it, nor one of its own the run.

    Attributes:
        info: What the policy says about itself.
        source: Name and fingerprint of the file that it was loaded from, or empty.
        takes_batches: Whether it answers several observations at once.
    """

    def __init__(self, address: str, started: _Started | None = None) -> None:
        """Start the process and wait until it has loaded the policy, unless it was started already.

        Raises:
            BetterError: What the policy's loading raised, if it is an error of betterbench.
            PolicyProcessError: If it raised something else, or the process ended.
        """
        self._address = address
        self._asking, self._closing = threading.Lock(), threading.Lock()
        self._closed = False
        self._running: _Started | None = started or _Started(address)
        self.info, self.takes_batches, self.source = self._running.info, self._running.batches, self._running.source

    def reset(self, start: EpisodeStart) -> None:
        """Tell the policy that an episode begins; raises what :meth:`act` raises."""
        self._ask("reset", start)

    def act(self, observation: Observation) -> np.ndarray:
        """Return the policy's answer to an observation.

        Raises:
            PolicyError: If the policy failed, whatever it raised, or its process ended by its own fault.
            PolicyKilledError: If the process was ended from outside.
            PolicyUnavailableError: If the policy raised it, because its server cannot be reached.
            HandshakeError: If the policy raised it, because it has become another one.
        """
        return array_of(self._ask("act", observation))

    def check(self, **conventions: object) -> None:
        """Let a checkpoint compare its conventions with those of the run; others declare nothing to compare."""
        if self._address.startswith("lerobot:"):
            self._ask("check", **conventions)

    def close(self) -> None:
        """Let the policy close, and end its process; at once where the policy is just being asked.

        Whoever comes second does not wait for the first one, nor ends what the policy does to close.
        """
        with self._closing:
            first, self._closed = not self._closed, True
        if not self._asking.acquire(blocking=False):
            running = self._running
            if first and running is not None:
                running.kill()  # whoever is asking sees that it has ended
            return
        try:
            if self._running is not None:
                self._running.close()
                self._running = None
        finally:
            self._asking.release()

    def _ask(self, method: str, *args: object, **options: object) -> Any:  # noqa: ANN401 - what the method returns
        with self._asking:
            if self._closed:
                raise PolicyError("the policy is closed")
            if self._running is None:
                self._running = _Started(self._address)
            try:
                self._running.connection.send((method, args, options))
                message = self._running.receive()
                if message[0] == "ok":
                    return message[1]
                problem = _error(*message[1:])
            except Exception as error:
                status, self._running = self._running.end(), None
                kind = PolicyKilledError if status.startswith(_FROM_OUTSIDE) else PolicyError
                raise kind(f"the process of the policy ended while it was asked ({status})") from error
            raise problem


class BatchPolicyProcess(PolicyProcess):
    """A policy that answers several observations at once, in a process of its own."""

    def act_batch(self, observations: Sequence[Observation]) -> Sequence[np.ndarray]:
        """Return one answer per observation; raises what :meth:`act` raises.

        Each answer depends on its observation alone, so a batch whose process was killed is asked for again.
        """
        for left in reversed(range(MAX_KILLS)):
            try:
                return [array_of(plain) for plain in self._ask("act_batch", list(observations))]
            except PolicyKilledError as error:
                if not left:
                    raise
                logger.warning("%s; the policy is loaded again", error)
        raise AssertionError("the last attempt returns or raises")


def start_policy(address: str) -> PolicyProcess:
    """Return the policy of an address, loaded in a process of its own; raises what :class:`PolicyProcess` raises."""
    started = _Started(address)
    return (BatchPolicyProcess if started.batches else PolicyProcess)(address, started)


class _Started:
    """A process that has loaded its policy."""

    def __init__(self, address: str) -> None:
        self.connection, theirs = Pipe()
        life, self._life = os.pipe()
        arguments = f"{address!r}, {theirs.fileno()}, {life}"
        try:
            self._process = subprocess.Popen(  # noqa: S603 - our own module; the address is a literal in its arguments
                [sys.executable, "-c", _START.format(path=sys.path, arguments=arguments)],
                stdin=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(), life),
                start_new_session=True,
            )
        finally:
            theirs.close()
            os.close(life)
        try:
            message = self.receive()
            _require_loaded(address, message)
            self.info: PolicyInfo = message[1]
            self.batches, self.source = bool(message[2]), str(message[3])
        except (EOFError, OSError) as error:
            raise PolicyProcessError(
                f"{address}: its process ended while loading ({self.end()}); what it wrote stands above. Load it in a "
                "Python shell to see why"
            ) from error
        except BaseException:
            self.kill()
            self.end()
            raise

    def receive(self) -> tuple[Any, ...]:
        """Return what the process has sent; EOFError if it has ended.

        A child of the process may hold its end of the pipe open.
        """
        while not self.connection.poll(_POLL_S):
            if self._process.poll() is not None and not self.connection.poll(0.0):
                raise EOFError
        message: tuple[Any, ...] = self.connection.recv()
        return message

    def kill(self) -> None:
        """End the process and what it has started, at once."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def close(self) -> None:
        """Let the policy close, and end the process."""
        with contextlib.suppress(OSError):
            self.connection.send(None)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(CLOSE_S)
        self.end()

    def end(self) -> str:
        """End the process, if it has not ended by itself, and return how it did."""
        how = "it closed its connection to the run"
        with contextlib.suppress(subprocess.TimeoutExpired):
            how = exit_text(self._process.wait(_LEAVE_S))
        self.kill()
        self._process.wait()
        if self._life >= 0:
            self.connection.close()
            os.close(self._life)
            self._life = -1
        return how


def _error(kind: str, texts: Sequence[str]) -> BetterError:
    """Return the error that a process has told."""
    if kind == "UnknownNameError":
        return UnknownNameError(texts[0], texts[1], texts[2:])
    if kind == "InvalidInputError":
        return InvalidInputError(*texts)
    made = getattr(errors, kind) if kind in ERRORS else PolicyError
    error: BetterError = made(texts[0])
    return error


def _require_loaded(address: str, message: tuple[Any, ...]) -> None:
    """Raise what a process has told instead of that it has loaded its policy; errors of betterbench say enough."""
    if message[0] == "ready":
        return
    problem = _error(*message[1:])
    if type(problem) is not PolicyError:
        raise problem
    raise PolicyProcessError(f"{address}: it cannot be loaded ({problem}). Its traceback stands above.")


def exit_text(status: int | None) -> str:
    """Return how a process ended, from its exit status, which is negative for a signal."""
    if status is None or status >= 0:
        return f"exit status {status}"
    name = signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"
    return f"{name}, as when memory runs out" if name == "SIGKILL" else name
