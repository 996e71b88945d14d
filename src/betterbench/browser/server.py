"""Server for pages based on the library viser, with access control."""

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
"""Longest time to wait for pages to close when the server stops [s]."""


def load_viser() -> Any:  # noqa: ANN401 - a module
    """Import viser. Raises MissingDependencyError if it is not installed."""
    try:
        return importlib.import_module("viser")
    except ImportError as problem:
        raise missing_extra("The page in the browser needs viser, which is not installed", "teleop") from problem


def free_port(host: str, port: int) -> int:
    """Return ``port`` if it is available. For 0, return any free port.

    Raises InvalidInputError if the requested port is not available.
    """
    if not 0 <= port <= 65535:
        raise InvalidInputError(
            "--port", f"{port} is not a port", "Use a number from 1 to 65535, or 0 for any free port"
        )
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            return int(probe.getsockname()[1])
    except OSError as problem:
        reason = problem.strerror or str(problem)
        cure = "Stop the process that uses the port, or use --port 0 to select a free port"
        raise InvalidInputError("--host, --port", f"cannot listen on {host}:{port} ({reason})", cure) from problem


class PageServer:
    """viser server with access control (see :mod:`betterbench.browser.gate`).

    Attributes:
        viser: Server object of viser.
        port: Port on which the server listens.
    """

    def __init__(self, *, host: str, port: int, verb: str, complain: Callable[[str], None]) -> None:
        """Start listening.

        Args:
            host: Interface to listen on.
            port: Port to listen on. 0 selects any free port.
            verb: Command that shows the page, such as "better teleop".
            complain: Function that is called with an explanation for each rejected message.

        Raises:
            MissingDependencyError: If viser is not installed.
            InvalidInputError: If the port is not available.
        """
        viser = load_viser()
        self._host = host
        wanted = free_port(host, port)
        logging.getLogger("websockets").setLevel(logging.CRITICAL)  # do not log an error when a browser tab is closed
        self._incoming = IncomingMessages(complain)
        self._gate = Gate(host, self._incoming, verb=verb)
        with contextlib.redirect_stdout(io.StringIO()), self._gate.before_servers():  # hide viser's banner
            self.viser = viser.ViserServer(host=host, port=wanted, label=verb, verbose=False)
        self.port = int(self.viser.get_port())
        if not self._gate.is_closed:
            self.viser.stop()
            raise MissingDependencyError(
                f"{verb} cannot control access to the server of this viser version ({viser.__version__}). "
                "Install the version required by the extra 'teleop'"
            )
        if self.port != wanted:  # another process has taken the port since free_port(), so viser chose another one
            self.viser.stop()
            raise InvalidInputError(
                "--port", f"{wanted} has been taken by another process", "Run the same command again"
            )
        self._stopping = threading.Thread(target=self.viser.stop, name="page", daemon=True)

    @property
    def url(self) -> str:
        """Address of the page, including the token."""
        return f"{origin_of(self._host, self.port)}/{self._gate.token}"

    @property
    def is_local(self) -> bool:
        """Whether the server listens only on this machine."""
        return self._host in LOOPBACK_NAMES

    def expect(self, element: Any, kind: InputKind) -> None:  # noqa: ANN401 - viser's
        """Register an element of the panel, so that messages about this element are accepted."""
        self._incoming.expect(element._impl.uuid, kind)

    def close(self) -> None:
        """Close all connections and stop the server. Wait at most :data:`STOP_S` for pages that do not respond.

        :attr:`is_busy` tells whether the server is still stopping afterwards.
        """
        with contextlib.redirect_stdout(io.StringIO()):  # hide viser's message that it has stopped
            self._stopping.start()
            self._stopping.join(STOP_S)

    @property
    def is_busy(self) -> bool:
        """Whether the server is still waiting for connections to close."""
        return self._stopping.is_alive()
