"""Processing of many items, such as trials, in threads. Each thread has its own resource, such as a renderer."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, ExitStack
from typing import Protocol, TypeVar

from betterbench.errors import require_between

MOST_THREADS = 256


class Stoppable(Protocol):
    """Resource of a thread that can be stopped from another thread, such as a renderer."""

    def stop(self) -> None:
        """Interrupt threads that are waiting for the resource. They raise an error and end."""


class NoResource(AbstractContextManager["NoResource"]):
    """Placeholder for threads that do not need a resource."""

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
    ahead: int = 0,
) -> Iterator[FoundT]:
    """Process items in threads, and yield the result of each item.

    Items are started in order, and at most ``workers`` of them run at a time. After an error or Ctrl-C, or when the
    iterator is closed, no further item is started and the resources are stopped. The error is raised after all threads
    have ended. If ``in_order`` is True, all results before the first unfinished item are yielded before the error is
    raised.

    Args:
        items: Items to process.
        work: Function that processes an item with the resource of its thread.
        workers: Number of threads.
        open_resource: Function that opens the resource of a thread.
        in_order: Whether to yield results in the order of the items instead of the order in which they finish.
        ahead: Maximum number of results that may wait for an earlier item, so that other threads can continue while a
            slow item is processed.

    Raises:
        InvalidInputError: If the number of workers is out of range.
    """
    require_between("--workers", workers, 1, MOST_THREADS)
    own, lock, resources = threading.local(), threading.Lock(), list[ResourceT]()
    stopped = threading.Event()
    waiting, pending = iter(items), list[Future[FoundT]]()

    def run(item: WorkT) -> FoundT:
        if not hasattr(own, "resource"):
            opened = open_resource()
            own.resource = opened.__enter__()
            with lock:
                closing.push(opened)
                resources.append(own.resource)
            if stopped.is_set():  # another thread failed while this thread opened its resource
                own.resource.stop()
        return work(own.resource, item)

    with ExitStack() as closing, ThreadPoolExecutor(workers) as pool:
        try:
            pending += [pool.submit(run, item) for item in itertools.islice(waiting, workers + ahead)]
            while pending:
                done = [future.done() for future in pending]  # checked only once, because more items may finish
                failed = next((i for i, f in enumerate(pending) if done[i] and f.exception() is not None), None)
                if failed is not None and not (in_order and done[0] and failed > 0):
                    pending[failed].result()
                ended = next((i for i, is_done in enumerate(done[:1] if in_order else done) if is_done), None)
                if ended is not None:
                    yield pending.pop(ended).result()
                else:
                    wait(list(itertools.compress(pending, (not d for d in done))), return_when=FIRST_COMPLETED)
                if failed is None:
                    free = workers + ahead - len(pending)
                    pending += [pool.submit(run, item) for item in itertools.islice(waiting, free)]
        except BaseException:  # an error, Ctrl-C, or the iterator is closed
            stopped.set()
            for future in pending:
                future.cancel()
            with lock:
                for resource in resources:
                    resource.stop()
            raise
