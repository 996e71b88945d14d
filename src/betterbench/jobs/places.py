"""Protection against writing out of an output folder through a symbolic link.

An untrusted run folder may contain a link to one of the user's files, and that file must not be overwritten. While this
process has locked a folder (:class:`~betterbench.jobs.lock.RunLock`), every path that it writes there must therefore be
inside the folder, even after all links are resolved.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from betterbench.errors import InvalidInputError


class FolderClaim(Protocol):
    """Claim of a command to an output folder. It determines the files in the folder that the command may replace."""

    @property
    def thread(self) -> int:
        """Id of the thread that made the claim."""

    def require_ours(self, path: Path) -> None:
        """Raise RunConflictError if the file at a path must not be replaced."""

    def note(self, path: Path, sha256: str) -> None:
        """Record a file, just before it is moved to its path."""


_GUARDED: dict[Path, list[FolderClaim | None]] = {}
"""Folders that this process has locked, with the claims on each of them."""


def guard(folder: Path, claim: FolderClaim | None = None) -> None:
    """Guard a folder, so that symbolic links in it cannot be used to write outside of it.

    The folder stays guarded until :func:`unguard` has been called as often as this function.
    """
    _GUARDED.setdefault(folder, []).append(claim)


def unguard(folder: Path, claim: FolderClaim | None = None) -> None:
    """Undo a call of :func:`guard` with the same arguments. Do nothing if the folder is not guarded."""
    claims = _GUARDED.get(folder, [])
    if claim in claims:
        claims.remove(claim)
    if not claims:
        _GUARDED.pop(folder, None)


def is_claimed_here(folder: Path) -> bool:
    """Return whether this thread has claimed a folder and therefore holds its lock."""
    return any(claim is not None and claim.thread == threading.get_ident() for claim in _GUARDED.get(folder, []))


def claim_of(path: Path) -> FolderClaim | None:
    """Return the claim on the innermost guarded folder that contains a file, or None if there is no claim."""
    around = [folder for folder in tuple(_GUARDED) if path.absolute().is_relative_to(folder)]
    innermost = max(around, key=lambda folder: len(folder.parts), default=None)
    return None if innermost is None else next(filter(None, reversed(_GUARDED.get(innermost, []))), None)


def require_inside(path: Path, folder: Path) -> None:
    """Raise InvalidInputError if a path in a folder leads out of it through a link. The error names the link."""
    top = os.path.realpath(folder)
    if Path(os.path.realpath(path)).is_relative_to(top):  # realpath does not fail even for link loops
        return
    link = folder
    for part in path.relative_to(folder).parts:
        link /= part
        if link.is_symlink() and not Path(os.path.realpath(link)).is_relative_to(top):
            break
    raise InvalidInputError(str(link), f"leads out of {folder} through a link", "Remove the link")


def require_guarded(path: Path) -> None:
    """Raise InvalidInputError if the path of a file leads out of a guarded folder through a link."""
    place = path.absolute()
    for folder in tuple(_GUARDED):
        if place.is_relative_to(folder):
            require_inside(place, folder)


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Context manager that puts ``path`` into OSErrors instead of the path of a lock file or temporary file."""
    try:
        yield
    except OSError as error:
        error.filename, error.filename2 = str(path), None
        raise


def open_in_place(path: Path) -> int:
    """Open a file for reading and writing in place, or create it, and return its descriptor.

    Journals and locks are modified in place. If their path were a link, another file would be changed.

    Raises:
        InvalidInputError: If the path is a symbolic link, is not a regular file, or has a second name (a hard link).
        OSError: If the file cannot be opened.
    """
    require_guarded(path)
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise InvalidInputError(str(path), "is a symbolic link", "Remove the link") from error
        if error.errno == errno.ENXIO:
            raise InvalidInputError(str(path), "is not a regular file", "Move it to a different folder") from error
        raise
    found = os.fstat(handle)
    if stat.S_ISREG(found.st_mode) and found.st_nlink < 2:
        return handle
    os.close(handle)
    if not stat.S_ISREG(found.st_mode):
        raise InvalidInputError(str(path), "is not a regular file", "Move it to a different folder")
    problem = "has a second name (a hard link), so another file would be changed too"
    raise InvalidInputError(str(path), problem, "Replace the file with a copy of it")
