"""Output files and folders of commands. A command never silently replaces files that it did not write.

The rules are the same for every subcommand. A single file counts as written by a subcommand if it contains the
subcommand's mark (:func:`mark_of`), or content that the subcommand recognizes. A folder counts as written by a
subcommand if the folder's list ``.written.json`` names the subcommand. A file in such a folder counts as written by the
subcommand only if the list contains the file's current SHA-256, i.e. if the file was not edited afterward.

Files written by the same subcommand are always replaced, all others only with ``--overwrite``. Folders, pipes and
devices are never replaced. While a command writes an output, other processes cannot write to it. Unfinished files that
killed processes left behind are deleted.
"""

from __future__ import annotations

import json
import os
import stat
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from pydantic import TypeAdapter

from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.jobs.durable import is_part, remove_parts, remove_parts_of, write_durably
from betterbench.jobs.lock import LOCK_NAME, FileLock, RunLock
from betterbench.jobs.places import guard, unguard
from betterbench.json_form import file_digest, read_bounded, read_form, strict_form
from betterbench.ordinary_file import open_ordinary

LIST_NAME = ".written.json"
"""Name of the file in an output folder that lists the written files."""

_MAX_LIST_BYTES = 64 << 20
_ENDS_BYTES = 1 << 16
"""Number of bytes to search for a mark at the beginning of a file (comments of PNG files) and at its end (MP4 files).
"""


def mark_of(verb: str) -> str:
    """Return the comment that marks a file as the output of a subcommand."""
    return f"Written by better {verb} (betterbench)"


def bears_mark(path: Path, verb: str) -> bool:
    """Return whether a file contains the mark of a subcommand near its beginning or end.

    Raises OSError if the file cannot be read.
    """
    mark = mark_of(verb).encode()
    with open_ordinary(path) as file:
        if mark in file.read(_ENDS_BYTES):
            return True
        file.seek(max(0, file.seek(0, os.SEEK_END) - _ENDS_BYTES))
        return mark in file.read()


def require_replaceable(
    path: Path, verb: str, *, overwrite: bool = False, is_ours: Callable[[Path], bool] | None = None
) -> None:
    """Raise RunConflictError if a file exists at a path and must not be replaced.

    Args:
        path: Path of the file to write.
        verb: Subcommand that writes the file.
        overwrite: Whether to replace files that this subcommand did not write.
        is_ours: Function that returns whether this subcommand wrote an existing file. By default, a file with the
            subcommand's mark counts as written by it.
    """
    try:
        there = os.lstat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return
    if not (stat.S_ISREG(there) or stat.S_ISLNK(there)):
        what = "a folder" if stat.S_ISDIR(there) else "a pipe, socket or device"
        raise RunConflictError(f"{path} is {what}, which is never replaced. Choose a different file name.")
    if overwrite:
        return
    if stat.S_ISLNK(there):
        raise _occupied(path, "a link", verb)
    if os.lstat(path).st_size and not (bears_mark(path, verb) if is_ours is None else is_ours(path)):
        raise _occupied(path, "a file", verb)


def _occupied(path: Path, what: str, verb: str) -> RunConflictError:
    return RunConflictError(
        f"{path}: {what} that better {verb} did not write already exists here and is not replaced. Choose a different "
        "file name, or pass --overwrite."
    )


class OutputFile:
    """Output file of a subcommand. As a context manager, it locks the file and returns the path.

    Raises:
        RunConflictError: If an existing file must not be replaced, or if another process is writing it.
    """

    def __init__(
        self, path: Path, verb: str, *, overwrite: bool = False, is_ours: Callable[[Path], bool] | None = None
    ) -> None:
        self._path, self._verb, self._overwrite, self._is_ours = path, verb, overwrite, is_ours
        self._lock: FileLock | None = None

    def __enter__(self) -> Path:
        self._require()  # check before creating a lock file
        self._lock = FileLock(self._path)
        try:
            self._require()
            remove_parts_of(self._path)
        except BaseException:
            self._lock.release()
            raise
        return self._path

    def _require(self) -> None:
        require_replaceable(self._path, self._verb, overwrite=self._overwrite, is_ours=self._is_ours)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._lock is not None:
            self._lock.release()


@strict_form
@dataclass(frozen=True, slots=True)
class _Written:
    by: str
    files: dict[str, tuple[str, ...]]


_WRITTEN = TypeAdapter(_Written)


