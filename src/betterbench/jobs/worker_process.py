"""Start of worker processes of a run or a certification: signals, number of threads, and end with their parent."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterable, Iterator

from betterbench.errors import line_start
from betterbench.jobs.lock import HeldFolder, write_within


@contextlib.contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C in this thread inside the context, and permanently in processes started there."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def prepare_process(held: Iterable[HeldFolder] = ()) -> None:
    """Limit numerical libraries and the software renderer to one thread each, and end with the parent process.

    The log level is that of ``BETTERBENCH_LOG_LEVEL``, set by ``--log-level``. Nothing is written below folders locked
    by the parent (``held``) once they no longer exist.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    os.environ.setdefault("LP_NUM_THREADS", "0")
    logging.basicConfig(format=f"{line_start(sys.stderr)}%(message)s")
    level = os.environ.get("BETTERBENCH_LOG_LEVEL", "WARNING")
    logging.getLogger("betterbench").setLevel(logging.getLevelNamesMapping().get(level, logging.WARNING))
    write_within(held)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when the run is killed, so that it cannot write to a resumed run."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
