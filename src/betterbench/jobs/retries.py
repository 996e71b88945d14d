"""Bookkeeping of retries: remaining items, items whose worker died, and the limits of retries."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Hashable, Iterable, Sequence
from typing import Generic, TypeVar

from betterbench.errors import WorkerError

MAX_DEATHS = 3
"""Number of worker deaths after which an item is not retried anymore. After the first death, the item is run alone."""

MAX_DEATHS_IN_A_ROW = 12
"""Number of consecutive worker deaths without a finished item after which the job fails."""

Item = TypeVar("Item", bound=Hashable)


class RetryLedger(Generic[Item]):
    """Items that are waiting for a worker, and a count of the workers that died.

    The pool of workers takes items from the ledger, and reports finished items and dead workers. The items of a dead
    worker become suspects. Each suspect is retried alone, so that an item that kills its worker does not affect other
    items.
    """

    def __init__(self, items: Iterable[Item], *, workers: str, cure: str) -> None:
        """Put all items in the queue. ``workers`` (such as "worker processes") and ``cure`` are used in messages."""
        self._workers, self._cure = workers, cure
        self._waiting = deque(items)
        self._suspects: deque[Item] = deque()
        self._deaths: Counter[Item] = Counter()
        self._in_a_row = 0

    @property
    def waiting(self) -> int:
        """Number of items that any worker may take."""
        return len(self._waiting)

    @property
    def suspects(self) -> int:
        """Number of suspects, i.e. items that must be run alone because their worker died."""
        return len(self._suspects)

    @property
    def left(self) -> int:
        """Total number of waiting items and suspects."""
        return len(self._waiting) + len(self._suspects)

    def take(self, count: int) -> list[Item]:
        """Remove up to ``count`` items from the queue and return them, for one worker."""
        return [self._waiting.popleft() for _ in range(min(count, len(self._waiting)))]

    def take_suspect(self) -> Item:
        """Remove a suspect and return it. Its worker must not get another item until this one is finished."""
        return self._suspects.popleft()

    def put_back(self, items: Iterable[Item]) -> None:
        """Put items back at the front of the queue. Use this if their worker ended for an unrelated reason."""
        self._waiting.extendleft(reversed(list(items)))

    def item_ended(self) -> None:
        """Record that a worker has finished an item."""
        self._in_a_row = 0

    def worker_died(self, items: Sequence[Item], how: str) -> list[Item]:
        """Add the items of a dead worker to the suspects, and return the items that will not be retried.

        Raises WorkerError after too many consecutive deaths.
        """
        self._in_a_row += 1
        self._deaths.update(items)
        given_up = [item for item in items if self._deaths[item] >= MAX_DEATHS]
        self._suspects.extend(item for item in items if item not in given_up)
        if given_up:
            self._in_a_row = 0
        if self._in_a_row >= MAX_DEATHS_IN_A_ROW:
            raise WorkerError(f"{self._in_a_row} {self._workers} died one after another ({how}). {self._cure}")
        return given_up

    def reason(self, how: str) -> str:
        """Return the reason an item will not be retried. ``how`` describes how the item's last worker ended."""
        return f"{MAX_DEATHS} {self._workers} died while running it ({how}); run the same command again to retry it"
