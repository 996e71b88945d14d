"""ZeroMQ client that sends a request and waits for the reply until a deadline."""

from __future__ import annotations

import contextlib
import math
import socket
import threading
import time

import zmq

from betterbench.errors import PolicyError
from betterbench.policies.protocols.wire import MAX_FRAME_BYTES

_KNOCK_S = 2.0
_GLANCE_S = 0.1
_SETTLE_S = 0.002


class RequestClient:
    """ZeroMQ client connected to one server. It uses a DEALER socket but the message format of a REQ socket.

    In contrast to a REQ socket, the client raises an error if it receives an unexpected reply. After an OSError, close
    the client and create a new one. Otherwise, a late reply could be mistaken for the answer to the next request.
    """

    def __init__(self, host: str, port: int, *, timeout_s: float) -> None:
        """Connect to the server. Raises OSError if no server listens at the port, which ZeroMQ would not report."""
        self.where = f"{f'[{host}]' if ':' in host else host}:{port}"
        try:
            socket.create_connection((host, port), min(timeout_s, _KNOCK_S)).close()
        except OSError as error:
            raise ConnectionError(f"no server listens on {self.where}: {error}") from error
        self._busy, self._ended = threading.Lock(), threading.Event()
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, MAX_FRAME_BYTES)
        self._socket.setsockopt(zmq.IPV6, int(":" in host))
        # The monitor reports a disconnection immediately. Without it, the request would wait until its deadline.
        self._monitor = self._socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self._answered_at = 0.0
        self._poller = zmq.Poller()
        self._poller.register(self._socket, zmq.POLLIN)
        self._poller.register(self._monitor, zmq.POLLIN)
        try:
            self._socket.connect(f"tcp://{self.where}")
        except zmq.ZMQError as error:
            self.close()
            raise ConnectionError(f"{self.where}: {error}") from error

    def ask(self, frame: bytes, timeout_s: float) -> bytes:
        """Send a request of one frame and return the answer, which must also be one frame.

        Raises OSError if no answer arrives in time, or if the server disconnects or sends an unexpected message. Raises
        PolicyError if the answer does not consist of one frame.
        """
        deadline = time.monotonic() + timeout_s
        with self._busy:
            try:
                # If the server has sent a second answer to the last request, it would be mistaken for the answer to
                # this request.
                settled = self._answered_at + _SETTLE_S - time.monotonic()
                if self._socket.poll(max(0, math.ceil(1000.0 * settled))):
                    raise ConnectionError("the server sent an unexpected answer")
                self._socket.send_multipart([b"", frame])
                self._wait(deadline, timeout_s)
                empty, *parts = self._socket.recv_multipart()
                self._answered_at = time.monotonic()
            except zmq.ZMQError as error:
                raise ConnectionError(str(error)) from error
            finally:
                if self._ended.is_set():
                    self._destroy()
        if empty or len(parts) != 1:
            raise PolicyError(
                f"the server sent {len(parts)} frames instead of one. Check that both sides use the same protocol."
            )
        return parts[0]

    def _wait(self, deadline: float, timeout_s: float) -> None:
        """Wait until an answer has arrived, the connection is closed, or the deadline has passed."""
        while True:
            left = deadline - time.monotonic()
            ready = dict(self._poller.poll(max(0, math.ceil(1000.0 * min(left, _GLANCE_S)))))
            if self._socket in ready:
                return
            if self._ended.is_set():
                raise ConnectionError("the connection was closed on this side")
            if self._monitor in ready:
                # ZeroMQ also closes the connection if an answer is too large, and gives no reason.
                raise ConnectionError(
                    f"the server closed the connection, or its answer exceeds {MAX_FRAME_BYTES} bytes"
                )
            if left <= 0.0:
                raise TimeoutError(f"no answer within {timeout_s:.3g} s")

    def close(self) -> None:
        """Close the socket. Further calls have no effect.

        ZeroMQ sockets are not thread-safe. If another thread is waiting for an answer, that thread stops waiting and
        closes the socket.
        """
        self._ended.set()
        if self._busy.acquire(timeout=10.0 * _GLANCE_S):
            try:
                self._destroy()
            finally:
                self._busy.release()

    def _destroy(self) -> None:
        if self._socket.closed:
            return
        with contextlib.suppress(zmq.ZMQError):
            self._socket.disable_monitor()
        self._monitor.close(linger=0)
        self._socket.close(linger=0)
        self._context.term()
