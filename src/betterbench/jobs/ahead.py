"""Prefetching of an iterator's items in a thread."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Generic, TypeVar

ItemT = TypeVar("ItemT")

_PATIENCE_S = 0.2


class _End:
    """Marks the end of the prefetching queue.

    It contains the error that the iterator raised, or None if there was no error.
    """

    def __init__(self, error: BaseException | None) -> None:
        self.error = error


class _Ahead(Generic[ItemT]):
    def __init__(self, items: Iterator[ItemT], most: int) -> None:
        self._items, self._queue = items, queue.Queue[ItemT | _End](most)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._take, daemon=True)
        self._thread.start()

    def _take(self) -> None:
        error: BaseException | None = None
        try:
            for item in self._items:
                if not self._put(item):
                    return
        except BaseException as problem:  # noqa: BLE001 - raised again in the thread that uses the items
            error = problem
        self._put(_End(error))

    def _put(self, item: ItemT | _End) -> bool:
        while not self._stopped.is_set():
            try:
                self._queue.put(item, timeout=_PATIENCE_S)
            except queue.Full:
                continue
            return True
        return False

    def __iter__(self) -> Iterator[ItemT]:
        while not isinstance(item := self._queue.get(), _End):
            yield item
        if item.error is not None:
            raise item.error

    def close(self) -> None:
        self._stopped.set()
        self._thread.join()


@contextmanager
def ahead(items: Iterator[ItemT], most: int) -> Iterator[Iterator[ItemT]]:
    """Context manager that prefetches up to ``most`` items of an iterator in a thread.

    It returns an iterator over the items. If the original iterator raises an error in the thread, the returned iterator
    raises the same error. When the context manager exits, the thread finishes its current item and stops.
    """
    with closing(_Ahead(items, max(1, most))) as taken:
        yield iter(taken)
