"""Processing of many items, such as trials, in threads that each own a resource, such as a renderer."""

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
    """A resource of a thread."""

    def stop(self) -> None:
        """Let threads that wait for the resource fail soon with an error."""


class NoResource(AbstractContextManager["NoResource"]):
    """Empty resource."""

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
    """Yield the result of each item. Items are started in order, at most ``workers`` at a time.

    After an error, after Ctrl-C, or when the iterator is closed, no further item is started, the resources are stopped,
    and the error is raised after all threads have ended. The finished items then do not depend on the number of
    workers.

    Args:
        items: The items.
        work: Function that processes an item with the resource of its thread.
        workers: Number of threads.
        open_resource: Function that opens the resource of a thread.
        in_order: Yield results in item order instead of completion order.

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
            if stopped.is_set():  # failed while opening the resource
                own.resource.stop()
        return work(own.resource, item)

    with ExitStack() as closing, ThreadPoolExecutor(workers) as pool:
        try:
            while True:
                pending += [pool.submit(run, item) for item in itertools.islice(waiting, workers - len(pending))]
                if not pending:
                    return
                done = {future for future in pending if future.done()}
                for future in done:
                    future.result()  # raises the error of an item
                ended = next((f for f in (pending[:1] if in_order else pending) if f in done), None)
                if ended is None:
                    wait([future for future in pending if future not in done], return_when=FIRST_COMPLETED)
                else:
                    pending.remove(ended)
                    yield ended.result()
        except BaseException:  # an error, Ctrl-C, or the iterator is closed
            stopped.set()
            for future in pending:
                future.cancel()
            with lock:
                for resource in resources:
                    resource.stop()
            raise
