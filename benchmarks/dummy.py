"""A policy server that only waits, so that the rest of a run's wall time is spent by betterbench."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import zmq

from betterbench.policies.protocols.wire import decode_gr00t, encode_gr00t
from betterbench.policies.serving.server import PolicyServer
from own_process import serving

CHUNK = 8
"""Number of actions in an answer."""

_HOLDING = (0.0, 0.0, 0.0, 0.0, -1.0)


class _Idle:
    """Answers the requests of one connection after a delay."""

    def __init__(self, latency_s: float, places: threading.Semaphore) -> None:
        self._latency_s, self._places = latency_s, places

    def answer(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return a chunk of small motions."""
        step = float(np.asarray(request["better/step"]))
        with self._places:
            time.sleep(self._latency_s)
        return {"actions": np.tile([0.2 * np.sin(0.1 * step), 0.2 * np.cos(0.1 * step), *_HOLDING], (CHUNK, 1))}

    def close(self) -> None:
        """Forget the connection."""


@contextmanager
def dummy_server(latency_s: float, *, concurrency: int) -> Iterator[str]:
    """Serve openpi's protocol in a separate process, and give the address with its preset.

    Args:
        latency_s: Time that an answer takes [s].
        concurrency: Number of requests that are answered simultaneously; the others wait.
    """
    with serving(_serve, latency_s, concurrency) as address:
        yield f"{address}?preset=native"


@contextmanager
def dummy_gr00t_server(latency_s: float) -> Iterator[str]:
    """Serve GR00T's protocol in the same way.

    As in GR00T's own server, calls are answered one by one, each with any number of observations.
    """
    with serving(_serve_gr00t, latency_s) as address:
        yield address


def _serve(latency_s: float, concurrency: int, answer: Connection) -> None:
    places = threading.Semaphore(concurrency)
    with PolicyServer(lambda: _Idle(latency_s, places), metadata={}, port=0) as server:
        answer.send(server.address)
        threading.Event().wait()


def _serve_gr00t(latency_s: float, answer: Connection) -> None:
    socket = zmq.Context.instance().socket(zmq.REP)
    answer.send(f"gr00t://127.0.0.1:{socket.bind_to_random_port('tcp://127.0.0.1')}")
    while True:
        question = decode_gr00t(socket.recv())
        if question["endpoint"] != "get_action":
            socket.send(encode_gr00t({}))  # declares nothing
            continue
        count = len(question["data"]["observation"]["video"]["front"])
        time.sleep(latency_s)
        socket.send(encode_gr00t([_chunks(count), {}]))


def _chunks(count: int) -> dict[str, np.ndarray]:
    """Return chunks of small motions for ``count`` environments: float32 arrays (count, CHUNK, size)."""
    moves = {"ee_position": (0.1, 0.1, 0.0), "ee_rotation": (0.0, 0.0, 0.0), "gripper": (-1.0,)}
    return {name: np.tile(np.asarray(move, np.float32), (count, CHUNK, 1)) for name, move in moves.items()}
