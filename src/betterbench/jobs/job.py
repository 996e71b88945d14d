"""Resumable jobs: process the unfinished items of a plan, and store each result immediately."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from betterbench.jobs.durable import on_disk, remove_parts
from betterbench.jobs.lock import LOCK_NAME, RunLock

ItemT = TypeVar("ItemT", bound=Hashable)
FoundT = TypeVar("FoundT")

OnCount = Callable[[int, int], None]
"""Function that is called with the number of finished items and the number of all items."""


@dataclass(frozen=True, slots=True)
class JobProgress(Generic[FoundT]):
    """Progress of a job: the numbers of finished and planned items, and the last result (None if there is none yet)."""

    done: int
    planned: int
    last: FoundT | None


def run_items(
    planned: Iterable[ItemT],
    *,
    is_done: Callable[[ItemT], bool],
    work: Callable[[list[ItemT]], Iterable[FoundT]],
    keep: Callable[[FoundT], object] = lambda _: None,
    on_progress: Callable[[JobProgress[FoundT]], None] | None = None,
) -> int:
    """Process the unfinished items of a job, and return their number. Call it again to continue an interrupted job.

    Args:
        planned: Items of the job. Repeated items are processed only once.
        is_done: Function that returns whether the result of an item is already stored.
        work: Function that yields the results of items in any order: ``in_processes``, ``in_threads``, or a generator.
        keep: Function that stores a result on disk, for example in a journal.
        on_progress: Function that is called at the start and after every result.
    """
    items = dict.fromkeys(planned)
    waiting = [item for item in items if not is_done(item)]
    done = len(items) - len(waiting)
    results = iter(work(waiting))
    try:
        if on_progress is not None:
            on_progress(JobProgress(done, len(items), None))
        for found in results:
            keep(found)
            done += 1
            if on_progress is not None:
                on_progress(JobProgress(done, len(items), found))
    finally:
        if (close := getattr(results, "close", None)) is not None:  # stops processes and threads immediately
            close()
    return len(waiting)


def counts(on_count: OnCount | None) -> Callable[[JobProgress[Any]], None] | None:
    """Return a callback for :func:`run_items` that passes the numbers of finished and planned items to ``on_count``."""
    return None if on_count is None else lambda progress: on_count(progress.done, progress.planned)


@contextmanager
def job_folder(path: Path, *, waits: bool = False) -> Iterator[None]:
    """Context manager that locks the folder of a job and removes unfinished files that killed processes left behind.

    Args:
        path: Folder of the job. It is created if it is missing.
        waits: Whether to wait if another process holds the lock.

    Raises:
        RunConflictError: If another process holds the lock and ``waits`` is False.
        StorageError: If the disk is full or write-protected, or if the folder was removed or moved before the context
            manager exits.
    """
    with on_disk(path):
        lock = RunLock(path / LOCK_NAME, waits=waits)
    with lock:
        remove_parts(path)
        yield
        lock.require_in_place()
