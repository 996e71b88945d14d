"""Connection to a policy server with deadlines, retries and automatic reconnection, shared by all policy clients."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from betterbench.errors import PolicyError, PolicyUnavailableError
from betterbench.policies.address import PolicyAddress

logger = logging.getLogger(__name__)

FIRST_PAUSE_S = 0.1
"""Pause before the first retry of a failed request or connection [s]. The pause doubles with each further retry."""

LONGEST_WAIT_S = 604_800
"""Largest allowed value of ``timeout_s``, ``warmup_s`` and ``patience_s`` [s]: one week."""

MOST_RETRIES = 1000
"""Largest allowed number of retries."""

LONGEST_PAUSE_S = 5.0
"""Longest pause between two attempts [s]."""


class ServerNotReadyError(ConnectionError):
    """The server, or a proxy in front of it, answers that the request should be repeated later."""


@contextmanager
def errors_of(where: str) -> Iterator[None]:
    """Context manager that begins the message of a PolicyError with the name of the server."""
    try:
        yield
    except PolicyError as error:
        raise PolicyError(f"{where}: {error}") from error


class ClosableConnection(Protocol):
    """Interface of the connections that :class:`PolicyConnection` manages."""

    def close(self) -> None:
        """Close the connection. This never raises an error."""


Connection = TypeVar("Connection", bound=ClosableConnection)
Received = TypeVar("Received")


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Deadlines and retries of a connection to a policy server.

    Attributes:
        timeout_s: Maximum duration of each request except the first [s].
        warmup_s: Maximum duration of the first request, and of the first request after the server was unreachable [s].
            The default is longer than ``timeout_s``, because many servers compile their model during the first request.
            If the first request times out, its retries use ``timeout_s``.
        retries: Number of times that a request is repeated after a broken connection or a timeout.
        patience_s: Time for which the client keeps trying to connect to an unreachable server [s].
        seed: Seed for the random part of each pause. Random pauses prevent all clients from reconnecting to a restarted
            server at the same moment.
    """

    timeout_s: float = 30.0
    warmup_s: float = 300.0
    retries: int = 3
    patience_s: float = 60.0
    seed: int = 0

    @classmethod
    def of(cls, address: PolicyAddress, *, seed: int = 0) -> ConnectionLimits:
        """Read the limits from the options of a policy address.

        Raises InvalidInputError if an option is not a number, is too large, or sets a deadline of 0 s.
        """
        usual = cls()
        limits = cls(
            timeout_s=address.number("timeout", usual.timeout_s),
            # A timeout given in the address also applies to the first request, unless the address sets warmup as well.
            warmup_s=address.number("warmup", address.number("timeout", usual.warmup_s)),
            retries=address.whole("retries", usual.retries),
            patience_s=address.number("patience", usual.patience_s),
            seed=seed,
        )
        if min(limits.timeout_s, limits.warmup_s) <= 0.0:
            raise address.error("the deadline must be greater than 0", "Set it to a number of seconds")
        for name, value, most in (
            ("timeout", limits.timeout_s, LONGEST_WAIT_S),
            ("warmup", limits.warmup_s, LONGEST_WAIT_S),
            ("patience", limits.patience_s, LONGEST_WAIT_S),
            ("retries", limits.retries, MOST_RETRIES),
        ):
            if value > most:
                raise address.error(f"{name}={value:g} is too large", f"Use at most {most}")
        return limits


