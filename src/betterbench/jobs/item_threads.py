"""Processing of many items, such as the trials of a run, in threads with a resource each, such as a renderer."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager
from typing import Protocol, TypeVar

from betterbench.errors import require_between

MOST_THREADS = 256


class Stoppable(Protocol):
    """A resource of a thread."""

    def stop(self) -> None:
        """Make any thread that waits for the resource end soon with an error."""


WorkT = TypeVar("WorkT")
ResourceT = TypeVar("ResourceT", bound=Stoppable)


def in_threads(
    items: Iterable[WorkT],
    work: Callable[[ResourceT, WorkT], None],
    *,
    workers: int,
    open_resource: Callable[[], AbstractContextManager[ResourceT]],
    on_done: Callable[[WorkT], None],
) -> None:
    """Process each item once, in the given order; the results must not depend on the number of workers.

    After an error, or Ctrl-C, no further item is started, the resources are stopped, and the first error is raised when
    all threads have ended. ``on_done`` is called after each item, by one thread at a time.

    Raises InvalidInputError if the number of workers is out of range.
    """
    require_between("--workers", workers, 1, MOST_THREADS)
    waiting, lock = deque(items), threading.Lock()
    resources: list[ResourceT] = []
    problems: list[BaseException] = []

    def stop() -> None:
        with lock:
            waiting.clear()
            for resource in resources:
                resource.stop()

    def take() -> tuple[WorkT] | None:
        with lock:
            return (waiting.popleft(),) if waiting else None

    def run() -> None:
        try:
            with open_resource() as resource:
                with lock:
                    resources.append(resource)
                while (taken := take()) is not None:
                    work(resource, *taken)
                    with lock:
                        on_done(*taken)
        except BaseException as problem:
            with lock:
                problems.append(problem)
            raise

    with ThreadPoolExecutor(max(1, min(workers, len(waiting)))) as pool:
        futures = [pool.submit(run) for _ in range(min(workers, len(waiting)))]
        try:
            wait(futures, return_when=FIRST_EXCEPTION)
        finally:
            if any(not future.done() for future in futures) or problems:
                stop()
    if problems:
        raise problems[0]
