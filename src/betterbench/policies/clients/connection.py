"""Connection used by all policy server clients, with reconnects, deadlines and retries."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from betterbench.errors import PolicyError, PolicyUnavailableError
from betterbench.policies.address import PolicyAddress

logger = logging.getLogger(__name__)

FIRST_PAUSE_S = 0.1
"""Pause before a request or connection attempt is repeated [s]. It is doubled each time."""

LONGEST_WAIT_S = 604_800
"""Maximum of deadlines and of ``patience_s`` [s], a week."""

MOST_RETRIES = 1000
"""Maximum number of retries."""

LONGEST_PAUSE_S = 5.0
"""Longest pause before a retry [s]."""


class ClosableConnection(Protocol):
    """A connection to a server."""

    def close(self) -> None:
        """Close the connection. This never raises an error."""


Connection = TypeVar("Connection", bound=ClosableConnection)
Received = TypeVar("Received")


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Deadlines and retries of a connection to a policy server.

    Attributes:
        timeout_s: Deadline of each request [s].
        warmup_s: Deadline of the first reply [s], because many servers compile their model at the first request. After
            a timeout, ``timeout_s`` is used.
        retries: Number of times a request is repeated after a broken connection or a timeout.
        patience_s: Time during which connections to an unreachable server are retried [s].
        seed: Seed for jitter in the pauses, so that the clients of a lost server do not reconnect at the same time.
    """

    timeout_s: float = 30.0
    warmup_s: float = 300.0
    retries: int = 3
    patience_s: float = 60.0
    seed: int = 0

    @classmethod
    def of(cls, address: PolicyAddress, *, seed: int = 0) -> ConnectionLimits:
        """Return the limits given in an address.

        Raises InvalidInputError if an option is not a number, or the deadline is zero.
        """
        usual = cls()
        limits = cls(
            timeout_s=address.number("timeout", usual.timeout_s),
            # a deadline given in the address also applies to the first request, unless warmup is given
            warmup_s=address.number("warmup", address.number("timeout", usual.warmup_s)),
            retries=address.whole("retries", usual.retries),
            patience_s=address.number("patience", usual.patience_s),
            seed=seed,
        )
        if min(limits.timeout_s, limits.warmup_s) <= 0.0:
            raise address.error("the deadline must be above 0", "Give the number of seconds")
        for name, value, most in (
            ("timeout", limits.timeout_s, LONGEST_WAIT_S),
            ("warmup", limits.warmup_s, LONGEST_WAIT_S),
            ("patience", limits.patience_s, LONGEST_WAIT_S),
            ("retries", limits.retries, MOST_RETRIES),
        ):
            if value > most:
                raise address.error(f"{name}={value:g} is too large", f"Give at most {most}")
        return limits


class PolicyConnection(Generic[Connection]):
    """Connection to one server that reopens lost sockets.

    Only one thread may send requests at a time. Another thread may call :meth:`close`, which ends every wait.
    """

    def __init__(self, where: str, dial: Callable[[float], Connection], limits: ConnectionLimits) -> None:
        """Store the settings without contacting the server.

        ``dial`` connects and does the handshake within the given time [s]. It raises OSError if another attempt may
        succeed, and a BetterError otherwise.
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
        """Counts of requests, retries and new connections since the last :meth:`count_anew`."""
        return {f"policy_{name}": float(count) for name, count in self._counts.items()}

    def count_anew(self) -> None:
        """Reset the counts and times at the beginning of an episode."""
        self._counts = dict.fromkeys(self._counts, 0)

    def open(self) -> Connection:
        """Return the connection, and connect repeatedly until the server answers.

        Raises:
            PolicyUnavailableError: If the server could not be reached within ``patience_s``.
            HandshakeError: If the server declares other conventions.
        """
        if self._connection is not None:
            return self._connection
        began = time.monotonic()
        attempt = 0
        while True:
            self._check_open()
            left = self._limits.patience_s - (time.monotonic() - began)
            try:
                # give the last attempt, or the only one if patience is 0, at least one second
                self._connection = self._dial(max(1.0, min(self._limits.timeout_s, left)))
            except OSError as problem:
                left = self._limits.patience_s - (time.monotonic() - began)
                if left <= 0.0:
                    raise PolicyUnavailableError(
                        f"{self._where} could not be reached for {self._limits.patience_s:g} s ({_brief(problem)}). "
                        "Start the server, correct the address, or wait longer with patience=SECONDS."
                    ) from problem
                if attempt == 0:
                    logger.warning("%s cannot be reached (%s). Trying for %.0f s", self._where, _brief(problem), left)
                self._pause(attempt, left)
                attempt += 1
            else:
                self._dialed += 1
                if self._dialed > 1:
                    self._counts["reconnects"] += 1
                    logger.info("%s is connected again", self._where)
                return self._connection

    def request(self, exchange: Callable[[Connection, float], Received], *, replies: bool = True) -> Received:
        """Send a request, and retry if the connection breaks or the deadline passes.

        Args:
            exchange: Function that sends the request over a connection and returns the reply, within the given time
                [s]. It raises OSError (TimeoutError, ConnectionError) if another attempt may succeed, and PolicyError
                otherwise.
            replies: False for a message that the server does not answer.

        Raises:
            PolicyError: If the reply is invalid, or the request failed after all retries.
            PolicyUnavailableError: If the server could not be reached within ``patience_s``.
        """
        self._counts["requests"] += 1
        for attempt in range(self._limits.retries + 1):
            connection = self.open()
            deadline = self._limits.timeout_s if self._warm else self._limits.warmup_s
            try:
                reply = exchange(connection, deadline)
            except PolicyError:
                # more data on this connection may belong to the failed request
                self.drop()
                raise
            except OSError as problem:
                self.drop()
                self._check_open()
                reason = _brief(problem)
                if isinstance(problem, TimeoutError):
                    reason, self._warm = f"no answer within {deadline:g} s", True
                logger.warning("%s: request failed (%s)", self._where, reason)
                if attempt == self._limits.retries:
                    times = f"{attempt + 1} times" if attempt else "once"
                    raise PolicyError(f"{self._where} failed to answer {times}. Last reason: {reason}.") from problem
                self._counts["retries"] += 1
                self._pause(attempt, LONGEST_PAUSE_S)
            else:
                self._warm = self._warm or replies
                return reply
        raise AssertionError("the last attempt returns or raises")

    def holds(self, connection: Connection) -> bool:
        """Return whether a connection is the current connection."""
        return self._connection is connection

    def drop(self) -> None:
        """End the connection. The next request opens a new connection."""
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

    def _pause(self, attempt: int, most: float) -> None:
        longest = min(LONGEST_PAUSE_S, FIRST_PAUSE_S * 2.0 ** min(attempt, 20), most)
        self._closed.wait(longest * float(self._draw.uniform(0.5, 1.0)))


def api_key(address: PolicyAddress, option: str = "api_key_env") -> str | None:
    """Return the key from the environment variable named in an address. Addresses must not contain keys.

    Raises InvalidInputError if the variable is not set, or its value cannot be sent in a header.
    """
    name = address.options.get(option)
    if name is None:
        return None
    key = os.environ.get(name, "")
    if not key or not key.isascii() or not key.isprintable():
        raise address.error(f"the environment variable {name} contains no key", f"Set {name}")
    return key


def _brief(problem: OSError) -> str:
    """Return a short description of an error."""
    return " ".join(str(problem.strerror or problem).split())[:200] or type(problem).__name__
