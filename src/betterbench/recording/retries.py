"""The retry ledger: what is left to do, which workers died while they did it, and when to give up."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Hashable, Iterable, Sequence
from typing import Generic, TypeVar

from betterbench.errors import WorkerError

MAX_DEATHS = 3
"""How many workers may die with one item before the item is given up; from the second time on it runs alone."""

MAX_DEATHS_IN_A_ROW = 12
"""How many workers may die, with no item ended in between, before the whole work is given up."""

Item = TypeVar("Item", bound=Hashable)


class RetryLedger(Generic[Item]):
    """The items that no worker holds, and the deaths of workers so far.

    Whoever distributes work takes items from the ledger and reports what became of them. The items of a worker that
    died are suspects: each is done again alone, so that the one that kills its worker takes no other item along.
    """

    def __init__(self, items: Iterable[Item], *, workers: str, cure: str) -> None:
        """Begin with all items waiting.

        Args:
            items: What is to be done, in order.
            workers: What to call the workers in messages ("worker processes").
            cure: What to do when workers keep dying, a sentence for the error message.
        """
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
        """Number of items that have to be done alone."""
        return len(self._suspects)

    @property
    def left(self) -> int:
        """Number of all items that no worker holds."""
        return len(self._waiting) + len(self._suspects)

    def take(self, count: int) -> list[Item]:
        """Return up to so many waiting items; they belong to a worker now."""
        return [self._waiting.popleft() for _ in range(min(count, len(self._waiting)))]

    def take_suspect(self) -> Item:
        """Return an item for a worker that holds nothing and gets nothing else until this one has ended."""
        return self._suspects.popleft()

    def put_back(self, items: Iterable[Item]) -> None:
        """Queue items again, before all others, that no worker died of."""
        self._waiting.extendleft(reversed(list(items)))

    def item_ended(self) -> None:
        """Note that a worker has brought an item to its end."""
        self._in_a_row = 0

    def worker_died(self, items: Sequence[Item], how: str) -> list[Item]:
        """Queue the items of a worker that died again, each to be done alone.

        Args:
            items: What the worker held.
            how: How it died, for messages.

        Returns:
            The items that are given up, because workers died with them too often.

        Raises:
            WorkerError: If too many workers died one after the other.
        """
        self._in_a_row += 1
        self._deaths.update(items)
        given_up = [item for item in items if self._deaths[item] >= MAX_DEATHS]
        self._suspects.extend(item for item in items if item not in given_up)
        if given_up:
            self._in_a_row = 0
        if self._in_a_row >= MAX_DEATHS_IN_A_ROW:
            raise WorkerError(f"{self._in_a_row} {self._workers} died one after the other ({how}). {self._cure}")
        return given_up

    def reason(self, how: str) -> str:
        """Return why an item was given up, in one line."""
        return f"{MAX_DEATHS} {self._workers} died while they ran it, the last one by {how}; run the same command again to retry it"
