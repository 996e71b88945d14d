"""Files that are either complete or absent, whatever happens to the process or the machine while they are written."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from betterbench.errors import StorageError

PART_SUFFIX = ".part"
"""Ending of a file that is still being written; what carries it after a crash can be deleted."""


class DurableFile:
    """A file that is written bit by bit beside its final place, and is there when it is finished and not before.

    A context manager, which removes what is not finished. A reader sees the old file or the new one, never a part.
    Missing folders are made. Raises OSError if the disk is full or the place cannot be written.

    Attributes:
        file: What is written to.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=PART_SUFFIX, dir=path.parent)
        self._part, self.file = Path(name), os.fdopen(handle, "wb")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(OSError):  # of a full disk, raised before
            self.file.close()
        self._part.unlink(missing_ok=True)

    def finish(self) -> None:
        """Force the file to disk and put it at its place."""
        self.file.flush()
        os.fchmod(self.file.fileno(), 0o644)
        os.fsync(self.file.fileno())
        self.file.close()
        self._part.replace(self._path)
        sync_folder(self._path.parent)


def write_durably(path: Path, data: bytes) -> None:
    """Write a whole file as :class:`DurableFile` does.

    Raises:
        OSError: If the disk is full or the place cannot be written; nothing is left behind then.
    """
    with DurableFile(path) as written:
        written.file.write(data)
        written.finish()


def remove_parts(folder: Path) -> None:
    """Delete what killed processes left half-written in a folder and below; the caller holds the lock of the folder."""
    for part in folder.rglob(f".*{PART_SUFFIX}"):
        part.unlink(missing_ok=True)


_LASTING = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EFBIG})
_CURES = {
    errno.EROFS: "choose a place that can be written to",
    errno.EIO: "see to the disk, then run the same command again",
}


@contextlib.contextmanager
def on_disk(path: Path) -> Iterator[None]:
    """Turn an error of a full, broken or protected disk into a StorageError; whatever is written next fails alike."""
    try:
        yield
    except OSError as problem:
        if problem.errno not in _LASTING:
            raise
        cure = _CURES.get(problem.errno or 0, "make room, then run the same command again")
        raise StorageError(f"{path}: {problem.strerror}. Nothing finished is lost: {cure}.") from problem


def sync_folder(folder: Path) -> None:
    """Force the names in a folder to disk, so that a rename survives a power cut."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
