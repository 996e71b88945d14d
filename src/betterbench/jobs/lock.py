"""Lock that prevents two processes from writing to the same run folder."""

from __future__ import annotations

import contextlib
import fcntl
import os
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from betterbench.errors import RunConflictError, StorageError
from betterbench.jobs.places import guard, is_claimed_here, naming, open_in_place, require_guarded, unguard

LOCK_NAME = ".lock"
"""File in a folder that carries the lock of the folder."""

_TRIES = 25
_PAUSE_S = 0.02  # longer than another process takes to check the lock


def is_locked(path: Path) -> bool:
    """Return whether a living process holds a run's lock, without disturbing this process.

    A lock held on another machine is detected if the file system shares locks.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOFOLLOW)
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


@dataclass(frozen=True, slots=True)
class HeldFolder:
    """Reference to a folder that a process has locked, which it passes to its workers; small and picklable.

    Attributes:
        lock: File of the lock.
        output: Locked path, as the user named it.
        identity: Device and inode of the file.
    """

    lock: Path
    output: Path
    identity: tuple[int, int]

    @property
    def folder(self) -> Path:
        """The locked folder."""
        return self.lock.parent

    def require_folder(self, path: Path) -> None:
        """Raise StorageError if a file is in the folder, and the folder no longer exists."""
        if path.absolute().is_relative_to(self.folder) and not _is_file(self.lock, self.identity):
            raise StorageError(_lost_text(self.output, self.lock.name, f"{path.name} is not written"))


class RunLock:
    """Exclusive lock on a run folder, released at the latest when the process ends.

    The lock file remains, but only the kernel's lock matters, so a crash leaves nothing to clean up. Forked processes
    do not keep the lock. While the lock is held, no file is written below the folder through a link that leads out of
    the folder (:mod:`betterbench.jobs.places`), or after the folder was removed or moved (:func:`require_held`),
    because earlier files would then be missing. With ``renews``, the owner writes the earlier files again, and the lock
    is taken again. If ``output`` is given, messages
    name this path instead of the folder, which only contains its parts.

    Raises:
        RunConflictError: If another process holds the lock, unless ``waits`` is set.
        InvalidInputError: If the lock file is a link, not an ordinary file, or has a second name (hard link).
        StorageError: If a surrounding folder locked by this process was removed or moved.
    """

    _is_folder = True

    def __init__(self, path: Path, *, waits: bool = False, renews: bool = False, output: Path | None = None) -> None:
        self._path, self._folder, self._renews = path, path.parent.absolute(), renews
        self._output = output or path.parent
        self._handle: int | None = None
        self._renewing = threading.Lock()
        if is_claimed_here(self._folder):  # this thread has already locked the folder
            return
        require_guarded(path)
        for around in _around():  # do not create this folder inside a locked folder that was removed
            if around.folder != self._folder:
                around.require_folder(path)
        self._handle = self._noted(waits=waits)
        _HELD.append(self)
        self._guard()

    def _noted(self, *, waits: bool) -> int:
        """Return the descriptor of the locked file, after writing the holder into it."""
        with naming(self._locked):
            handle = self._taken(waits=waits)
            try:
                os.ftruncate(handle, 0)
                os.pwrite(handle, f"{os.getpid()}\n".encode("ascii"), 0)
            except OSError:
                os.close(handle)
                raise
        return handle

    def require_folder(self, path: Path) -> None:
        """Raise StorageError if a file is in the locked folder, and the folder no longer exists.

        With ``renews``, take the lock again; raises RunConflictError if another process has taken it.
        """
        if self._handle is None or not self._is_folder or not path.absolute().is_relative_to(self._folder):
            return
        if _stands_at(self._path, self._handle):
            return
        if not self._renews:
            raise StorageError(self._lost(f"{path.name} is not written"))
        with self._renewing:
            if not _stands_at(self._path, self._handle):
                lost, self._handle = self._handle, self._noted(waits=False)
                os.close(lost)

    @property
    def folder(self) -> Path:
        """The folder of the lock."""
        return self._folder

    @property
    def for_workers(self) -> HeldFolder | None:
        """The locked folder, for worker processes, or None if no folder is held, or the lock would be renewed."""
        if self._handle is None or not self._is_folder or self._renews:
            return None
        held = os.fstat(self._handle)
        return HeldFolder(self._path.absolute(), self._locked, (held.st_dev, held.st_ino))

    @property
    def _locked(self) -> Path:
        """Locked path, as the user named it."""
        return self._output

    def _guard(self) -> None:
        guard(self._folder)

    def _unguard(self) -> None:
        unguard(self._folder)

    def _taken(self, *, waits: bool) -> int:
        """Return the descriptor of the locked file that is still at its path.

        The last holder of the lock may have removed the file or its folder, and a lock on a removed file would not
        exclude other processes.
        """
        while True:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            try:
                handle = open_in_place(self._path)
            except FileNotFoundError:
                if self._path.parent.is_dir():
                    raise
                continue
            try:
                if waits:
                    fcntl.flock(handle, fcntl.LOCK_EX)
                else:
                    _lock_exclusively(handle)
            except OSError as error:
                holder = os.pread(handle, 20, 0).decode("ascii", "replace").strip() or "unknown"
                os.close(handle)
                if not isinstance(error, BlockingIOError):
                    raise
                raise RunConflictError(self._conflict(holder)) from error
            if _stands_at(self._path, handle):
                return handle
            os.close(handle)

    def _conflict(self, holder: str) -> str:
        """Return the message for a lock that another process holds."""
        return f"{self._locked}: another run (process {holder}) is writing here. Wait for it, or choose another folder."

    def require_in_place(self) -> None:
        """Raise StorageError if the folder was removed or moved since it was locked, because files are then missing.

        Call this last, before a command reports its output as complete.
        """
        if self._handle is not None and not _stands_at(self._path, self._handle):
            raise StorageError(self._lost("a part of the output may be elsewhere or gone"))

    def _lost(self, consequence: str) -> str:
        """Return the message for a locked folder that no longer exists."""
        return _lost_text(self._locked, self._path.name, consequence)

    def release(self) -> None:
        """Release the lock. Releasing it again is harmless."""
        if self._handle is not None:
            self._unguard()
        self._close()

    def _close(self) -> None:
        """Close the file, which releases the kernel's lock unless a parent process still holds it."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
        if self in _HELD:
            _HELD.remove(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


class FileLock(RunLock):
    """Exclusive lock on a single file, by a lock file ``.NAME.lock`` in the same folder that is removed at release."""

    _is_folder = False

    def __init__(self, file: Path, *, waits: bool = False) -> None:
        self._file = file
        super().__init__(file.with_name(f".{file.name}.lock"), waits=waits)

    def _guard(self) -> None:
        """Do nothing, because the user chose the folder and it contains other files."""

    def _unguard(self) -> None:
        """Do nothing."""

    @property
    def _locked(self) -> Path:
        """Locked path, as the user named it."""
        return self._file

    def _conflict(self, holder: str) -> str:
        """Return the message for a lock that another process holds."""
        return f"{self._file}: another process ({holder}) is writing it. Wait for it, or choose another name."

    def release(self) -> None:
        """Remove the lock file, and release the lock. This is harmless if it is not held."""
        if self._handle is not None:
            with contextlib.suppress(OSError):
                self._path.unlink()
        super().release()


def require_held(path: Path) -> None:
    """Raise StorageError if a file to be written is in a locked folder that was removed or moved.

    This process's locks and those passed on by its parent (:func:`write_within`) are checked. Raises
    RunConflictError if another process has taken a renewed lock.
    """
    for held in _around():
        held.require_folder(path)


def _around() -> list[HeldFolder | RunLock]:
    """Return the current locks of the parent and of this process, which threads take and release."""
    return [*_OF_PARENT, *_HELD]


def held_folders() -> tuple[HeldFolder, ...]:
    """Return the folders locked by this process, for worker processes that write below them."""
    return tuple(found for lock in tuple(_HELD) if (found := lock.for_workers) is not None)


def write_within(folders: Iterable[HeldFolder]) -> None:
    """Forbid this process to write below folders locked by its parent process once they have been removed.

    A worker that continued to write would recreate a removed folder, which the same command could then not use.
    """
    _OF_PARENT.extend(folders)


def _lost_text(output: Path, lock_name: str, consequence: str) -> str:
    return (
        f"{output}: was removed or moved, or its {lock_name}, while this command writes there, so {consequence}. "
        "Put the folder back, or run the same command again."
    )


def _stands_at(path: Path, handle: int) -> bool:
    """Return whether an open file is still the file at its path."""
    ours = os.fstat(handle)
    return _is_file(path, (ours.st_dev, ours.st_ino))


def _is_file(path: Path, identity: tuple[int, int]) -> bool:
    """Return whether the file at a path has this device and inode."""
    try:
        there = os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return (there.st_dev, there.st_ino) == identity


def _lock_exclusively(handle: int) -> None:
    """Take the lock, with a few retries, because a reader may be checking the lock."""
    for left in reversed(range(_TRIES)):
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if not left:
                raise
            time.sleep(_PAUSE_S)
        else:
            return


_HELD: list[RunLock] = []

_OF_PARENT: list[HeldFolder] = []


def _forget_in_child() -> None:
    """Close inherited locks in a forked process; the parent keeps its own."""
    for lock in tuple(_HELD):
        lock._close()


os.register_at_fork(after_in_child=_forget_in_child)
