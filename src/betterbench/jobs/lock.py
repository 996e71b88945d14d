"""Lock that allows only one process at a time to write to a run folder."""

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
"""Name of the lock file in a folder."""

_TRIES = 25
_PAUSE_S = 0.02  # longer than another process needs to check the lock


def is_locked(path: Path) -> bool:
    """Return whether a running process holds the lock of a run.

    Locks held by processes on other machines are detected if the file system shares locks.
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
    """Picklable reference to a locked folder, which is passed to workers.

    Attributes:
        lock: Path of the lock file.
        output: Locked path as given by the user.
        identity: Device and inode of the lock file.
    """

    lock: Path
    output: Path
    identity: tuple[int, int]

    @property
    def folder(self) -> Path:
        """The locked folder."""
        return self.lock.parent

    def require_folder(self, path: Path) -> None:
        """Raise StorageError if the path of a file is inside the locked folder and this folder no longer exists."""
        if path.absolute().is_relative_to(self.folder) and not _is_file(self.lock, self.identity):
            raise StorageError(_lost_text(self.output, self.lock.name, f"{path.name} is not written"))


class RunLock:
    """Exclusive lock on a run folder. The kernel releases the lock when the process ends.

    The lock file stays in the folder, even after a crash, and can be locked again without any cleanup. Forked processes
    do not keep the lock. While the lock is held, no file is written through a link that leads out of the folder
    (:mod:`betterbench.jobs.places`). If the folder is removed or moved, further writes fail (:func:`require_held`),
    because earlier files would be missing. With ``renews``, the lock is taken again, and writes do not fail. Use
    ``renews`` only if the caller writes the earlier files again. If ``output`` is given, messages name it instead of
    the folder.

    Raises:
        RunConflictError: If another process holds the lock and ``waits`` is False.
        InvalidInputError: If the lock file is a symbolic link, is not a regular file, or has a second name (hard link).
        StorageError: If a parent folder that this process has locked was removed or moved.
    """

    _is_folder = True

    def __init__(self, path: Path, *, waits: bool = False, renews: bool = False, output: Path | None = None) -> None:
        self._path, self._folder, self._renews = path, path.parent.absolute(), renews
        self._output = output or path.parent
        self._handle: int | None = None
        self._renewing = threading.Lock()
        if is_claimed_here(self._folder):  # this thread has locked the folder already
            return
        require_guarded(path)
        for around in _around():  # do not create this folder inside a locked folder that was removed
            if around.folder != self._folder:
                around.require_folder(path)
        self._handle = self._noted(waits=waits)
        _HELD.append(self)
        self._guard()

    def _noted(self, *, waits: bool) -> int:
        """Lock the file, write the id of this process to it, and return the file descriptor."""
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
        """Raise StorageError if the path of a file is inside the locked folder and this folder no longer exists.

        If the lock was created with ``renews``, take it again instead. Raises RunConflictError if another process has
        taken the lock in the meantime.
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
        """The folder that contains the lock file."""
        return self._folder

    @property
    def for_workers(self) -> HeldFolder | None:
        """Reference to the locked folder for worker processes.

        None if the lock is not held, or if it was created with ``renews``.
        """
        if self._handle is None or not self._is_folder or self._renews:
            return None
        held = os.fstat(self._handle)
        return HeldFolder(self._path.absolute(), self._locked, (held.st_dev, held.st_ino))

    @property
    def _locked(self) -> Path:
        """Locked path as given by the user."""
        return self._output

    def _guard(self) -> None:
        guard(self._folder)

    def _unguard(self) -> None:
        unguard(self._folder)

    def _taken(self, *, waits: bool) -> int:
        """Lock the file, check that the locked file is still at its path, and return the file descriptor.

        The previous holder may have removed the file or its folder. A lock on a removed file would not exclude other
        processes.
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
        """Raise StorageError if the folder was removed or moved after it was locked, because earlier files are missing.

        Call this last, just before a command reports that its output is complete.
        """
        if self._handle is not None and not _stands_at(self._path, self._handle):
            raise StorageError(self._lost("part of the output may be missing"))

    def _lost(self, consequence: str) -> str:
        """Return the message for a locked folder that no longer exists."""
        return _lost_text(self._locked, self._path.name, consequence)

    def release(self) -> None:
        """Release the lock. Releasing it again does nothing."""
        if self._handle is not None:
            self._unguard()
        self._close()

    def _close(self) -> None:
        """Close the lock file. This releases the kernel's lock, unless a parent process still holds it."""
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
    """Exclusive lock on a single file. Its lock file ``.NAME.lock`` is in the same folder and is removed at release."""

    _is_folder = False

    def __init__(self, file: Path, *, waits: bool = False) -> None:
        self._file = file
        super().__init__(file.with_name(f".{file.name}.lock"), waits=waits)

    def _guard(self) -> None:
        """Do nothing: the user chose this folder, and it may contain files of other programs."""

    def _unguard(self) -> None:
        """Do nothing."""

    @property
    def _locked(self) -> Path:
        """Locked path as given by the user."""
        return self._file

    def _conflict(self, holder: str) -> str:
        """Return the message for a lock that another process holds."""
        return f"{self._file}: another process ({holder}) is writing it. Wait for it, or choose another name."

    def release(self) -> None:
        """Remove the lock file and release the lock. Releasing it again does nothing."""
        if self._handle is not None:
            with contextlib.suppress(OSError):
                self._path.unlink()
        super().release()


def require_held(path: Path) -> None:
    """Raise StorageError if a file is about to be written into a locked folder that was removed or moved.

    The locks of this process and the locks of its parent (:func:`write_within`) are checked. If the lock was created
    with ``renews``, it is taken again and no StorageError is raised. Raises RunConflictError if another process has
    taken that lock in the meantime.
    """
    for held in _around():
        held.require_folder(path)


def _around() -> list[HeldFolder | RunLock]:
    """Return the current locks of this process and its parent, as a copy, because other threads change the lists."""
    return [*_OF_PARENT, *_HELD]


def held_folders() -> tuple[HeldFolder, ...]:
    """Return the folders that this process has locked, for worker processes that write into these folders."""
    return tuple(found for lock in tuple(_HELD) if (found := lock.for_workers) is not None)


def write_within(folders: Iterable[HeldFolder]) -> None:
    """Register folders that the parent process has locked. If one of them is removed, writing into it fails.

    Without this check, a worker would create the removed folder again, and a repeated command would reject the folder.
    """
    _OF_PARENT.extend(folders)


def _lost_text(output: Path, lock_name: str, consequence: str) -> str:
    return (
        f"{output}: the folder or its {lock_name} was removed or moved while this command was writing to it, so "
        f"{consequence}. Restore the folder, or run the same command again."
    )


def _stands_at(path: Path, handle: int) -> bool:
    """Return whether an open file is still the file at its path."""
    ours = os.fstat(handle)
    return _is_file(path, (ours.st_dev, ours.st_ino))


def _is_file(path: Path, identity: tuple[int, int]) -> bool:
    """Return whether the file at a path has the given device and inode."""
    try:
        there = os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return (there.st_dev, there.st_ino) == identity


def _lock_exclusively(handle: int) -> None:
    """Take the lock. Retry a few times, because another process that checks the lock holds it for a moment."""
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
    """Close the inherited lock files in a forked process. The parent keeps its locks."""
    for lock in tuple(_HELD):
        lock._close()


os.register_at_fork(after_in_child=_forget_in_child)
