"""Memory budget for a server, covering all its clients' unfinished and unanswered messages.

A websocket library keeps the received part of a message until the message is complete. The largest message bounds each
connection, and this budget bounds all connections together. A connection that would exceed the budget waits, which
stops its peer from sending more data. The connection whose message began first never waits, so at least one message is
always completed. While others wait, connections that do not finish a message in time are dropped.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections import deque

BUDGET_BYTES = 128 * 1024 * 1024
"""Budget for the unfinished and unanswered messages of all clients, in addition to one message [bytes]."""
STUCK_S = 5.0
"""Time limit for a connection to finish one message, or the request that opens it, while others wait [s]."""

_POLL_S = 0.05
_MAX_HEAD = 65_536
_CONTROL = 8


class MessageMeter:
    """Counter of the bytes received by one connection, which sends an HTTP request and then websocket frames.

    Only the headers of frames are read (RFC 6455, section 5.2).

    Attributes:
        unfinished: Bytes of the current message.
        queued: Bytes of each complete message that is still unanswered.
    """

    def __init__(self) -> None:
        self.unfinished = 0
        self.queued: deque[int] = deque()
        self.is_greeted = False
        self._head = bytearray()
        self._left, self._in_frame, self._is_last, self._is_control = 0, False, False, False

    @property
    def held(self) -> int:
        """Bytes in memory for the connection."""
        return self.unfinished + len(self._head) + sum(self.queued)

    @property
    def is_within(self) -> bool:
        """Whether a message, a frame header or the opening request is incomplete."""
        return not self.is_greeted or self.unfinished > 0 or bool(self._head) or self._in_frame

    def feed(self, data: bytes) -> bool:
        """Count received data, and return whether a message, or the request, is now complete."""
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
        """Remove the first complete message after its answer."""
        if self.queued:
            self.queued.popleft()

    def _read_head(self, data: bytes, at: int) -> int:
        """Continue reading the header of a frame, and return the offset after it."""
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
    """Connection in the budget.

    Attributes:
        waited_s: Time spent waiting for its peer within the current message [s].
        waits_since: Time at which the current wait began [s, monotonic], or None if there is no wait.
        is_cut: Whether the connection was dropped.
    """

    def __init__(self, connection: socket.socket, number: int) -> None:
        self.connection, self.number = connection, number
        self.meter = MessageMeter()
        self.waited_s, self.is_cut = 0.0, False
        self.waits_since: float | None = None

    def within_s(self, now: float) -> float:
        """Return the time that the current message has waited for its peer [s]."""
        if not self.meter.is_within:
            return 0.0
        return self.waited_s + (0.0 if self.waits_since is None else now - self.waits_since)


class FrameBudget:
    """Memory budget shared by all connections of a server. Methods may be called from any thread."""

    def __init__(self, most_bytes: int = BUDGET_BYTES, *, stuck_s: float = STUCK_S) -> None:
        self._most, self._stuck_s = most_bytes, stuck_s
        self._lock = threading.Condition()
        self._open: dict[int, Metered] = {}
        self._made, self._is_over = 0, False

    @property
    def held(self) -> int:
        """Bytes in memory for all connections."""
        with self._lock:
            return self._held()

    def opened(self, connection: socket.socket) -> Metered:
        """Add a connection."""
        with self._lock:
            self._made += 1
            found = self._open[self._made] = Metered(connection, self._made)
            return found

    def closed(self, one: Metered) -> None:
        """Remove a connection."""
        with self._lock:
            self._open.pop(one.number, None)
            self._lock.notify_all()

    def before_receiving(self, one: Metered) -> None:
        """Wait until a connection may receive more."""
        with self._lock:
            while not self._may_go_on(one):
                self._cut_stuck(time.monotonic())
                self._lock.wait(_POLL_S)
            one.waits_since = time.monotonic()

    def received(self, one: Metered, data: bytes) -> None:
        """Count data received by a connection."""
        with self._lock:
            now = time.monotonic()
            one.waited_s += 0.0 if one.waits_since is None else now - one.waits_since
            one.waits_since = None
            was_within = one.meter.is_within
            if one.meter.feed(data) or not was_within:
                one.waited_s = 0.0
            self._lock.notify_all()

    def answered(self, one: Metered) -> None:
        """Remove the first message of a connection after its answer."""
        with self._lock:
            one.meter.taken()
            self._lock.notify_all()

    def cut_stuck(self) -> None:
        """Drop connections that do not finish a message in time while others wait."""
        with self._lock:
            self._cut_stuck(time.monotonic())

    @property
    def is_dropping(self) -> bool:
        """Whether a dropped connection has not ended yet."""
        with self._lock:
            return any(one.is_cut for one in self._open.values())

    def stop(self) -> None:
        """End all waits."""
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
