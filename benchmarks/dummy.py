"""A policy server that only waits: the rest of a run's wall time belongs to the benchmark."""

from __future__ import annotations

import multiprocessing
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from betterbench.policies.server import PolicyServer

CHUNK = 8
"""Actions of an answer."""


class _Idle:
    """Answers the questions of one connection after a while."""

    def __init__(self, latency_s: float, places: threading.Semaphore) -> None:
        self._latency_s, self._places = latency_s, places

    def answer(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return a chunk of small motions."""
        step = float(np.asarray(request["better/step"]))
        with self._places:
            time.sleep(self._latency_s)
        actions = np.tile([0.2 * np.sin(0.1 * step), 0.2 * np.cos(0.1 * step), 0.0, 0.0, 0.0, 0.0, -1.0], (CHUNK, 1))
        return {"actions": actions}

    def close(self) -> None:
        """Forget the connection."""


@contextmanager
def dummy_server(latency_s: float, *, concurrency: int) -> Iterator[str]:
    """Serve in a process of its own, and give the address.

    Args:
        latency_s: Time that an answer takes [s].
        concurrency: Answers that are under way at once; the others wait for their turn.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(latency_s, concurrency, theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        yield ours.recv()
    finally:
        process.kill()
        process.join()
        ours.close()


def _serve(latency_s: float, concurrency: int, answer: Connection) -> None:
    places = threading.Semaphore(concurrency)
    with PolicyServer(lambda: _Idle(latency_s, places), metadata={}, port=0) as server:
        answer.send(server.address)
        threading.Event().wait()
