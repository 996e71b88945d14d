"""Server for openpi's protocol. It sends metadata first, then one reply per request. Errors are sent as text frames.

The server is independent of the policy: for each connection, it calls a function that creates a :class:`Session`, which
answers the requests. Each connection has its own thread, so a client that is slow, disconnects or sends invalid data
does not affect other clients. Source of the protocol: openpi's ``websocket_policy_server.py`` and its client.
"""

from __future__ import annotations

import contextlib
import hmac
import http
import logging
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any, Protocol, Self

from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import Server, ServerConnection, serve

from betterbench.errors import BetterError, InvalidInputError
from betterbench.policies.protocols.websocket import quiet_logger
from betterbench.policies.protocols.wire import decode_openpi, encode_openpi
from betterbench.policies.serving.callers import LOOPBACK_NAMES, is_own_host
from betterbench.policies.serving.frame_budget import FrameBudget
from betterbench.policies.serving.listener import listen

logger = logging.getLogger(__name__)

DEFAULT_PORT = 8000
"""Default port, as in openpi's server."""
LOOPBACK = "127.0.0.1"
MAX_CLIENTS = 128
"""Default maximum number of clients.

Each connection needs four file descriptors and two threads. Most machines allow 1,024 file descriptors per process.
"""
MAX_REQUEST_BYTES = 64 * 1024 * 1024
"""Maximum size of a request [bytes]. An observation with three images of 448 x 448 pixels takes 2 MB."""
IDLE_S = 3600.0
"""Time without requests after which a client is disconnected and its session is closed [s]."""
IDLE_WHILE_FULL_S = 600.0
"""Time without requests after which a client is disconnected if the server is full and another client connects [s].

Between two requests, a client executes an action chunk or resets a scene. This takes seconds, or minutes if a person
resets a real scene.
"""

_AWAY_CODE = 1001
_ERROR_CODE = 1011
_FULL_CODE = 1013
_CLOSE_TIMEOUT_S = 2.0
_GREETED_AT_ONCE = 32
_QUEUED = 2
_ROOM_S, _PAUSE_S = 1.0, 0.02


