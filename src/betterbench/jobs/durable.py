"""Files that are either complete or absent, even after a crash of the process or the machine during writing."""

from __future__ import annotations

import contextlib
import glob
import hashlib
import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from betterbench.errors import STORAGE_CURES, StorageError
from betterbench.jobs.lock import LOCK_NAME, is_locked, require_held
from betterbench.jobs.places import claim_of, naming, require_guarded

PART_SUFFIX = ".part"
"""Suffix of unfinished files. They can be deleted after a crash."""

_PART = re.compile(rf"\..+\.[a-z0-9_]{{3,8}}{re.escape(PART_SUFFIX)}", re.DOTALL)
"""Pattern of the names that ``tempfile`` gives to unfinished files."""


class DurableFile:
    """File that is written under a temporary name and moved to its path when it is finished.

    If the file is unfinished when the context manager exits, it is removed. Readers see either the old or the new file,
    never a partial one. Missing folders are created.

    Attributes:
        file: The open file to write to.
        part: Path of the unfinished file, for libraries that open files themselves.

    Raises:
        StorageError: If the disk is full, broken or read-only, or if the folder that this process has locked was
            removed or moved.
        OSError: If the path cannot be written for another reason. The error names the path, not the temporary file.
        InvalidInputError: If the path leads through a link out of the folder that this process has locked.
        RunConflictError: If a file already exists at the path and the current command did not write it.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._claim = path, claim_of(path)
        require_guarded(path)
        require_held(path)
        if self._claim is not None:
            self._claim.require_ours(path)
        with on_disk(path), naming(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=PART_SUFFIX, dir=path.parent)
        self.part, self.file = Path(name), os.fdopen(handle, "wb")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(OSError):  # a full disk has already been reported
            self.file.close()
        with contextlib.suppress(OSError):  # the file has been moved already, or its folder was removed or is read-only
            self.part.unlink()
        if isinstance(error, OSError) and error.filename is None:  # errors of write calls do not contain the file name
            with on_disk(self._path):
                raise error

    def finish(self) -> None:
        """Flush the file to disk and move it to its final path.

        Raises StorageError if its folder no longer exists, and OSError if the file cannot be moved for another reason.
        """
        self.file.flush()
        os.fchmod(self.file.fileno(), 0o644)
        os.fsync(self.file.fileno())
        self.file.close()
        if self._claim is not None:
            with self.part.open("rb") as written:
                self._claim.note(self._path, hashlib.file_digest(written, "sha256").hexdigest())
        try:
            with naming(self._path):
                self.part.replace(self._path)
                sync_folder(self._path.parent)
        except (FileNotFoundError, NotADirectoryError) as error:
            raise StorageError(
                f"{self._path}: its folder was removed or moved while the file was written. Run the same command again."
            ) from error


def write_durably(path: Path, data: bytes) -> None:
    """Write a file completely, using :class:`DurableFile`.

    Raises:
        OSError: If the disk is full or the path cannot be written. No partial file is left.
    """
    with DurableFile(path) as written:
        written.file.write(data)
        written.finish()


def is_part(path: Path) -> bool:
    """Return whether a file name belongs to an unfinished :class:`DurableFile`."""
    return _PART.fullmatch(path.name) is not None


def remove_parts(folder: Path) -> None:
    """Delete unfinished files that killed processes left behind in a locked folder and its subfolders.

    Subfolders that another process has locked are skipped.
    """
    for place, folders, files in os.walk(folder):
        inside = Path(place)
        folders[:] = [name for name in folders if not is_locked(inside / name / LOCK_NAME)]
        for name in files:
            if is_part(inside / name):
                (inside / name).unlink(missing_ok=True)


def remove_parts_of(file: Path) -> None:
    """Delete unfinished versions of a file that killed processes left behind. The caller must hold the file's lock."""
    for part in file.parent.glob(f".{glob.escape(file.name)}.*{PART_SUFFIX}"):
        if is_part(part) and part.name.count(".") == file.name.count(".") + 3:
            part.unlink(missing_ok=True)


@contextlib.contextmanager
def on_disk(path: Path) -> Iterator[None]:
    """Context manager that converts errors of a full, broken or read-only disk to a StorageError.

    After such an error, all further writes would fail too.
    """
    try:
        yield
    except OSError as problem:
        cure = STORAGE_CURES.get(problem.errno or 0)
        if cure is None:
            raise
        raise StorageError(f"{path}: {problem.strerror}. Finished work is kept: {cure}.") from problem


def sync_folder(folder: Path) -> None:
    """Flush the file names in a folder to disk, so that a rename survives a power cut."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
