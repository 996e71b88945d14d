"""A server of openpi's protocol that misbehaves on demand, written from the protocol's facts, not from our client."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Self

import msgpack
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

CHUNK = 8
"""Actions of a right answer."""

LATE_S = 1.5
"""How long a late answer takes; more than the deadline that the tests give [s]."""


def packed(form: object) -> bytes:
    """Returns a frame; arrays are maps with bytes as keys."""

    def code(value: object) -> object:
        if isinstance(value, np.ndarray):
            return {
                b"__ndarray__": True,
                b"data": value.tobytes(),
                b"dtype": value.dtype.str,
                b"shape": value.shape,
            }
        raise TypeError(type(value).__name__)

    return msgpack.packb(form, default=code)


def right_answer(episode: int, step: int) -> np.ndarray:
    """Returns what a well-behaved server answers: a function of trial and step, so that records can be compared."""
    draw = np.random.default_rng([episode, step])
    return np.hstack([draw.uniform(-1.0, 1.0, (CHUNK, 6)), -np.ones((CHUNK, 1))])


def _spoilt(change: Callable[[np.ndarray], object]) -> Callable[[np.ndarray], bytes]:
    return lambda actions: packed({"actions": change(actions)})


def _with(number: float) -> Callable[[np.ndarray], np.ndarray]:
    def change(actions: np.ndarray) -> np.ndarray:
        actions[6, 2] = number
        return actions

    return change


FRAMES: dict[str, Callable[[np.ndarray], bytes | str]] = {
    "nan": _spoilt(_with(np.nan)),
    "inf": _spoilt(_with(np.inf)),
    "wrong shape": _spoilt(lambda a: a[:, :6]),
    "three axes": _spoilt(lambda a: np.stack([a, a])),
    "wrong dtype": _spoilt(lambda a: a.astype(complex)),
    "texts": _spoilt(lambda a: a.astype("U8")),
    "out of range": _spoilt(lambda a: 3.0 * np.sign(a)),
    "empty chunk": _spoilt(lambda a: a[:0]),
    "no actions": lambda _: packed({"observation": 1}),
    "no map": lambda _: packed([1, 2, 3]),
    "garbage": lambda _: b"\xc1\xff\x00 what is this",
    "an array that lies": lambda a: packed(
        {"actions": {b"__ndarray__": True, b"data": a.tobytes()[:-9], b"dtype": "<f8", b"shape": a.shape}}
    ),
    "an error": lambda _: "Traceback (most recent call last):\nRuntimeError: CUDA out of memory",
}
"""Replies that are wrong, by name; a text is a text frame, which is an error in the protocol."""

BREAKS = ("drop", "half a frame", "late", "oversized")
"""Faults of the connection itself."""

Script = Callable[[dict[str, Any], int], str | None]
"""``script(request, number)`` names the fault of a request, or None; requests are counted from 0."""


@dataclass
class Misbehaving:
    """The server; a context manager. It can be stopped and started again at the same port."""

    script: Script
    port: int = 0
    requests: int = 0
    faults: list[str] = field(default_factory=list)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def address(self) -> str:
        return f"openpi://127.0.0.1:{self.port}?preset=native&timeout=0.7&retries=3&patience=20"

    def start(self) -> None:
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._open: set[ServerConnection] = set()
        listening = socket.create_server(("127.0.0.1", self.port))
        self.port = listening.getsockname()[1]
        self._server = serve(
            self._converse, sock=listening, compression=None, max_size=None, ping_interval=None, close_timeout=0.5
        )
        self._thread = threading.Thread(target=self._server.serve_forever, name="misbehaving")
        self._thread.start()

    def stop(self) -> None:
        self._ending.set()
        self._server.shutdown()
        self._thread.join()
        with self._lock:
            left = list(self._open)
        for connection in left:
            self._cut(connection)
        until = threading.Event()
        for _ in range(200):
            if not self._open:
                return
            until.wait(0.02)
        raise AssertionError("a connection is still open")

    def restart(self) -> None:
        self.stop()
        self.start()

    def _converse(self, connection: ServerConnection) -> None:
        with self._lock:
            self._open.add(connection)
        try:
            connection.send(packed({}))
            for frame in connection:
                self._reply(connection, frame)
        except (ConnectionClosed, OSError):
            pass
        finally:
            with self._lock:
                self._open.discard(connection)

    def _reply(self, connection: ServerConnection, frame: str | bytes) -> None:
        request = msgpack.unpackb(frame)
        with self._lock:
            fault = self.script(request, self.requests)
            self.requests += 1
            if fault is not None:
                self.faults.append(fault)
        actions = right_answer(request["better/episode"]["episode"], request["better/step"])
        if fault in FRAMES:
            connection.send(FRAMES[fault](actions))
            return
        reply = packed({"actions": actions})
        if fault == "late":
            self._ending.wait(LATE_S)
        elif fault == "drop":
            self._cut(connection)
        elif fault == "half a frame":
            connection.socket.sendall(b"\x82\x7e" + len(reply).to_bytes(2, "big") + reply[: len(reply) // 2])
            self._cut(connection)
        elif fault == "oversized":
            connection.socket.sendall(b"\x82\x7f" + (1 << 40).to_bytes(8, "big") + reply)
            self._cut(connection)
        if fault in (None, "late"):
            connection.send(reply)

    @staticmethod
    def _cut(connection: ServerConnection) -> None:
        """Ends a connection without a word."""
        with contextlib.suppress(OSError):
            connection.socket.shutdown(socket.SHUT_RDWR)
