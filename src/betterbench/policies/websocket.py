"""A websocket as a channel: whole messages with deadlines, and the errors of the library as OSError."""

from __future__ import annotations

import contextlib
import logging
import math
import socket
import struct
from collections.abc import Iterator

from websockets.exceptions import ConnectionClosed, InvalidStatus, InvalidURI, WebSocketException
from websockets.sync.client import ClientConnection, connect

from betterbench.errors import HandshakeError, PolicyError
from betterbench.policies.address import PolicyAddress
from betterbench.policies.wire import MAX_FRAME_BYTES

_CLOSE_TIMEOUT_S = 1.0
_REFUSED = (401, 403)
_TOO_LARGE = 1009


class WebSocket:
    """One connection to a websocket server."""

    def __init__(
        self, address: PolicyAddress, *, timeout_s: float, key: str | None = None, max_bytes: int = MAX_FRAME_BYTES
    ) -> None:
        """Connect.

        Raises OSError if the server is not there or not ready, HandshakeError if it refuses the key, or is not a
        websocket server.
        """
        host, port = address.server()
        name = f"[{host}]" if ":" in host else host
        scheme = "wss" if address.choice("tls", ("true", "false"), "false") == "true" else "ws"
        self._where = f"policy server {address.scheme}://{name}:{port}"
        self._max_bytes = max_bytes
        self._stack = contextlib.ExitStack()
        try:
            self._socket: ClientConnection = self._stack.enter_context(
                connect(
                    f"{scheme}://{name}:{port}",
                    compression=None,
                    max_size=max_bytes,
                    additional_headers={} if key is None else {"Authorization": f"Api-Key {key}"},
                    open_timeout=timeout_s,
                    close_timeout=_CLOSE_TIMEOUT_S,
                    # Servers answer no pings while they infer; the deadline of the request finds out who is dead.
                    ping_interval=None,
                    proxy=None,
                    logger=quiet_logger(),
                )
            )
        except InvalidStatus as error:
            status = error.response.status_code
            if status in _REFUSED:
                raise HandshakeError(
                    f"{self._where} refuses this client (HTTP {status}). "
                    "Give api_key_env=NAME with the variable that holds its key."
                ) from error
            raise ConnectionError(f"the server answered HTTP {status}") from error
        except (InvalidURI, UnicodeError) as error:
            raise HandshakeError(f"{self._where} is not an address of a websocket ({error}).") from error
        except (WebSocketException, EOFError, AssertionError) as error:
            # One who talks before we have asked can trip an assertion of the library's.
            raise ConnectionError(f"the server there is not a websocket server ({error})") from error

    def send(self, message: bytes, timeout_s: float) -> None:
        """Send one binary message; raise OSError if the connection broke, or no bytes were taken until the deadline."""
        # A server that stops reading fills the buffers, and a blocking send knows no deadline of its own.
        seconds = max(0.001, timeout_s)
        limit = struct.pack("ll", math.floor(seconds), math.floor(1e6 * (seconds % 1.0)))
        try:
            self._socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
            self._socket.send(message)
        except ConnectionClosed as error:
            if isinstance(error.__cause__, BlockingIOError):
                raise TimeoutError("the server takes no more bytes") from error
            raise self._broken(error) from error

    def receive(self, timeout_s: float) -> bytes | str:
        """Return the next message; raise OSError if none comes in time, PolicyError if it is too large."""
        try:
            return self._socket.recv(timeout=max(0.0, timeout_s))
        except TimeoutError as error:
            raise TimeoutError("no answer in time") from error
        except ConnectionClosed as error:
            raise self._broken(error) from error

    @contextlib.contextmanager
    def greeting(self, silence: str) -> Iterator[None]:
        """Close the connection if its first exchange fails; ``silence`` is said of a server that answers nothing."""
        try:
            yield
        except TimeoutError as error:
            self.close()
            raise TimeoutError(silence) from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the connection; nothing is raised."""
        with contextlib.suppress(OSError, ConnectionClosed):
            self._stack.close()

    def _broken(self, error: ConnectionClosed) -> OSError:
        """Return the error of a broken connection.

        Raises PolicyError if it was this side that closed it, because a message was too large.
        """
        if error.sent is not None and error.sent.code == _TOO_LARGE:
            raise PolicyError(f"{self._where} sent a message of more than {self._max_bytes} bytes.") from error
        if error.rcvd is None:
            return ConnectionError("the connection was dropped")
        reason = " ".join(error.rcvd.reason.split())[:120]
        return ConnectionError(f"the server closed the connection with code {error.rcvd.code} {reason}".strip())


def quiet_logger() -> logging.Logger:
    """Return a logger for the library, which would log a traceback for every port scan and client that breaks off."""
    quiet = logging.getLogger(f"{__name__}.websockets")
    quiet.setLevel(logging.CRITICAL)
    return quiet
