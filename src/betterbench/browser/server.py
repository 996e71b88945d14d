"""Viser server that accepts only the page at its printed address."""

from __future__ import annotations

import contextlib
import importlib
import io
import logging
import socket
import threading
from collections.abc import Callable
from typing import Any

from betterbench.browser.address import origin_of
from betterbench.browser.gate import Gate
from betterbench.browser.incoming import IncomingMessages, InputKind
from betterbench.errors import InvalidInputError, MissingDependencyError
from betterbench.installation import missing_extra
from betterbench.policies.serving.callers import LOOPBACK_NAMES

STOP_S = 0.5
"""Maximum time to wait for pages to close when the server stops [s]."""


def load_viser() -> Any:  # noqa: ANN401 - a module
    """Return viser; raise MissingDependencyError if it is not installed."""
    try:
        return importlib.import_module("viser")
    except ImportError as problem:
        raise missing_extra("The page in the browser needs viser, which is not installed", "teleop") from problem


def free_port(host: str, port: int) -> int:
    """Return the requested port if it is free, or any free port for 0.

    Raise InvalidInputError if the requested port is not available.
    """
    if not 0 <= port <= 65535:
        raise InvalidInputError(
            "--port", f"{port} is not a port", "Give a number from 0 to 65535; 0 chooses a free port"
        )
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            return int(probe.getsockname()[1])
    except OSError as problem:
        reason = problem.strerror or str(problem)
        cure = "Stop the process that uses it, or choose another: --port 0 chooses a free port"
        raise InvalidInputError("--host, --port", f"cannot listen on {host}:{port} ({reason})", cure) from problem


class PageServer:
    """A viser server behind a gate (:mod:`betterbench.browser.gate`).

    Attributes:
        viser: The viser server.
        port: Port on which the server listens.
    """

    def __init__(self, *, host: str, port: int, verb: str, complain: Callable[[str], None]) -> None:
        """Start listening.

        Args:
            host: Interface.
            port: Port; 0 for any free port.
            verb: CLI subcommand that serves the page ("better teleop").
            complain: Receives reports of rejected messages.

        Raises:
            MissingDependencyError: If viser is not installed.
            InvalidInputError: If the port is taken.
        """
        viser = load_viser()
        self._host = host
        wanted = free_port(host, port)
        logging.getLogger("websockets").setLevel(logging.CRITICAL)  # closed tabs are normal
        self._incoming = IncomingMessages(complain)
        self._gate = Gate(host, self._incoming, verb=verb)
        with contextlib.redirect_stdout(io.StringIO()), self._gate.before_servers():  # viser prints a banner
            self.viser = viser.ViserServer(host=host, port=wanted, label=verb, verbose=False)
        self.port = int(self.viser.get_port())
        if not self._gate.is_closed:
            self.viser.stop()
            raise MissingDependencyError(
                f"{verb} cannot control access to the server of this viser version ({viser.__version__}). Install "
                f"the version required by the extra 'teleop'"
            )
        if self.port != wanted:  # the port was taken in the meantime, and viser chose the next port
            self.viser.stop()
            raise InvalidInputError("--port", f"{wanted} was taken in the meantime", "Run the same command again")
        self._stopping = threading.Thread(target=self.viser.stop, name="page", daemon=True)

    @property
    def url(self) -> str:
        """The page address, with its token."""
        return f"{origin_of(self._host, self.port)}/{self._gate.token}"

    @property
    def is_local(self) -> bool:
        """Whether the server listens only on this machine."""
        return self._host in LOOPBACK_NAMES

    def expect(self, element: Any, kind: InputKind) -> None:  # noqa: ANN401 - viser's
        """Register an element, so that its values are accepted. Its UUID is known only to the page."""
        self._incoming.expect(element._impl.uuid, kind)

    def close(self) -> None:
        """Close all connections and stop listening. Wait at most :data:`STOP_S` for pages that do not respond."""
        with contextlib.redirect_stdout(io.StringIO()):  # viser prints that it has stopped
            self._stopping.start()
            self._stopping.join(STOP_S)

    @property
    def is_busy(self) -> bool:
        """Whether the server still waits for a page to close."""
        return self._stopping.is_alive()
