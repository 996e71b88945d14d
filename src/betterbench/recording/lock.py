"""The lock that keeps two processes from writing to one run folder."""

from __future__ import annotations

import fcntl
import os
import time
import weakref
from pathlib import Path
from types import TracebackType
from typing import Self

from betterbench.errors import RunConflictError

_TRIES = 25
_PAUSE_S = 0.02  # somebody who asks whether a run is going holds the lock for less


def is_locked(path: Path) -> bool:
    """Tell whether a living process holds the lock of a run, without getting into its way.

    A lock that is held on another machine is seen where the file system shares locks.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(handle)
    return False


class RunLock:
    """An exclusive lock on a run folder that dies with the process that took it.

    The file stays; only the kernel's lock on it counts, so a crash leaves nothing to clean up. Processes forked while
    the lock is held do not keep it alive. Raises RunConflictError if somebody else holds the lock, unless it ``waits``.
    """

    def __init__(self, path: Path, *, waits: bool = False) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._handle: int | None = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            if waits:
                fcntl.flock(self._handle, fcntl.LOCK_EX)
            else:
                _lock_exclusively(self._handle)
        except OSError as error:
            holder = os.pread(self._handle, 20, 0).decode("ascii", "replace").strip() or "unknown"
            self._close()
            if not isinstance(error, BlockingIOError):
                raise
            raise RunConflictError(
                f"{path.parent}: another run (process {holder}) is writing here. Wait for it, or choose another folder."
            ) from error
        os.ftruncate(self._handle, 0)
        os.pwrite(self._handle, f"{os.getpid()}\n".encode("ascii"), 0)
        _HELD.add(self)

    def release(self) -> None:
        """Give the lock back; harmless when it is not held."""
        self._close()

    def _close(self) -> None:
        """Close the file, which releases the kernel's lock unless a parent process still holds it."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def _lock_exclusively(handle: int) -> None:
    """Take the lock, and try again a few times: a reader may just be asking whether it is held."""
    for left in reversed(range(_TRIES)):
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if not left:
                raise
            time.sleep(_PAUSE_S)
        else:
            return


_HELD: weakref.WeakSet[RunLock] = weakref.WeakSet()


def _forget_in_child() -> None:
    """Close inherited locks in a forked process; the parent keeps its own."""
    for lock in list(_HELD):
        lock.release()


os.register_at_fork(after_in_child=_forget_in_child)