class Session(Protocol):
    """Handler for the requests of one connection. Requests are handled one at a time."""

    def answer(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the reply to a request: a map with ``actions`` (horizon, dim) and possibly other entries.

        Implementations raise a BetterError if a request cannot be answered. Its message is sent to the client.
        """

    def close(self) -> None:
        """Release the resources of the connection."""


class PolicyServer:
    """Policy server. As a context manager, it starts when the block is entered and stops when the block is left."""

    def __init__(
        self,
        make_session: Callable[[], Session],
        *,
        metadata: Mapping[str, Any],
        host: str = LOOPBACK,
        port: int = DEFAULT_PORT,
        api_key: str | None = None,
        clients: int | None = MAX_CLIENTS,
        on_stop: Callable[[], None] | None = None,
        budget: FrameBudget | None = None,
        idle_while_full_s: float = IDLE_WHILE_FULL_S,
    ) -> None:
        """Bind the socket. Clients are answered only after :meth:`start`.

        Raises InvalidInputError if the socket cannot be bound.

        Args:
            make_session: Function that creates a session. It is called when a client sends its first request.
            metadata: Metadata that the server sends to each client when it connects.
            host: Interface to listen on.
            port: Port to listen on. 0 selects any free port.
            api_key: Key that clients must send, or None.
            clients: Maximum number of simultaneous clients. None means that there is no limit.
            on_stop: Function that is called once, after all connections have been closed.
            budget: Limit on the total memory for messages. None creates a budget with the default size.
            idle_while_full_s: Time without requests after which a client may be disconnected to make room [s]. If a new
                client connects while the maximum number of clients is connected, the client that has been silent for
                the longest time is disconnected, provided that it has been silent for more than this time.
        """
        self._make_session, self._api_key, self._on_stop = make_session, api_key, on_stop
        self._clients, self._budget = clients, budget or FrameBudget()
        self._idle_while_full_s = idle_while_full_s
        self._greeting = encode_openpi(dict(metadata))
        self._lock = threading.Lock()
        self._open: set[ServerConnection] = set()
        # After a connection has been closed, its thread still closes the session and logs that the client has left.
        self._talking: set[threading.Thread] = set()
        self._silent_since: dict[ServerConnection, float] = {}
        self._thread: threading.Thread | None = None
        self._server: Server = serve(
            self._converse,
            sock=listen(host, port, most=None if clients is None else clients + _GREETED_AT_ONCE, budget=self._budget),
            compression=None,
            max_size=MAX_REQUEST_BYTES,
            max_queue=_QUEUED,
            process_request=self._admit,
            # No pings are sent, because a client that simulates for a minute between two requests may not answer them.
            ping_interval=None,
            close_timeout=_CLOSE_TIMEOUT_S,
            logger=quiet_logger(),
        )
        self.host = host
        self.port = int(self._server.socket.getsockname()[1])

    @property
    def _own_origins(self) -> set[str]:
        hosts = (self.client_host, LOOPBACK, "localhost", "[::1]")
        return {f"http://{host}:{self.port}" for host in hosts}

    @property
    def client_host(self) -> str:
        """Host name under which clients on this machine reach the server."""
        return LOOPBACK if self.host in ("0.0.0.0", "::", "") else self.host  # noqa: S104 - compared, not bound

    @property
    def address(self) -> str:
        """Policy address under which the served policy can be evaluated."""
        host = self.client_host
        return f"openpi://{f'[{host}]' if ':' in host else host}:{self.port}"

    def start(self) -> None:
        """Start answering clients, in threads of this process."""
        self._thread = threading.Thread(target=self._server.serve_forever, name=f"serve:{self.port}", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Reject new connections, close the open connections, and wait until their threads have ended."""
        thread, self._thread = self._thread, None
        self._budget.stop()
        if thread is None:
            self._server.socket.close()
            return
        self._server.shutdown()
        thread.join()
        # In older releases of websockets, shutdown() does not close open connections.
        with self._lock:
            left, talking = list(self._open), list(self._talking)
        # Close the connections in parallel, because each call may have to wait for a client that does not respond.
        closing = [threading.Thread(target=_close, args=(connection,), daemon=True) for connection in left]
        for closer in closing:
            closer.start()
        for waited_for in (*closing, *talking):
            waited_for.join(_CLOSE_TIMEOUT_S)
        if self._on_stop is not None:
            self._on_stop()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer health checks, and reject clients that are not allowed to use the server."""
        if request.path == "/healthz":
            return connection.respond(http.HTTPStatus.OK, "OK\n")
        # A browser lets any web page open a websocket to this machine, so check the origin that the browser sends.
        if not set(request.headers.get_all("Origin")) <= self._own_origins:
            return connection.respond(http.HTTPStatus.FORBIDDEN, "Pages of other sites may not use this server.\n")
        if self.host in LOOPBACK_NAMES and not is_own_host(request.headers.get_all("Host"), self.host):
            return connection.respond(http.HTTPStatus.FORBIDDEN, "Only clients on this machine may use this server.\n")
        if self._api_key is not None:
            shown = request.headers.get("Authorization", "")
            if not hmac.compare_digest(shown.encode(), f"Api-Key {self._api_key}".encode()):
                return connection.respond(http.HTTPStatus.UNAUTHORIZED, "This server requires an Api-Key.\n")
        if self._full() and not self._room_made():
            return connection.respond(
                http.HTTPStatus.SERVICE_UNAVAILABLE, "This server has reached its maximum number of clients.\n"
            )
        return None

    def _room_made(self) -> bool:
        """Try to disconnect a client that does not finish its message or has been silent for too long.

        Return whether there is room for another client.
        """
        self._budget.cut_stuck()
        is_let_go = self._let_silent_go()
        end = time.monotonic() + _ROOM_S + (_CLOSE_TIMEOUT_S if is_let_go else 0.0)
        while self._full() and time.monotonic() < end and (is_let_go or self._budget.is_dropping):
            time.sleep(_PAUSE_S)
        return not self._full()

    def _let_silent_go(self) -> bool:
        """Close the connection that has been silent for the longest time, if it has been silent for too long.

        Return whether a connection was closed.
        """
        with self._lock:
            if self._clients is None or len(self._open) < self._clients or not self._silent_since:
                return False
            longest = min(self._silent_since, key=self._silent_since.__getitem__)
            if time.monotonic() - self._silent_since[longest] <= self._idle_while_full_s:
                return False
            # Removing the entry prevents other threads from closing the same connection. It also tells the thread of
            # this connection to stop, even if a request has just arrived (see _next_frame).
            del self._silent_since[longest]
        logger.info(
            "%s is disconnected, because it was silent for too long while others are waiting",
            _name_of(longest.remote_address),
        )
        # Close the connection in a thread, because the call may have to wait for a client that does not respond.
        closing = (_AWAY_CODE, "This client was silent for too long while others were waiting.")
        threading.Thread(target=longest.close, args=closing, name="let-go", daemon=True).start()
        return True

    def _full(self, more: int = 1) -> bool:
        """Return whether the maximum number of clients would be exceeded if ``more`` additional clients connected."""
        with self._lock:
            return self._clients is not None and len(self._open) + more > self._clients

    def _converse(self, connection: ServerConnection) -> None:
        """Answer the requests of one client until it disconnects."""
        client = _name_of(connection.remote_address)
        with self._lock:
            self._open.add(connection)
            self._talking.add(threading.current_thread())
        logger.info("%s connected", client)
        answered, session = 0, None
        timing: dict[str, float] = {}
        try:
            if self._full(0):
                connection.close(_FULL_CODE, "This server has reached its maximum number of clients.")
                return
            connection.send(self._greeting)
            while (frame := self._next_frame(connection)) is not None:
                # Create the session at the first request, because loading weights may take longer than the client's
                # deadline for connecting.
                session = session or self._make_session()
                began = time.perf_counter()
                reply = self._reply(session, frame)
                reply["server_timing"] = {"infer_ms": 1000.0 * (time.perf_counter() - began)} | timing
                connection.send(encode_openpi(reply))
                timing = {"prev_total_ms": 1000.0 * (time.perf_counter() - began)}
                answered += 1
                connection.socket.answered()  # type: ignore[attr-defined] # of the listener
        except ConnectionClosed:
            pass
        except BaseException as problem:  # noqa: BLE001 - report every error to this client, and keep serving others
            text = str(problem) if isinstance(problem, BetterError) else traceback.format_exc()
            logger.warning("%s: %s", client, text.strip().splitlines()[-1])
            if session is not None:
                session.close()  # first, because the client may reconnect as soon as it receives the error
                session = None
            with contextlib.suppress(ConnectionClosed):
                connection.send(text)
                connection.close(_ERROR_CODE, "the previous frame contains the reason")
        finally:
            with self._lock:
                self._open.discard(connection)
                self._silent_since.pop(connection, None)
            if session is not None:
                session.close()
            logger.info("%s left after %d answers", client, answered)
            with self._lock:
                self._talking.discard(threading.current_thread())

    def _next_frame(self, connection: ServerConnection) -> str | bytes | None:
        """Return the next frame from a client, or None if the client is disconnected because it was silent too long."""
        with self._lock:
            self._silent_since[connection] = time.monotonic()
        try:
            frame = connection.recv(timeout=IDLE_S)
        except TimeoutError:
            connection.close(_AWAY_CODE, "This client was silent for too long.")
            return None
        with self._lock:
            is_let_go = self._silent_since.pop(connection, None) is None
        return None if is_let_go else frame

    def _reply(self, session: Session, frame: str | bytes) -> dict[str, Any]:
        """Return the session's reply to a frame. Raises InvalidInputError if the frame is not a request."""
        if isinstance(frame, str):
            raise InvalidInputError(
                "the request", "expected a binary frame, got text", "Send one binary msgpack map per observation"
            )
        request = decode_openpi(frame)
        if not isinstance(request, dict):
            raise InvalidInputError(
                "the request", f"expected a map, got {type(request).__name__}", "Send a map, as openpi's client does"
            )
        return dict(session.answer(request))


def _close(connection: ServerConnection) -> None:
    """Close a connection of a server that is stopping."""
    with contextlib.suppress(Exception):
        connection.close(_AWAY_CODE)


def _name_of(address: Any) -> str:  # noqa: ANN401 - a tuple whose form depends on the family of the socket
    return f"{address[0]}:{address[1]}" if isinstance(address, tuple) and len(address) >= 2 else str(address)
