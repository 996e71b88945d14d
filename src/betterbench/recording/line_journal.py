"""An append-only file of JSON lines that survives a killed process and a full disk."""

from __future__ import annotations

import logging
import os
from pathlib import Path
from types import TracebackType
from typing import Self

from betterbench.errors import RecordError
from betterbench.json_form import read_bounded
from betterbench.recording.durable import sync_folder, write_durably
from betterbench.recording.lock import LOCK_NAME, FileLock, RunLock
from betterbench.recording.metadata import dump_json
from betterbench.recording.places import open_in_place

MAX_BYTES = 1 << 30
"""Largest journal that is read; a line takes some 600 bytes."""

logger = logging.getLogger(__name__)


class LineJournal:
    """A file of JSON lines, open for appending by one process at a time.

    Opening locks the folder (RunConflictError if another process holds the lock), hands all complete lines to
    :meth:`_take_in` and cuts off a last line that a killed process left unfinished. Each line that is appended is on
    disk when :meth:`_append_line` returns. A file that somebody else removes, replaces or cuts meanwhile is written
    again. With ``alone`` the file is locked, and not its folder.
    """

    def __init__(self, path: Path, *, alone: bool = False) -> None:
        self._path = path = path.absolute()
        self._lock = FileLock(path) if alone else RunLock(path.parent / LOCK_NAME)
        self._handle: int | None = None
        try:
            lines, self._length = complete_lines(path)
            self._content = bytearray(b"".join(line + b"\n" for line in lines))
            self._take_in(lines)
            self._handle = open_in_place(path)
            if os.fstat(self._handle).st_size > self._length:
                _require_begun(path, os.pread(self._handle, 1, self._length))
                logger.warning("%s: cut off an unfinished last line; its trial will be run again", path)
                os.ftruncate(self._handle, self._length)
            os.fsync(self._handle)
            sync_folder(path.parent)
        except BaseException:
            self.close()
            raise

    @property
    def is_empty(self) -> bool:
        """True if the file holds no complete line."""
        return self._length == 0

    def _take_in(self, lines: list[bytes]) -> None:
        """Read the lines that the file holds when it is opened."""
        raise NotImplementedError

    def _append_line(self, form: object) -> None:
        """Append a JSON value and force it to disk; if that raises an OSError, the file is as it was before."""
        if self._handle is None:
            msg = f"{self._path}: the journal is closed"
            raise ValueError(msg)
        if not self._stands_there(self._handle):
            self._write_again(self._handle)
        line = dump_json(form) + b"\n"
        try:
            written = 0
            while written < len(line):
                written += os.pwrite(self._handle, line[written:], self._length + written)
            os.fsync(self._handle)
        except OSError:
            os.ftruncate(self._handle, self._length)
            raise
        self._length += len(line)
        self._content += line

    def restore(self) -> None:
        """Write the file again if somebody else has removed, replaced or changed it since it was opened."""
        if self._handle is None:
            return
        if not self._stands_there(self._handle) or os.pread(self._handle, self._length, 0) != self._content:
            self._write_again(self._handle)

    def _stands_there(self, handle: int) -> bool:
        """Tell whether the open file is still the one at its path, and as long as it was written."""
        ours = os.fstat(handle)
        try:
            there = os.lstat(self._path)
        except (FileNotFoundError, NotADirectoryError):
            return False
        return (there.st_dev, there.st_ino, there.st_size) == (ours.st_dev, ours.st_ino, self._length)

    def _write_again(self, handle: int) -> None:
        logger.warning("%s was removed or changed by somebody else and is written again", self._path)
        write_durably(self._path, bytes(self._content))
        self._handle = open_in_place(self._path)
        os.close(handle)

    def close(self) -> None:
        """Close the file and release the lock; harmless when closed."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
        self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _require_begun(path: Path, begun: bytes) -> None:
    """Refuse to cut off what is not the beginning of a line, or zeros where the machine went down."""
    if begun not in (b"{", b"\0"):
        raise RecordError(f"{path}: does not end as a journal does. Restore the file from a copy.")


def complete_lines(path: Path) -> tuple[list[bytes], int]:
    """Return the complete lines of a file, a missing one being empty, and how many bytes they take."""
    try:
        data = read_bounded(path, max_bytes=MAX_BYTES, cure="Restore the file from a copy", raises=RecordError)
    except RecordError as error:
        if isinstance(error.__cause__, FileNotFoundError) and not path.is_symlink():
            return [], 0
        raise
    length = data.rfind(b"\n") + 1
    return data[:length].split(b"\n")[:-1], length
