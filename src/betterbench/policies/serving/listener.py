"""Listening TCP socket with a limit on the number of open connections."""

from __future__ import annotations

import errno
import socket
import threading
import time

from betterbench.errors import InvalidInputError
from betterbench.policies.serving.frame_budget import FrameBudget

_PASSING = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM, errno.ECONNABORTED, errno.EPROTO})
"""Temporary errors of ``accept``, after which a later call may succeed."""

_PAUSE_S = 0.1
_KEEPALIVE = ((socket.TCP_KEEPIDLE, 60), (socket.TCP_KEEPINTVL, 20), (socket.TCP_KEEPCNT, 6))


class Listener(socket.socket):
    """Listening TCP socket. While ``most`` connections are open, further clients wait in the operating system's queue.

    If there are not enough file descriptors or memory for another connection, ``accept`` also waits, because an error
    would end the server's loop. TCP keepalive detects clients that have disappeared without closing their connection,
    after about three minutes.
    """

    def __init__(self, bound: socket.socket, *, most: int | None, budget: FrameBudget | None = None) -> None:
        """Take over a bound socket. If a budget is given, the received data count toward it."""
        super().__init__(bound.family, bound.type, bound.proto, fileno=bound.detach())
        self._budget = budget
        self._room = None if most is None else threading.BoundedSemaphore(most)

    def accept(self) -> tuple[socket.socket, object]:
        """Return the next connection and the address of the client. Raises OSError if the socket has been closed."""
        while self._room is not None and not self._room.acquire(timeout=_PAUSE_S):
            if self.fileno() < 0:
                raise OSError(errno.EBADF, "the server has stopped")
            if self._budget is not None:
                self._budget.cut_stuck()
        try:
            taken, peer = self._take_patiently()
        except BaseException:
            self._leave()
            raise
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in _KEEPALIVE:
            taken.setsockopt(socket.IPPROTO_TCP, option, value)
        return _Taken(taken, self, self._budget), peer

    def _take_patiently(self) -> tuple[socket.socket, object]:
        while True:
            try:
                return self._take()
            except OSError as problem:
                if problem.errno not in _PASSING:
                    raise
                time.sleep(_PAUSE_S)

    def _take(self) -> tuple[socket.socket, object]:
        return super().accept()

    def _leave(self) -> None:
        if self._room is not None:
            self._room.release()


class _Taken(socket.socket):
    """Accepted connection, whose received data count toward the memory budget.

    Closing the connection allows the listener to accept another client.
    """

    def __init__(self, taken: socket.socket, listener: Listener, budget: FrameBudget | None) -> None:
        super().__init__(taken.family, taken.type, taken.proto, fileno=taken.detach())
        self._listener: Listener | None = listener
        self._budget = budget
        self.metered = None if budget is None else budget.opened(self)

    def recv(self, bufsize: int, flags: int = 0, /) -> bytes:
        if self._budget is None or self.metered is None:
            return super().recv(bufsize, flags)
        self._budget.before_receiving(self.metered)
        data = super().recv(bufsize, flags)
        self._budget.received(self.metered, data)
        return data

    def answered(self) -> None:
        """Stop counting the oldest complete message, which has been answered."""
        if self._budget is not None and self.metered is not None:
            self._budget.answered(self.metered)

    def close(self) -> None:
        super().close()
        if self._budget is not None and self.metered is not None:
            self._budget.closed(self.metered)
        listener, self._listener = self._listener, None
        if listener is not None:
            listener._leave()


def listen(host: str, port: int, *, most: int | None = None, budget: FrameBudget | None = None) -> Listener:
    """Return a socket that listens for TCP connections and keeps at most ``most`` of them open at the same time.

    Raises InvalidInputError if the socket cannot be bound.
    """
    if not 0 <= port <= 65535:
        raise InvalidInputError(
            "--port", f"{port} is not a port", "Use a number from 1 to 65535, or 0 for any free port"
        )
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return Listener(socket.create_server((host, port), family=family), most=most, budget=budget)
    except OSError as problem:
        if problem.errno == errno.EADDRINUSE:
            raise InvalidInputError(
                "--port", f"{port} is in use on {host}", "Use another port, or 0 for any free port"
            ) from None
        if problem.errno == errno.EACCES:
            raise InvalidInputError("--port", f"no permission to use port {port}", "Use a port above 1023") from None
        raise InvalidInputError(
            "--host",
            f"{host!r} is not an interface of this machine ({problem.strerror})",
            "Use 127.0.0.1 to accept only connections from this machine",
        ) from None
