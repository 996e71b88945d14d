"""Connections from one process to an HTTP server that are kept open between requests."""

from __future__ import annotations

import contextlib
import http.client
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Connections:
    """Connections to one server. Several threads can use them at the same time.

    Connections stay open between requests only inside the context :meth:`kept`.
    """

    def __init__(self, connect: Callable[[], http.client.HTTPConnection]) -> None:
        self._connect, self._lock = connect, threading.Lock()
        self._holders, self._stopped = 0, threading.Event()
        self._idle, self._busy = list[http.client.HTTPConnection](), set[http.client.HTTPConnection]()

    @property
    def is_stopped(self) -> bool:
        """Whether the requests were stopped."""
        return self._stopped.is_set()

    @contextmanager
    def kept(self) -> Iterator[Connections]:
        """Context manager that keeps connections open between requests.

        They are closed when the last such context ends.
        """
        with self._lock:
            if self._holders == 0:
                self._stopped.clear()
            self._holders += 1
        try:
            yield self
        finally:
            with self._lock:
                self._holders -= 1
                closed = [] if self._holders else self._idle
                self._idle = [] if closed else self._idle
            for connection in closed:
                connection.close()

    def stop(self) -> None:
        """Make all pending requests fail soon, including those that wait for a retry.

        Requests are possible again after the next call of :meth:`kept`.
        """
        self._stopped.set()
        with self._lock:
            busy = list(self._busy)
        for connection in busy:
            with contextlib.suppress(OSError):
                if connection.sock is not None:
                    connection.sock.shutdown(socket.SHUT_RDWR)

    def pause(self, seconds: float) -> None:
        """Sleep for the given time, but wake up early if the requests are stopped."""
        self._stopped.wait(seconds)

    def post(
        self,
        path: str,
        body: bytes,
        headers: dict[str, str],
        read: Callable[[http.client.HTTPResponse], bytes],
    ) -> tuple[http.client.HTTPResponse, bytes]:
        """Send a request, and return the response and its content.

        If the server has closed an idle connection in the meantime, the request is sent again on a new connection.

        Raises:
            OSError: If the server cannot be reached, or closes the connection.
            http.client.HTTPException: If the response is not HTTP.
        """
        with self._taken() as (connection, keep):
            is_used = connection.sock is not None
            try:
                connection.request("POST", path, body, headers)
                response = connection.getresponse()
            except (ConnectionResetError, BrokenPipeError, http.client.RemoteDisconnected):
                if not is_used or self.is_stopped:
                    raise
                connection.close()  # the next request opens a new connection
                connection.request("POST", path, body, headers)
                response = connection.getresponse()
            content = read(response)
            is_whole = response.isclosed() or response.length == 0
            response.close()
            if is_whole and not response.will_close:
                keep()
            return response, content

    @contextmanager
    def _taken(self) -> Iterator[tuple[http.client.HTTPConnection, Callable[[], None]]]:
        with self._lock:
            if self.is_stopped:
                raise ConnectionAbortedError("the requests were stopped")
            connection = self._idle.pop() if self._idle else self._connect()
            self._busy.add(connection)
        is_whole = False

        def keep() -> None:
            nonlocal is_whole
            is_whole = True

        try:
            yield connection, keep
        finally:
            with self._lock:
                self._busy.discard(connection)
                stays = is_whole and self._holders > 0
                if stays:
                    self._idle.append(connection)
            if not stays:
                connection.close()
