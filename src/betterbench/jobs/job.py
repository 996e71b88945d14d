"""Resumable jobs: the items of a plan that are not done yet are worked on, and each result is kept as it comes."""

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
"""Called with the number of items that are done and the number of all."""


@dataclass(frozen=True, slots=True)
class JobProgress(Generic[FoundT]):
    """Progress of a job: items that are done, items planned, and the last result (None at the start)."""

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
    """Work on the items that are not done, and return their number; the same call after an interruption goes on.

    Args:
        planned: The items of the job; each is worked on once.
        is_done: Tells whether a journal or a file already has the result of an item.
        work: Returns the results of the items that are not done, in any order and as they come: ``in_processes``,
            ``in_threads``, or a generator in this thread.
        keep: Stores a result durably, as a journal does.
        on_progress: Called at the start and after every result.
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
        if (close := getattr(results, "close", None)) is not None:  # end processes and threads at once
            close()
    return len(waiting)


def counts(on_count: OnCount | None) -> Callable[[JobProgress[Any]], None] | None:
    """Return a callback for :func:`run_items` that passes on the two numbers alone."""
    return None if on_count is None else lambda progress: on_count(progress.done, progress.planned)


@contextmanager
def job_folder(path: Path, *, waits: bool = False) -> Iterator[None]:
    """Hold the lock of a job's folder, after removing what killed processes left half-written in it.

    Args:
        path: The folder; made if it is missing.
        waits: Wait for another process that holds the lock.

    Raises:
        RunConflictError: If another process holds the lock, unless this one waits.
        StorageError: If the disk is full or protected, or, at a good end, if the folder was removed or moved meanwhile.
    """
    with on_disk(path):
        lock = RunLock(path / LOCK_NAME, waits=waits)
    with lock:
        remove_parts(path)
        yield
        lock.require_in_place()
