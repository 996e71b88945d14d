"""Servers of the benchmarks, each in a separate process."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def serving(serve: Callable[..., None], *arguments: float) -> Iterator[Any]:
    """Run a server in a process until the end of the context, and give its first message, such as its address.

    Args:
        serve: Function of the server, called with the arguments and the connection to which it sends.
        arguments: Its arguments.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=serve, args=(*arguments, theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        yield ours.recv()
    finally:
        process.kill()
        process.join()
        ours.close()
