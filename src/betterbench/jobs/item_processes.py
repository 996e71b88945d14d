"""Processing of many items in worker processes, with detection of items that crash their worker process."""

from __future__ import annotations

import logging
import multiprocessing
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from typing import TypeVar

from betterbench.errors import WorkerError
from betterbench.jobs.lock import held_folders
from betterbench.jobs.retries import RetryLedger
from betterbench.jobs.worker_process import interrupts_blocked, prepare_process

ItemT = TypeVar("ItemT", bound=Hashable)
FoundT = TypeVar("FoundT")

logger = logging.getLogger(__name__)


def in_processes(items: list[ItemT], work: Callable[[ItemT], FoundT], *, workers: int) -> Iterator[FoundT]:
    """Process items in worker processes, and yield each result when its item is finished.

    If a worker process dies, its unfinished items are retried one at a time.

    If there is only one worker or only one item, the items are processed in this process.

    Raises:
        WorkerError: If worker processes keep dying.
    """
    if workers == 1 or len(items) <= 1:
        yield from map(work, items)
        return
    cure = "Run the same command again with fewer --workers."
    ledger = RetryLedger(items, workers="worker processes", cure=cure)
    while ledger.left:
        pending: dict[Future[FoundT], ItemT] = {}
        try:
            yield from _pooled(ledger, pending, workers, work)
        except BrokenProcessPool as error:
            logger.warning("a worker process died; the %d items in progress are processed again", len(pending))
            how = "it was killed, for example because memory ran out"
            for item in ledger.worker_died(list(pending.values()), how):
                raise WorkerError(f"{item}: {ledger.reason(how)}.") from error


def _pooled(
    ledger: RetryLedger[ItemT],
    pending: dict[Future[FoundT], ItemT],
    workers: int,
    work: Callable[[ItemT], FoundT],
) -> Iterator[FoundT]:
    """Yield the results of one process pool.

    ``pending`` contains the items that the pool is processing. If a worker process died, the items that it was
    processing are suspects. As long as there are suspects, the pool processes only these, one at a time.
    """
    alone = ledger.suspects > 0
    context = multiprocessing.get_context("spawn")
    started: set[BaseProcess] = set()
    with ProcessPoolExecutor(
        1 if alone else workers, mp_context=context, initializer=prepare_process, initargs=(held_folders(),)
    ) as pool:
        try:
            while True:
                if not alone:
                    new = ledger.take(2 * workers - len(pending))
                else:
                    new = [ledger.take_suspect()] if ledger.suspects and not pending else []
                with interrupts_blocked():  # worker processes ignore Ctrl-C, which this process handles
                    others = set(multiprocessing.active_children()) - started
                    for item in new:
                        pending[pool.submit(work, item)] = item
                    started |= set(multiprocessing.active_children()) - others
                if not pending:
                    return
                finished, _ = wait(pending, return_when=FIRST_COMPLETED)
                for future in finished:
                    found = future.result()
                    del pending[future]
                    ledger.item_ended()
                    yield found
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in started:  # without this, Python would wait for their current items
                process.kill()
            raise