class PolicyConnection(Generic[Connection]):
    """Connection to one policy server, which is reopened automatically after it breaks.

    Only one thread may send requests at a time. Another thread may call :meth:`close`, which ends any waiting for the
    server.
    """

    def __init__(self, where: str, dial: Callable[[float], Connection], limits: ConnectionLimits) -> None:
        """Store the settings without contacting the server.

        ``dial`` connects to the server and does the handshake within the given time [s]. It raises OSError if another
        attempt may succeed, and a BetterError otherwise.
        """
        self._where, self._dial, self._limits = where, dial, limits
        self._draw = np.random.default_rng(limits.seed)
        self._connection: Connection | None = None
        self._closed = threading.Event()
        self._dialed = 0
        self._warm = False
        self._counts = {"requests": 0, "retries": 0, "reconnects": 0}

    @property
    def figures(self) -> dict[str, float]:
        """Numbers of requests, retries and reconnects since the last call of :meth:`count_anew`."""
        return {f"policy_{name}": float(count) for name, count in self._counts.items()}

    def count_anew(self) -> None:
        """Reset the counts of requests, retries and reconnects at the beginning of an episode."""
        self._counts = dict.fromkeys(self._counts, 0)

    def open(self) -> Connection:
        """Return the open connection. If there is none, try to connect for up to ``patience_s``.

        Raises:
            PolicyUnavailableError: If the server could not be reached within ``patience_s``.
            HandshakeError: If the server declares different conventions than the client.
        """
        if self._connection is not None:
            return self._connection
        began = time.monotonic()
        attempt = 0
        while True:
            self._check_open()
            left = self._limits.patience_s - (time.monotonic() - began)
            try:
                # Each attempt may take at least one second, even if less time is left or patience is 0.
                self._connection = self._dial(max(1.0, min(self._limits.timeout_s, left)))
            except OSError as problem:
                self._wait(problem, began, attempt)
                attempt += 1
            else:
                self._dialed += 1
                if self._dialed > 1:
                    self._counts["reconnects"] += 1
                    logger.info("%s is connected again", self._where)
                return self._connection

    def request(self, exchange: Callable[[Connection, float], Received], *, replies: bool = True) -> Received:
        """Send a request and return the reply. Repeat the request if the connection breaks or the deadline passes.

        While the server is not ready, the request is repeated for up to ``patience_s``, as with an unreachable server.

        Args:
            exchange: Function that sends the request over a connection and returns the reply within the given time [s].
                It raises OSError (TimeoutError, ConnectionError) if another attempt may succeed, and PolicyError
                otherwise.
            replies: Whether the server sends a reply to this kind of message.

        Raises:
            PolicyError: If the reply is invalid, or the request failed after all retries.
            PolicyUnavailableError: If the server could not be reached, or was not ready, within ``patience_s``.
        """
        self._counts["requests"] += 1
        attempt, waits, waiting_since = 0, 0, 0.0
        while True:
            connection = self.open()
            deadline = self._limits.timeout_s if self._warm else self._limits.warmup_s
            try:
                reply = exchange(connection, deadline)
            except PolicyError:
                # The server may still send data for the failed request, so the connection cannot be reused.
                self.drop()
                raise
            except ServerNotReadyError as problem:
                self.drop()
                self._check_open()
                waiting_since = waiting_since if waits else time.monotonic()
                self._wait(problem, waiting_since, waits)
                waits += 1
                self._counts["retries"] += 1
            except OSError as problem:
                self.drop()
                self._check_open()
                reason, cure = _brief(problem), "See the server's log."
                if isinstance(problem, TimeoutError):
                    reason, self._warm = f"no answer within {deadline:g} s", True
                    cure = "See the server's log, or wait longer with timeout=SECONDS."
                logger.warning("%s: request failed (%s)", self._where, reason)
                if attempt == self._limits.retries:
                    times = f"{attempt + 1} times" if attempt else "once"
                    raise PolicyError(
                        f"{self._where} failed to answer {times}. Last reason: {reason}. {cure}"
                    ) from problem
                self._counts["retries"] += 1
                self._pause(attempt, LONGEST_PAUSE_S)
                attempt += 1
            else:
                self._warm = self._warm or replies
                return reply

    def holds(self, connection: Connection) -> bool:
        """Return whether the given connection is still open, i.e. has not been dropped or replaced."""
        return self._connection is connection

    def drop(self) -> None:
        """Close the current connection. The next request opens a new one."""
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.close()

    def close(self) -> None:
        """Close the connection permanently."""
        self._closed.set()
        self.drop()

    def _check_open(self) -> None:
        if self._closed.is_set():
            raise PolicyError(f"{self._where}: the client was closed.")

    def _wait(self, problem: OSError, began: float, attempt: int) -> None:
        """Pause after a failed attempt to reach the server.

        Raises PolicyUnavailableError if ``patience_s`` has passed since the time ``began``.
        """
        self._warm = False  # the server is probably being restarted, and will compile its model again
        left = self._limits.patience_s - (time.monotonic() - began)
        if left <= 0.0:
            raise PolicyUnavailableError(
                f"{self._where} could not be reached for {self._limits.patience_s:g} s ({_brief(problem)}). "
                "Start the server, correct the address, or wait longer with patience=SECONDS."
            ) from problem
        if attempt == 0:
            logger.warning("%s cannot be reached (%s). Trying for %.0f s", self._where, _brief(problem), left)
        self._pause(attempt, left)

    def _pause(self, attempt: int, most: float) -> None:
        longest = min(LONGEST_PAUSE_S, FIRST_PAUSE_S * 2.0 ** min(attempt, 20), most)
        self._closed.wait(longest * float(self._draw.uniform(0.5, 1.0)))


def api_key(address: PolicyAddress, option: str = "api_key_env") -> str | None:
    """Return the API key stored in the environment variable that a policy address names.

    Addresses are stored with the run, so they must not contain the key itself.

    Raises InvalidInputError if the variable is not set, or if its value cannot be sent in a header.
    """
    name = address.options.get(option)
    if name is None:
        return None
    key = os.environ.get(name, "")
    if not key or not key.isascii() or not key.isprintable():
        raise address.error(f"the environment variable {name} contains no key", f"Set {name} to the key")
    return key


def _brief(problem: OSError) -> str:
    """Return the message of an error, shortened to 200 characters."""
    return " ".join(str(problem.strerror or problem).split())[:200] or type(problem).__name__
