"""A host: the process that keeps the weights of a policy for all workers of a run, behind our own protocol."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import threading
from collections.abc import Iterator
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Self

from betterbench.errors import BetterError, PolicyError
from betterbench.evaluation.agents import Minds
from betterbench.evaluation.crew import deaf_to_interrupts, prepare_process
from betterbench.evaluation.serving import open_server
from betterbench.evaluation.trial import POLICY_TIMEOUT_S
from betterbench.interface import PolicyInfo
from betterbench.policies.link import LONGEST_WAIT_S

logger = logging.getLogger(__name__)

MAX_RESTARTS = 5
"""How often a host that died is started again."""

PATIENCE_S = 1800.0
"""How long a worker waits for a host [s]: one that died has its weights to load again."""


class Host:
    """Serves one policy from a process of its own. A context manager, which starts and ends it.

    Attributes:
        takes_batches: Whether one instance answers all environments.
    """

    def __init__(self, policy: str, *, run: tuple[str, str], timeout_s: float = POLICY_TIMEOUT_S) -> None:
        """Prepare.

        Args:
            policy: Address of the policy.
            run: Action space and observation preset of the run, with which the policy compares its conventions.
            timeout_s: Deadline of one answer [s].
        """
        self._policy, self._run, self._timeout_s, self._restarts = policy, run, timeout_s, 0
        self._port = 0
        self.takes_batches = False
        self._process: BaseProcess | None = None
        self._info: PolicyInfo | None = None

    def __enter__(self) -> Self:
        """Start it, and wait until it has loaded the policy.

        Raises:
            BetterError: If the policy cannot be loaded.
            PolicyError: If the process dies while loading.
        """
        answer = self._start()
        try:
            said = answer.recv()  # ends as well when the process does
        except EOFError:
            said = PolicyError(
                f"{self._policy}: its process ended while loading; what it wrote stands above. "
                "With --workers 1 it is loaded in this process."
            )
        except BaseException:
            self._end()
            raise
        finally:
            answer.close()
        if isinstance(said, BetterError):
            self._end()
            raise said
        self._info, self.takes_batches, self._port = said
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self._end()

    @property
    def info(self) -> PolicyInfo:
        """What the policy says about itself."""
        if self._info is None:
            raise AssertionError("the host was not started")
        return self._info

    @property
    def address(self) -> str:
        """Address at which workers ask the policy; how chunks are played is said by its server."""
        return address_within(f"openpi://127.0.0.1:{self._port}", timeout_s=self._timeout_s, patience_s=PATIENCE_S)

    def watch(self) -> None:
        """Start the process again if it has died; the workers' clients find it at the same port.

        Raises:
            PolicyError: If it died too often.
        """
        process = self._process
        if process is None or process.is_alive():
            return
        self._restarts += 1
        if self._restarts > MAX_RESTARTS:
            raise PolicyError(
                f"{self._policy}: its process died {self._restarts} times (status {process.exitcode}). Run the same "
                "command again with --workers 1 to see why."
            )
        logger.warning("the process of %s died (status %s) and is started again", self._policy, process.exitcode)
        self._start().close()

    def _start(self) -> Connection:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(
            target=serve, args=(self._policy, self._run, self._port, theirs), name="betterbench-policy"
        )
        with deaf_to_interrupts():
            process.start()
        theirs.close()
        self._process = process
        return ours

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.join()
            process.close()


def address_within(address: str, *, timeout_s: float, patience_s: float) -> str:
    """Return the address at which the workers of a run ask a policy that the run itself serves.

    Args:
        address: Address of its server.
        timeout_s: Deadline of one answer [s].
        patience_s: How long a server that died is waited for [s].
    """
    return f"{address}?preset=native&timeout={min(timeout_s, LONGEST_WAIT_S)!r}&patience={patience_s!r}"


def serve(policy: str, run: tuple[str, str], port: int, answer: Connection) -> None:
    """Serve a policy until this process is ended; this is the main function of a host.

    Args:
        policy: Address of the policy.
        run: Action space and observation preset of the run.
        port: Port to listen on; 0 for any free one.
        answer: Where what the policy says about itself and the port are sent, or why there is none.
    """
    prepare_process()
    with _told(answer), Minds(policy) as minds:
        info, batches = minds.check(*run), minds.takes_batches
        server = open_server(policy, port=port, made=minds.take())
        with contextlib.suppress(OSError):
            answer.send((info, batches, server.port))
        with server:
            threading.Event().wait()


@contextlib.contextmanager
def _told(answer: Connection) -> Iterator[None]:
    try:
        yield
    except BetterError as problem:
        with contextlib.suppress(OSError):
            answer.send(problem)
