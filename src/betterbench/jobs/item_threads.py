"""Many items, such as the trials of a run, over threads that each keep a resource, such as a drawing process."""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from typing import Generic, Protocol, TypeVar

from betterbench.errors import require_between

MOST_THREADS = 256


class Stoppable(Protocol):
    """A resource of a thread."""

    def stop(self) -> None:
        """Let whatever waits for the resource, in any thread, end soon with an error."""


class NoResource(AbstractContextManager["NoResource"]):
    """Resource of a thread whose work needs none."""

    def stop(self) -> None:
        """Do nothing."""

    def __exit__(self, *_: object) -> None:
        """Do nothing."""


WorkT = TypeVar("WorkT")
FoundT = TypeVar("FoundT")
ResourceT = TypeVar("ResourceT", bound=Stoppable)


def in_threads(
    items: Iterable[WorkT],
    work: Callable[[ResourceT, WorkT], FoundT],
    *,
    workers: int,
    open_resource: Callable[[], AbstractContextManager[ResourceT]],
    in_order: bool = False,
) -> Iterator[FoundT]:
    """Yield the result of each item; items are begun in the order given.

    What is left behind must not depend on the number of workers. After an error, after Ctrl-C, or when the iterator is
    closed, no further item is begun, the resources are stopped, and the first error is raised when all threads have
    ended.

    Args:
        items: The items.
        work: Works on one item with the resource of its thread.
        workers: Number of threads.
        open_resource: Opens the resource of a thread.
        in_order: Yield results in the order of the items, and begin at most ``workers`` items beyond the last one.

    Raises:
        InvalidInputError: If the number of workers is out of range.
    """
    require_between("--workers", workers, 1, MOST_THREADS)
    threads = _Threads(items, work, open_resource, ahead=workers if in_order else None)
    due, early = 0, dict[int, FoundT]()
    with ThreadPoolExecutor(workers) as pool:
        try:
            for number, found in threads.results(pool, workers):
                if not in_order:
                    yield found
                    continue
                early[number] = found
                while due in early:
                    yield early.pop(due)
                    due += 1
                    threads.room.release()
        finally:
            threads.stop()
    if threads.problems:
        raise threads.problems[0]


class _Threads(Generic[ResourceT, WorkT, FoundT]):
    """Threads that work on numbered items, ``ahead`` at most beyond those for which ``room`` was released."""

    def __init__(
        self,
        items: Iterable[WorkT],
        work: Callable[[ResourceT, WorkT], FoundT],
        open_resource: Callable[[], AbstractContextManager[ResourceT]],
        *,
        ahead: int | None,
    ) -> None:
        self._waiting, self._lock = deque(enumerate(items)), threading.Lock()
        self._work, self._open = work, open_resource
        self._ended: queue.SimpleQueue[tuple[int, FoundT] | None] = queue.SimpleQueue()  # None is a thread's end
        self._resources: list[ResourceT] = []
        self.room = threading.Semaphore(len(self._waiting) + MOST_THREADS if ahead is None else ahead)
        self.problems: list[BaseException] = []

    def results(self, pool: ThreadPoolExecutor, workers: int) -> Iterator[tuple[int, FoundT]]:
        """Yield numbers and results as they come, until all threads have ended or one has failed."""
        running = min(workers, len(self._waiting))
        for _ in range(running):
            pool.submit(self._run)
        while running:
            if (told := self._ended.get()) is not None:
                yield told
            elif self.problems:
                return
            else:
                running -= 1

    def stop(self) -> None:
        """Begin no further item, and stop the resources."""
        with self._lock:
            self._waiting.clear()
            for resource in self._resources:
                resource.stop()
        self.room.release(MOST_THREADS)

    def _run(self) -> None:
        try:
            with self._open() as resource:
                with self._lock:
                    self._resources.append(resource)
                while (taken := self._take()) is not None:
                    self._ended.put((taken[0], self._work(resource, taken[1])))
                with self._lock:
                    self._resources.remove(resource)
        except BaseException as problem:  # noqa: BLE001 - it is raised where the results are used
            self.problems.append(problem)
        finally:
            self._ended.put(None)

    def _take(self) -> tuple[int, WorkT] | None:
        self.room.acquire()
        with self._lock:
            return self._waiting.popleft() if self._waiting else None