class OutputFolder:
    """Output folder of a subcommand. As a context manager, it locks the folder.

    Every :class:`~betterbench.jobs.durable.DurableFile` that this process writes into the folder is checked and added
    to the list. Subfolders that have their own lock are excluded.

    Args:
        path: Path of the folder. It is created if it is missing.
        verb: Subcommand that writes the folder.
        overwrite: Whether to accept a folder that contains other files, and to replace them.
        holds: Function that returns whether an unlisted entry, such as a run, belongs in the folder.
        is_ours: Function that returns whether this subcommand wrote a folder without a list, as older versions did.

    Raises:
        RunConflictError: If the folder contains other files, if a file in it was changed after it was written, or if
            another process is writing to the folder.
        InvalidInputError: If a symbolic link leads out of the folder.
        StorageError: If the folder was removed or moved before the context manager exits.
    """

    def __init__(
        self,
        path: Path,
        verb: str,
        *,
        overwrite: bool = False,
        holds: Callable[[Path], bool] = lambda _: False,
        is_ours: Callable[[], bool] = lambda: False,
    ) -> None:
        self.path, self._verb = path.absolute(), verb
        self._overwrite, self._holds, self._is_ours = overwrite, holds, is_ours
        self._takes_all = overwrite
        self._known: dict[str, tuple[str, ...]] = {}
        self._fresh: dict[str, str] = {}
        self._stack = ExitStack()
        self._lock: RunLock | None = None
        self.thread, self._noting = threading.get_ident(), threading.Lock()

    def __enter__(self) -> Self:
        self._known = self._checked()
        with ExitStack() as stack:
            self._lock = stack.enter_context(RunLock(self.path / LOCK_NAME))
            stack.callback(self._leave_nothing)
            self._known = self._checked()
            remove_parts(self.path)
            guard(self.path, self)
            stack.callback(unguard, self.path, self)
            if self._listed() is None:
                # Write the list first. If the command is killed, the folder then still counts as written by it.
                self._store()
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._stack:
            if self._lock is not None and error is None:
                self._lock.require_in_place()
            if self._fresh and error is None:  # drop the digests of the previous content
                self._known |= {name: (digest,) for name, digest in self._fresh.items()}
                self._store()

    def _leave_nothing(self) -> None:
        """Remove the folder if it is still empty, for example because the input was invalid."""
        with suppress(OSError):
            if all(is_bookkeeping(entry) for entry in self.path.iterdir()):
                for name in (LIST_NAME, LOCK_NAME):
                    (self.path / name).unlink(missing_ok=True)
                self.path.rmdir()

    def _checked(self) -> dict[str, tuple[str, ...]]:
        """Return the listed files.

        Raises RunConflictError if this subcommand did not write the folder or one of its files.
        """
        path = self.path
        if (path.exists() or path.is_symlink()) and not path.is_dir():
            raise RunConflictError(f"{path}: this is a file. Choose a folder.")
        entries = [p for p in path.iterdir() if not is_bookkeeping(p)] if path.is_dir() else []
        listed = self._listed()
        self._takes_all = self._overwrite or (listed is None and self._is_ours())
        others = [p for p in entries if not self._holds(p)] if listed is None else []
        if others and not self._takes_all:
            raise RunConflictError(
                f"{path}: the folder contains {others[0].name}, which better {self._verb} did not write. Choose "
                "an empty or a new folder, or pass --overwrite to replace files with the same names and keep all "
                "others."
            )
        known = listed or {}
        for name in known:
            self._require_ours(path / name, known)
        return known

    def _listed(self) -> dict[str, tuple[str, ...]] | None:
        """Return the files that this subcommand has written into the folder, or None if the folder has no list."""
        file = self.path / LIST_NAME
        if not file.is_file() or file.is_symlink():
            return None
        try:
            data = read_bounded(file, max_bytes=_MAX_LIST_BYTES, cure="Remove it")
            found = read_form(_WRITTEN, data, where=str(file), cure="Remove it")
        except InvalidInputError:
            return None
        inside = {name: known for name, known in found.files.items() if _is_name(name)}
        return inside if found.by == self._verb else None

    def require_ours(self, path: Path) -> None:
        """Raise RunConflictError if the file at a path in the folder must not be replaced."""
        if path.absolute() != self.path / LIST_NAME:
            self._require_ours(path.absolute(), self._known)

    def _require_ours(self, path: Path, known: dict[str, tuple[str, ...]]) -> None:
        digests = known.get(path.relative_to(self.path).as_posix(), ())
        require_replaceable(
            path, self._verb, overwrite=self._takes_all, is_ours=lambda there: file_digest(there) in digests
        )

    def note(self, path: Path, sha256: str) -> None:
        """Add a file to the list, just before it is moved to its path.

        If the file replaces another file, the list also keeps the digest of the replaced file.
        """
        name = path.absolute().relative_to(self.path).as_posix()
        if name == LIST_NAME:
            return
        with self._noting:
            self._fresh[name] = sha256
            self._known[name] = tuple(dict.fromkeys((*self._known.get(name, ()), sha256)))
            self._store()

    def _store(self) -> None:
        form = {"by": self._verb, "files": dict(sorted(self._known.items()))}
        write_durably(self.path / LIST_NAME, json.dumps(form, indent=1).encode() + b"\n")


def _is_name(name: str) -> bool:
    """Return whether a listed name is a valid file name inside the folder."""
    return name.isprintable() and not {"..", "/"} & set(Path(name).parts)


def is_run(path: Path) -> bool:
    """Return whether an entry of a folder is a run, which has its own lock."""
    return not path.is_symlink() and any((path / name).is_file() for name in ("run.json", LOCK_NAME))


def is_bookkeeping(path: Path) -> bool:
    """Return whether an entry of a folder is a lock, a list of files or an unfinished file."""
    return path.name in (LOCK_NAME, LIST_NAME) or is_part(path)
