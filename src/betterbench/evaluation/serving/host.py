"""Policy host: a process that serves a policy to all workers of a run with openpi's protocol.

The policy itself runs in a child process of the host, so a crash of the policy affects only the current trials.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import Self

from betterbench.errors import BetterError, PolicyError
from betterbench.evaluation.serving.server import open_server
from betterbench.evaluation.trials.shared_policy import POLICY_TIMEOUT_S, Deadline
from betterbench.interface import PolicyInfo
from betterbench.interface.actions import CONTROL_RATE_HZ
from betterbench.jobs.worker_process import SpawnedProcess, interrupts_blocked, prepare_process
from betterbench.policies.clients.connection import LONGEST_WAIT_S
from betterbench.policies.factory import PolicyFactory

logger = logging.getLogger(__name__)

MAX_RESTARTS = 5
"""Maximum number of times that a host is restarted after it has died."""

HUNG = 75
"""Exit status of a host whose policy hangs (``EX_TEMPFAIL`` in sysexits.h)."""

_POLL_S = 0.2
_CLOSE_S = 5.0
_EXIT_DELAY_S = 1.0
_GRACE_S = 30.0

PATIENCE_S = 1800.0
"""Maximum time that a worker waits for a host to restart and load its weights [s]."""


class Host:
    """Policy host in a separate process. As a context manager, it starts and ends the process.

    Attributes:
        takes_batches: Whether one policy instance serves all environments.
    """

    def __init__(
        self,
        policy: str,
        *,
        run: tuple[str, str],
        timeout_s: float = POLICY_TIMEOUT_S,
        world: str = "",
        rate_hz: float = CONTROL_RATE_HZ,
    ) -> None:
        """Store the settings.

        Args:
            policy: Address of the policy.
            run: Action space and observation preset of the run, with which the policy's conventions are compared.
            timeout_s: Maximum time for one answer of the policy [s].
            world: Benchmark whose conventions apply, such as "libero", or empty.
            rate_hz: Control rate of the run [Hz].
        """
        self._policy, self._run, self._timeout_s, self._restarts = policy, (*run, world, rate_hz), timeout_s, 0
        self._port = 0
        self.takes_batches = False
        self._running: SpawnedProcess | None = None  # the process ends when its pipe is closed
        self._info: PolicyInfo | None = None

    def __enter__(self) -> Self:
        """Start the process and wait until it has loaded the policy."""
        try:
            self._start()
            self._info, self.takes_batches, self._port = self._greeting()
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    @property
    def info(self) -> PolicyInfo:
        """Description of the policy."""
        if self._info is None:
            raise AssertionError("unreachable: the host has been started")
        return self._info

    @property
    def address(self) -> str:
        """Policy address for the workers. The server sends them the execution settings for action chunks."""
        return run_address(f"openpi://127.0.0.1:{self._port}", timeout_s=self._timeout_s, patience_s=PATIENCE_S)

    def watch(self) -> None:
        """Restart the process with the same port if it has died. Raises PolicyError if it has died too many times."""
        if self._running is None or self._running.process.is_alive():
            return
        status = self._running.process.exitcode
        hung = status == HUNG
        self._restarts += not hung
        if self._restarts > MAX_RESTARTS:
            raise PolicyError(
                f"{self._policy}: the process of the policy died {self._restarts} times (status {status}). Run "
                "the same command again with --workers 1 to see why."
            )
        how = "hangs" if hung else f"died (status {status})"
        logger.warning("the process of %s %s and is restarted", self._policy, how)
        self._end()
        self._start()

    def _start(self) -> None:
        with interrupts_blocked():  # an interrupt here would leave a process running
            self._running = SpawnedProcess(
                serve, self._policy, self._run, self._timeout_s, self._port, name="betterbench-policy"
            )

    def _greeting(self) -> tuple[PolicyInfo, bool, int]:
        """Wait until the process has loaded the policy.

        Return the description of the policy, whether the policy accepts batches, and the port.
        """
        if self._running is None:
            raise AssertionError("unreachable: the host has been started")
        process, pipe = self._running.process, self._running.connection
        # Polling the pipe is not enough, because a child of a dead process may keep the pipe open.
        while not pipe.poll(_POLL_S) and process.is_alive():
            pass
        message: tuple[PolicyInfo, bool, int] | BetterError | None = None
        with contextlib.suppress(EOFError, OSError):
            message = pipe.recv() if pipe.poll(0.0) else None
        if isinstance(message, tuple):
            return message
        raise message or PolicyError(
            f"{self._policy}: its process ended while loading; see its output above. Run the same command with "
            "--workers 1 to load the policy in this process."
        )

    def _end(self) -> None:
        """Ask the process to close its policy and exit. If it does not exit, kill it."""
        running, self._running = self._running, None
        if running is not None:
            running.end(_CLOSE_S)


def run_address(address: str, *, timeout_s: float, patience_s: float) -> str:
    """Return the policy address that the workers use for a policy that the run itself serves.

    A reply may take at most ``timeout_s`` [s]. Workers wait up to ``patience_s`` [s] for a server that restarts.
    """
    # The server enforces the deadline. The client's deadline is longer, and matters only if the server fails. The first
    # reply may also take the time for loading the weights.
    limit = min(timeout_s + _GRACE_S, LONGEST_WAIT_S)
    warmup = min(limit + patience_s, LONGEST_WAIT_S)
    return f"{address}?preset=native&timeout={limit!r}&warmup={warmup!r}&patience={patience_s!r}"


def serve(policy: str, run: tuple[str, str, str, float], timeout_s: float, port: int, pipe: Connection) -> None:
    """Main function of a host process: serve a policy until the other end of ``pipe`` is closed.

    ``run`` contains the action space, the observation preset, the benchmark whose conventions apply (such as "libero",
    or empty), and the control rate [Hz]. With port 0, any free port is used. After loading the policy, the process
    sends the policy's description and the port to ``pipe``. If loading fails, it sends the error instead.
    """
    prepare_process()
    space, observation, world, rate_hz = run
    with _errors_sent(pipe), PolicyFactory(policy, apart=True, timeout_s=timeout_s, world=world) as policies:
        info, batches = policies.check(space, observation, rate_hz=rate_hz), policies.takes_batches
        deadline = Deadline(timeout_s, exit_hung)
        server = open_server(policy, port=port, made=policies.take(), deadline=deadline)
        with contextlib.suppress(OSError):
            pipe.send((info, batches, server.port))
        with server, contextlib.suppress(EOFError, OSError):
            pipe.recv()


def exit_hung() -> None:
    """End this process after a short delay for replies to the clients.

    A policy call that hangs cannot be ended in any other way.
    """
    threading.Timer(_EXIT_DELAY_S, os._exit, (HUNG,)).start()


@contextlib.contextmanager
def _errors_sent(pipe: Connection) -> Iterator[None]:
    try:
        yield
    except BetterError as problem:
        with contextlib.suppress(OSError):
            pipe.send(problem)
