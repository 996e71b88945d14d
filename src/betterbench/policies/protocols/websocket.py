"""Websocket client that sends and receives complete messages with deadlines."""

from __future__ import annotations

import contextlib
import logging
import socket
import threading
from collections.abc import Iterator

from websockets.exceptions import ConnectionClosed, InvalidStatus, InvalidURI, WebSocketException
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from betterbench.errors import HandshakeError, PolicyError, one_line
from betterbench.policies.address import PolicyAddress
from betterbench.policies.protocols.wire import MAX_FRAME_BYTES

_CLOSE_TIMEOUT_S = 1.0
_GRACE_S = 1.0
_PONG_S = 1.0
_FORBIDDEN = 403
_REFUSED = (401, _FORBIDDEN)
_ABSENT = (404, 405)
_TOO_LARGE = 1009


class WebSocket:
    """Connection to a websocket server. All methods except :meth:`close` raise OSError if the connection breaks."""

    def __init__(
        self, address: PolicyAddress, *, timeout_s: float, key: str | None = None, max_bytes: int = MAX_FRAME_BYTES
    ) -> None:
        """Connect to the server.

        Raises OSError if the server is unreachable or not ready, and HandshakeError if the server rejects the key,
        redirects the client, or has no websocket at the path.
        """
        host, port = address.server()
        name = f"[{host}]" if ":" in host else host
        scheme = "wss" if address.choice("tls", ("true", "false"), "false") == "true" else "ws"
        self._where, self._path = address.server_name, address.path
        self._max_bytes = max_bytes
        self._stack = contextlib.ExitStack()
        self._mark: threading.Event | None = None  # the library sets this event when the pong for the last ping arrives
        self._pongs = True
        raw: socket.socket | None = None
        try:
            # The library follows redirects to other servers unless it is given a connected socket.
            raw = socket.create_connection((host, port), timeout_s)
            raw.settimeout(None)
            self._socket: Connection = self._stack.enter_context(
                connect(
                    f"{scheme}://{name}:{port}{self._path}",
                    sock=raw,
                    compression=None,
                    max_size=max_bytes,
                    additional_headers={} if key is None else {"Authorization": f"Api-Key {key}"},
                    open_timeout=timeout_s,
                    close_timeout=_CLOSE_TIMEOUT_S,
                    # No automatic pings, because many servers do not answer them during inference. A dead server is
                    # detected by the deadline of the request.
                    ping_interval=None,
                    proxy=None,
                    logger=quiet_logger(),
                )
            )
        except (WebSocketException, ValueError, EOFError, AssertionError) as error:
            if raw is not None:
                raw.close()
            raise self._not_connected(error) from error

    def send(self, message: bytes, timeout_s: float) -> None:
        """Send a binary message. Raises OSError if the connection breaks or the message cannot be sent in time."""
        with self._cut_after(timeout_s, "the server accepts no more data"):
            self._socket.send(message)

    def receive(self, timeout_s: float) -> bytes | str:
        """Return the next message. Raises OSError if none arrives in time, and PolicyError if it is too large."""
        seconds = max(0.0, timeout_s)
        try:
            with self._cut_after(seconds + _GRACE_S, "no answer in time"):
                return self._socket.recv(timeout=seconds)
        except TimeoutError as error:
            raise TimeoutError("no answer in time") from error

    def mark_end_of_answer(self) -> None:
        """Send a ping after an answer, without waiting for the pong.

        Messages arrive in order, so all messages that the server has sent before the pong arrive before it.
        :meth:`refuse_unasked` uses this to detect further answers.
        """
        if self._pongs:
            with contextlib.suppress(OSError), self._cut_after(_GRACE_S, "the server accepts no more data"):
                self._mark = self._socket.ping()

    def refuse_unasked(self) -> None:
        """Raise ConnectionError if the server has sent another message after its last answer.

        If a server answers a request twice, the second answer would be mistaken for the answer to the next request, and
        all later answers would be shifted by one. The method waits for the pong of :meth:`mark_end_of_answer`. If the
        pong does not arrive within 1 s, no more pings are sent on this connection.
        """
        mark, self._mark = self._mark, None
        if mark is not None and not mark.wait(_PONG_S):
            self._pongs = False
        try:
            self.receive(0.0)
        except TimeoutError:
            return
        raise ConnectionError("the server sent an unexpected answer")

    @contextlib.contextmanager
    def greeting(self, silence: str) -> Iterator[None]:
        """Context manager for the first exchange of messages, which closes the connection if the exchange fails.

        ``silence`` is the message of the TimeoutError that is raised if the server sends nothing in time. A PolicyError
        becomes a HandshakeError, because a server that greets wrongly is another server or broken, whatever its policy.
        """
        try:
            yield
        except TimeoutError as error:
            self.close()
            raise TimeoutError(silence) from error
        except PolicyError as error:
            self.close()
            raise HandshakeError(str(error)) from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the connection. Errors are ignored."""
        with (
            contextlib.suppress(OSError, PolicyError),
            self._cut_after(_CLOSE_TIMEOUT_S + _GRACE_S, "the server does not close"),
        ):
            self._stack.close()

    @contextlib.contextmanager
    def _cut_after(self, timeout_s: float, what: str) -> Iterator[None]:
        """Context manager that shuts down the connection if its body takes longer than ``timeout_s`` [s].

        The websocket library uses one lock for all outgoing data, including answers to pings, and waits for this lock
        without a deadline. A server that sends pings but does not read could therefore block the client forever.

        Raises:
            OSError: If the connection breaks or the time limit has passed. ``what`` is the message in the latter case.
            PolicyError: If the client has closed the connection because a message was too large.
        """
        late = threading.Event()

        def cut() -> None:
            late.set()
            # Call the shutdown method of socket.socket, because the method of an encrypted socket would wait for the
            # server.
            with contextlib.suppress(OSError):
                socket.socket.shutdown(self._socket.socket, socket.SHUT_RDWR)

        timer = threading.Timer(max(0.001, timeout_s), cut)
        timer.daemon = True
        timer.start()
        try:
            yield
        except ConnectionClosed as error:
            if late.is_set():
                raise TimeoutError(what) from error
            raise self._broken(error) from error
        finally:
            timer.cancel()

    def _not_connected(self, error: Exception) -> Exception:
        """Convert an error of the websocket library to the error that is raised if the connection cannot be opened."""
        answer = error if isinstance(error, InvalidStatus) else error.__context__
        if isinstance(answer, InvalidStatus):
            status = answer.response.status_code
            if status in _REFUSED:
                # Servers based on FastAPI, such as vLLM-Omni, also return 403 for an unknown path.
                other = (
                    ""
                    if status != _FORBIDDEN
                    else f" If it needs no key, it does not serve {self._path}: correct the path."
                )
                return HandshakeError(
                    f"{self._where} rejects this client (HTTP {status}). "
                    f"Add api_key_env=NAME to the address, where NAME is the environment variable with the key.{other}"
                )
            if status in _ABSENT:
                return HandshakeError(
                    f"{self._where} has no websocket at {self._path} (HTTP {status}). Correct the path in the address."
                )
            if 300 <= status < 400:
                elsewhere = one_line(answer.response.headers.get("Location", "no address"), most=200)
                return HandshakeError(
                    f"{self._where} redirects this client (HTTP {status}, {elsewhere}). Redirects are not "
                    "followed: give the address of the server itself."
                )
            return ConnectionError(f"the server answered HTTP {status}")
        if isinstance(error, (InvalidURI, UnicodeError)):
            return HandshakeError(f"{self._where} is not a websocket address ({error}).")
        if isinstance(error, ConnectionClosed) or isinstance(error.__cause__, EOFError):
            # The connection ended before the handshake, as behind a tunnel to a server that is down.
            return ConnectionError("connections are closed without an answer")
        # The error may be an AssertionError of the library, which occurs if a server sends data before the handshake.
        return ConnectionError(f"the server is not a websocket server ({error})")

    def _broken(self, error: ConnectionClosed) -> OSError:
        """Convert an error of the websocket library to the error that is raised if the connection breaks.

        Raises PolicyError if the client has closed the connection because a message was too large.
        """
        if error.sent is not None and error.sent.code == _TOO_LARGE:
            raise PolicyError(f"{self._where} sent a message of more than {self._max_bytes} bytes.") from error
        if error.rcvd is None:
            return ConnectionError("the connection was dropped")
        reason = one_line(error.rcvd.reason, most=120)
        return ConnectionError(f"the server closed the connection with code {error.rcvd.code} {reason}".strip())


def quiet_logger() -> logging.Logger:
    """Return a logger for the websocket library that suppresses tracebacks of port scans and failed handshakes."""
    quiet = logging.getLogger(f"{__name__}.websockets")
    quiet.setLevel(logging.CRITICAL)
    return quiet
