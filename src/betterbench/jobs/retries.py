"""Bookkeeping of retries: remaining items, items whose workers died, and limits."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Hashable, Iterable, Sequence
from typing import Generic, TypeVar

from betterbench.errors import WorkerError

MAX_DEATHS = 3
"""Number of worker deaths after which an item is abandoned. After the first death, the item runs alone."""

MAX_DEATHS_IN_A_ROW = 12
"""Number of consecutive worker deaths, without a finished item, after which the job ends with an error."""

Item = TypeVar("Item", bound=Hashable)


class RetryLedger(Generic[Item]):
    """Items without a worker, and worker deaths so far.

    The distributor of the work takes items from the ledger and reports results. The items of a dead worker are
    suspects: each of them is repeated alone, so that an item that kills its worker affects no other item.
    """

    def __init__(self, items: Iterable[Item], *, workers: str, cure: str) -> None:
        """Begin with all items waiting; ``workers`` ("worker processes") and ``cure`` are for the messages."""
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
        """Number of items that must run alone."""
        return len(self._suspects)

    @property
    def left(self) -> int:
        """Number of all items without a worker."""
        return len(self._waiting) + len(self._suspects)

    def take(self, count: int) -> list[Item]:
        """Return up to ``count`` waiting items for a worker."""
        return [self._waiting.popleft() for _ in range(min(count, len(self._waiting)))]

    def take_suspect(self) -> Item:
        """Return an item for an idle worker, which must not get another item until this one has ended."""
        return self._suspects.popleft()

    def put_back(self, items: Iterable[Item]) -> None:
        """Queue items again before all others, because their worker ended for another reason."""
        self._waiting.extendleft(reversed(list(items)))

    def item_ended(self) -> None:
        """Record that a worker has finished an item."""
        self._in_a_row = 0

    def worker_died(self, items: Sequence[Item], how: str) -> list[Item]:
        """Queue the items of a dead worker again, to run alone, and return the items with too many deaths.

        Raises WorkerError after too many consecutive deaths.
        """
        self._in_a_row += 1
        self._deaths.update(items)
        given_up = [item for item in items if self._deaths[item] >= MAX_DEATHS]
        self._suspects.extend(item for item in items if item not in given_up)
        if given_up:
            self._in_a_row = 0
        if self._in_a_row >= MAX_DEATHS_IN_A_ROW:
            raise WorkerError(f"{self._in_a_row} {self._workers} died in a row ({how}). {self._cure}")
        return given_up

    def reason(self, how: str) -> str:
        """Return the reason for giving up an item, in one line with the death of the last worker."""
        return f"{MAX_DEATHS} {self._workers} died while they ran it ({how}); run the same command again to retry it"
