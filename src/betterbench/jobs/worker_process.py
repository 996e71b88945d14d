"""Worker processes of a job: pipes, signals, thread counts, and their termination together with the parent process."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator

from betterbench.errors import line_start
from betterbench.jobs.lock import HeldFolder, write_within


class SpawnedProcess:
    """Child process with a pipe. It ignores Ctrl-C, which the parent process handles.

    Attributes:
        process: Handle of the child process.
        connection: The parent's end of the pipe.
    """

    def __init__(self, target: Callable[..., None], *args: object, name: str) -> None:
        """Start a process that calls ``target`` with the arguments and the child's end of the pipe."""
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=target, args=(*args, theirs), name=name)
        with interrupts_blocked():
            self.process.start()
        theirs.close()

    def end(self, within_s: float = 0.0) -> str:
        """Close the pipe, kill the process if it has not ended within the time limit [s], and describe how it ended."""
        self.connection.close()
        self.process.join(within_s)
        self.process.kill()
        self.process.join()
        return exit_text(self.process.exitcode)


def exit_text(status: int | None) -> str:
    """Describe the exit status of a process. A negative status is the number of the signal that ended the process."""
    if status is None or status >= 0:
        return f"exit status {status}"
    name = signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"
    return f"{name}, for example because memory ran out" if name == "SIGKILL" else name


@contextlib.contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Context manager that blocks Ctrl-C in this thread. Processes started inside it ignore Ctrl-C until they end."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def prepare_process(held: Iterable[HeldFolder] = ()) -> None:
    """Limit the libraries in a worker process to one thread, and make the process end with its parent.

    The log level is read from ``BETTERBENCH_LOG_LEVEL``, which ``--log-level`` sets. ``held`` contains the folders that
    the parent has locked. If one of them is removed, nothing more is written into it.
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
    """End this process as soon as the parent has ended, so that it does not write to a run that is resumed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
