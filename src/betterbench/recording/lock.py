"""The lock that keeps two processes from writing to one run folder."""

from __future__ import annotations

import fcntl
import os
import weakref
from pathlib import Path
from types import TracebackType
from typing import Self

from betterbench.errors import RunConflictError


class RunLock:
    """An exclusive lock on a run folder that dies with the process that took it.

    The file stays; only the kernel's lock on it counts, so a crash leaves nothing to clean up. Processes forked while
    the lock is held do not keep it alive.

    Args:
        path: The lock file; it is made if missing.

    Raises:
        RunConflictError: If somebody else holds the lock.
    """

    def __init__(self, path: Path) -> None:
        """Take the lock."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._handle: int | None = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
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
        """Return the held lock."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release the lock."""
        self.release()


_HELD: weakref.WeakSet[RunLock] = weakref.WeakSet()


def _forget_in_child() -> None:
    """Close inherited locks in a forked process; the parent keeps its own."""
    for lock in list(_HELD):
        lock.release()


os.register_at_fork(after_in_child=_forget_in_child)
