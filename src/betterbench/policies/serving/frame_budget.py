"""Limit on the memory that messages of all clients of a server take, as long as they are unfinished or unanswered.

A websocket library stores the received part of a message until the message is complete. The limit on the message size
bounds the memory of each connection, and this budget bounds the memory of all connections together. If a connection
would exceed the budget, it waits, which stops its client from sending more data. The connection whose message began
first never waits, so at least one message can always be completed. While other connections wait, a connection that does
not finish a message in time is dropped.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections import deque

BUDGET_BYTES = 128 * 1024 * 1024
"""Memory for the unfinished and unanswered messages of all clients, in addition to one message [bytes]."""
STUCK_S = 5.0
"""Time that a connection may take to finish one message, or the request that opens it, while others wait [s]."""

_POLL_S = 0.05
_MAX_HEAD = 65_536
_CONTROL = 8


class MessageMeter:
    """Counter of the bytes that one connection receives: first an HTTP request, then websocket frames.

    Attributes:
        unfinished: Number of bytes received so far of the current message.
        queued: Size of each message that is complete but has not been answered yet [bytes].
    """

    def __init__(self) -> None:
        self.unfinished = 0
        self.queued: deque[int] = deque()
        self.is_greeted = False
        self._head = bytearray()
        self._left, self._in_frame, self._is_last, self._is_control = 0, False, False, False

    @property
    def held(self) -> int:
        """Number of bytes in memory for this connection."""
        return self.unfinished + len(self._head) + sum(self.queued)

    @property
    def is_within(self) -> bool:
        """Whether an opening request, a frame header or a message has been received only in part so far."""
        return not self.is_greeted or self.unfinished > 0 or bool(self._head) or self._in_frame

    def feed(self, data: bytes) -> bool:
        """Count received data. Return whether these data have completed the opening request or a message."""
        ended, at = False, 0
        if not self.is_greeted:
            self._head += data
            end = self._head.find(b"\r\n\r\n")
            if end < 0:
                del self._head[: max(0, len(self._head) - _MAX_HEAD)]
                return False
            data, self._head, self.is_greeted, ended = bytes(self._head[end + 4 :]), bytearray(), True, True
        while at < len(data):
            if not self._in_frame:
                at = self._read_head(data, at)
            if self._in_frame:
                taken = min(self._left, len(data) - at)
                at, self._left = at + taken, self._left - taken
                self.unfinished += 0 if self._is_control else taken
                if not self._left:
                    ended = self._end_frame() or ended
        return ended

    def taken(self) -> None:
        """Stop counting the oldest complete message, since it has been answered."""
        if self.queued:
            self.queued.popleft()

    def _read_head(self, data: bytes, at: int) -> int:
        """Continue to parse the header of a frame. Return the offset of the first byte that has not been read."""
        while at < len(data):
            self._head.append(data[at])
            at += 1
            head = self._head
            if len(head) < 2:
                continue
            size = head[1] & 0x7F
            more = {126: 2, 127: 8}.get(size, 0)
            if len(head) < 2 + more + (4 if head[1] & 0x80 else 0):
                continue
            self._left = int.from_bytes(head[2 : 2 + more], "big") if more else size
            self._is_last, self._is_control = bool(head[0] & 0x80), bool(head[0] & _CONTROL)
            self._in_frame = True
            self._head = bytearray()
            break
        return at

    def _end_frame(self) -> bool:
        self._in_frame = False
        if self._is_control or not self._is_last:
            return False
        self.queued.append(self.unfinished)
        self.unfinished = 0
        return True


class Metered:
    """Connection of a client whose messages count toward the memory budget.

    Attributes:
        waited_s: Time that has been spent waiting for the client during the current message [s].
        waits_since: Time at which the current wait for the client began [s], as measured by ``time.monotonic``, or
            None.
        is_cut: Whether the connection was dropped.
    """

    def __init__(self, connection: socket.socket, number: int) -> None:
        self.connection, self.number = connection, number
        self.meter = MessageMeter()
        self.waited_s, self.is_cut = 0.0, False
        self.waits_since: float | None = None

    def within_s(self, now: float) -> float:
        """Return how long the current message has been waiting for data from the client [s]."""
        if not self.meter.is_within:
            return 0.0
        return self.waited_s + (0.0 if self.waits_since is None else now - self.waits_since)


class FrameBudget:
    """Memory budget that all connections of a server share. The methods may be called from any thread."""

    def __init__(self, most_bytes: int = BUDGET_BYTES, *, stuck_s: float = STUCK_S) -> None:
        self._most, self._stuck_s = most_bytes, stuck_s
        self._lock = threading.Condition()
        self._open: dict[int, Metered] = {}
        self._made, self._is_over = 0, False

    @property
    def held(self) -> int:
        """Number of bytes in memory for all connections."""
        with self._lock:
            return self._held()

    def opened(self, connection: socket.socket) -> Metered:
        """Add a connection to the budget."""
        with self._lock:
            self._made += 1
            found = self._open[self._made] = Metered(connection, self._made)
            return found

    def closed(self, one: Metered) -> None:
        """Remove a connection from the budget."""
        with self._lock:
            self._open.pop(one.number, None)
            self._lock.notify_all()

    def before_receiving(self, one: Metered) -> None:
        """Wait until a connection may receive more data."""
        with self._lock:
            while not self._may_go_on(one):
                self._cut_stuck(time.monotonic())
                self._lock.wait(_POLL_S)
            one.waits_since = time.monotonic()

    def received(self, one: Metered, data: bytes) -> None:
        """Count data that a connection has received."""
        with self._lock:
            now = time.monotonic()
            one.waited_s += 0.0 if one.waits_since is None else now - one.waits_since
            one.waits_since = None
            was_within = one.meter.is_within
            if one.meter.feed(data) or not was_within:
                one.waited_s = 0.0
            self._lock.notify_all()

    def answered(self, one: Metered) -> None:
        """Stop counting the oldest complete message of a connection, since it has been answered."""
        with self._lock:
            one.meter.taken()
            self._lock.notify_all()

    def cut_stuck(self) -> None:
        """Drop connections that have not finished a message in time, if other connections are waiting."""
        with self._lock:
            self._cut_stuck(time.monotonic())

    @property
    def is_dropping(self) -> bool:
        """Whether there is a connection that was dropped but is not closed yet."""
        with self._lock:
            return any(one.is_cut for one in self._open.values())

    def stop(self) -> None:
        """Let all waiting connections continue. This is called when the server stops."""
        with self._lock:
            self._is_over = True
            self._lock.notify_all()

    def _held(self) -> int:
        return sum(one.meter.held for one in self._open.values())

    def _may_go_on(self, one: Metered) -> bool:
        if self._is_over or one.is_cut or one.number not in self._open or self._held() < self._most:
            return True
        within = [o.number for o in self._open.values() if o.meter.is_within and o.meter.is_greeted]
        return one.number == min(within, default=one.number)

    def _cut_stuck(self, now: float) -> None:
        for one in self._open.values():
            if not one.is_cut and one.within_s(now) > self._stuck_s:
                one.is_cut = True
                with contextlib.suppress(OSError):
                    one.connection.shutdown(socket.SHUT_RDWR)
