"""Limit on the total memory for the messages of all clients of a server.

The websocket library stores the received part of a message until the message is complete. The maximum message size
limits the memory of each connection, and this budget limits the memory of all connections together. When the budget is
used up, connections stop receiving data, which also stops their clients from sending. One connection may always
continue, so that at least one message can be completed. While other connections are waiting, a connection that does not
finish its message in time is dropped.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections import deque

BUDGET_BYTES = 128 * 1024 * 1024
"""Memory for the incomplete and unanswered messages of all clients [bytes]. One message may exceed this limit."""
STUCK_S = 5.0
"""Maximum time to wait for the rest of a message or of the opening HTTP request, while other connections wait [s]."""

_POLL_S = 0.05
_MAX_HEAD = 65_536
_CONTROL = 8


class MessageMeter:
    """Counter of the bytes that a connection holds in memory. It parses the opening HTTP request and websocket frames.

    Attributes:
        unfinished: Number of bytes received of the current message.
        queued: Sizes of the complete messages that have not been answered [bytes].
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
        """Whether the connection is in the middle of the opening request, a frame header or a message."""
        return not self.is_greeted or self.unfinished > 0 or bool(self._head) or self._in_frame

    def feed(self, data: bytes) -> bool:
        """Count received data. Return whether they complete the opening request or a message."""
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
        """Stop counting the oldest complete message, which has been answered."""
        if self.queued:
            self.queued.popleft()

    def _read_head(self, data: bytes, at: int) -> int:
        """Parse the header of a frame, which may be split over several calls. Return the offset of the next byte."""
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
    """Connection whose messages count toward the memory budget.

    Attributes:
        waited_s: Time spent waiting for data of the current message, without the current wait [s].
        waits_since: Time at which the current wait for data began [s], as measured by ``time.monotonic``. None if the
            connection is not waiting for data.
        is_cut: Whether the budget has dropped the connection.
    """

    def __init__(self, connection: socket.socket, number: int) -> None:
        self.connection, self.number = connection, number
        self.meter = MessageMeter()
        self.waited_s, self.is_cut = 0.0, False
        self.waits_since: float | None = None

    def within_s(self, now: float) -> float:
        """Return the total time spent waiting for data of the current message [s]."""
        if not self.meter.is_within:
            return 0.0
        return self.waited_s + (0.0 if self.waits_since is None else now - self.waits_since)


class FrameBudget:
    """Memory budget shared by all connections of a server. Its methods are thread-safe."""

    def __init__(self, most_bytes: int = BUDGET_BYTES, *, stuck_s: float = STUCK_S) -> None:
        self._most, self._stuck_s = most_bytes, stuck_s
        self._lock = threading.Condition()
        self._open: dict[int, Metered] = {}
        self._made, self._is_over = 0, False

    @property
    def held(self) -> int:
        """Number of bytes in memory for all connections together."""
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
        """Wait until the budget allows a connection to receive more data."""
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
        """Stop counting the oldest complete message of a connection, which has been answered."""
        with self._lock:
            one.meter.taken()
            self._lock.notify_all()

    def cut_stuck(self) -> None:
        """Drop connections that have not finished a message in time. Call this while other connections are waiting."""
        with self._lock:
            self._cut_stuck(time.monotonic())

    @property
    def is_dropping(self) -> bool:
        """Whether a connection has been dropped but not yet closed."""
        with self._lock:
            return any(one.is_cut for one in self._open.values())

    def stop(self) -> None:
        """Let all waiting connections continue, so that the server can stop."""
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
