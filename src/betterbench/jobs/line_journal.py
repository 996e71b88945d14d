"""Append-only file of JSON lines that stays valid if the process is killed or the disk is full.

Each line contains a link, i.e. the SHA-256 of the previous link together with the rest of the line. The links reveal
changed, missing and moved lines. An incomplete last line is ignored with a warning.
"""

from __future__ import annotations

import hashlib
import logging
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from betterbench.errors import RecordError
from betterbench.jobs.durable import sync_folder, write_durably
from betterbench.jobs.lock import LOCK_NAME, FileLock, RunLock, is_locked, require_held
from betterbench.jobs.places import naming, open_in_place
from betterbench.json_form import dump_json, form_errors, parse_json, read_bounded, say_unsealed
from betterbench.ordinary_file import open_ordinary
from betterbench.quoting import json_line

MAX_BYTES = 1 << 30
"""Maximum size of a journal [byte]. A line takes about 600 bytes."""

LINK = "link"
"""JSON key of the link in a line."""

logger = logging.getLogger(__name__)


class LineJournal:
    """Journal of JSON lines. Only one process at a time can append to it.

    Opening a journal locks its folder, and raises RunConflictError if another process holds the lock. The complete
    lines are then passed to :meth:`_take_in`, and an incomplete last line, left behind by a killed process, is removed.
    When :meth:`_append_line` returns, the line is on disk, unless ``within_s`` is used. If another program removes,
    replaces or truncates the file, the journal writes the file again.

    If ``alone`` is True, only the file is locked, not its folder. If the folder is removed, appending raises
    StorageError. With ``renews``, appending instead creates the folder and the journal again. Use ``renews`` only if
    the caller also restores the other files in the folder.
    """

    def __init__(self, path: Path, *, alone: bool = False, renews: bool = False) -> None:
        self._path = path = path.absolute()
        self._lock = FileLock(path) if alone else RunLock(path.parent / LOCK_NAME, renews=renews)
        self._handle: int | None = None
        self._synced_at = 0.0
        self._is_synced = True
        try:
            lines, self._length = complete_lines(path)
            self._content = bytearray(b"".join(line + b"\n" for line in lines))
            self._take_in(lines)
            with naming(path):
                self._handle = open_in_place(path)
                if os.fstat(self._handle).st_size > self._length:
                    _require_begun(path, os.pread(self._handle, 1, self._length))
                    logger.warning("%s: the incomplete last line was removed; its trial will be repeated", path)
                    os.ftruncate(self._handle, self._length)
                os.fsync(self._handle)
                sync_folder(path.parent)
        except BaseException:
            self.close()
            raise

    @property
    def is_empty(self) -> bool:
        """Whether the file has no complete line."""
        return self._length == 0

    def _take_in(self, lines: list[bytes]) -> None:
        """Process the existing lines when the journal is opened."""
        raise NotImplementedError

    def _append_line(self, form: object, *, within_s: float = 0.0) -> None:
        """Append a JSON value and sync it to disk. If OSError is raised, the file is unchanged.

        The sync is skipped if the last sync was less than ``within_s`` [s] ago. A line that is not synced survives if
        the process is killed, but a power failure may lose it.
        """
        if self._handle is None:
            msg = f"{self._path}: the journal is closed"
            raise ValueError(msg)
        require_held(self._path)
        if not self._stands_there(self._handle):
            self._write_again(self._handle)
        line = json_line(dump_json(form))
        try:
            written = 0
            with naming(self._path):
                while written < len(line):
                    written += os.pwrite(self._handle, line[written:], self._length + written)
                self._is_synced = False
                if time.monotonic() - self._synced_at >= within_s:
                    self._sync(self._handle)
        except OSError:
            os.ftruncate(self._handle, self._length)
            raise
        self._length += len(line)
        self._content += line

    def _sync(self, handle: int) -> None:
        os.fsync(handle)
        self._synced_at, self._is_synced = time.monotonic(), True

    def restore(self) -> bool:
        """Write the file again if it was removed, replaced or changed. Return whether this was necessary."""
        if self._handle is None or (
            self._stands_there(self._handle) and os.pread(self._handle, self._length, 0) == self._content
        ):
            return False
        self._write_again(self._handle)
        return True

    def _stands_there(self, handle: int) -> bool:
        """Return whether the open file is still at its path and still has the expected size."""
        ours = os.fstat(handle)
        try:
            there = os.lstat(self._path)
        except (FileNotFoundError, NotADirectoryError):
            return False
        return (there.st_dev, there.st_ino, there.st_size) == (ours.st_dev, ours.st_ino, self._length)

    def _write_again(self, handle: int) -> None:
        logger.warning("%s was removed or changed by another program and is written again", self._path)
        write_durably(self._path, bytes(self._content))
        self._handle = open_in_place(self._path)
        os.close(handle)

    def close(self) -> None:
        """Close the file and release the lock. Closing it again does nothing."""
        handle, self._handle = self._handle, None
        try:
            if handle is not None and not self._is_synced:
                with naming(self._path):
                    self._sync(handle)
        finally:
            if handle is not None:
                os.close(handle)
            self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def link_after(before: str, form: Mapping[str, object]) -> str:
    """Return the link of a line: a hash of the previous link ("" for the first line) and the line's other fields."""
    return hashlib.sha256(before.encode("ascii") + dump_json(form)).hexdigest()


def not_following(where: str, cure: str) -> RecordError:
    """Return the error for a journal line whose link does not match the lines before it."""
    return RecordError(f"{where} does not match the lines before it: a line was changed, removed or moved. {cure}.")


def linked_forms(
    path: Path, lines: Iterable[bytes], *, cure: str, first: int = 1, before: str = "", needed: bool = True
) -> Iterator[tuple[dict[str, Any], str]]:
    """Check the link of each line. For each line, yield its JSON object without the link, and the link.

    Args:
        path: Path of the file, for errors.
        lines: All lines, or the lines after those that have already been read.
        cure: Remedy for a changed line, for errors.
        first: Number of the first line in ``lines``.
        before: Link of the line before ``lines``.
        needed: False if the file may begin with lines of earlier versions, which have no links. A warning is then
            logged.

    Raises:
        RecordError: If a line is not a JSON object, or if its link does not match the lines before it.
    """
    linked = needed
    for number, line in enumerate(lines, start=first):
        where = f"{path}: line {number}"
        with form_errors(f"{where} is corrupt", cure, RecordError):
            form = parse_json(line, unique=True)
            if not isinstance(form, dict):
                raise RecordError(f"{where} is corrupt: it is not a JSON object. {cure}.")
            told = form.pop(LINK, None)
            if told is None and not linked:
                say_unsealed(str(path))
                yield form, ""
                continue
            linked, before = True, link_after(before, form)
        if told != before:
            raise not_following(where, cure)
        yield form, before


def _require_begun(path: Path, begun: bytes) -> None:
    """Raise RecordError unless ``begun`` is the beginning of a line, or a zero byte left behind by a machine crash."""
    if begun not in (b"{", b"\0"):
        raise RecordError(
            f"{path}: the end of the file is not an unfinished journal line. Restore the file from a copy."
        )


def complete_lines(path: Path) -> tuple[list[bytes], int]:
    """Return the complete lines of a file and their total size [byte]. A missing file has no lines.

    Text after the last line break is ignored, because it is incomplete or still being written.
    """
    try:
        data = read_bounded(path, max_bytes=MAX_BYTES, cure="Restore the file from a copy", raises=RecordError)
    except RecordError as error:
        if isinstance(error.__cause__, FileNotFoundError) and not path.is_symlink():
            return [], 0
        raise
    length = data.rfind(b"\n") + 1
    return data[:length].split(b"\n")[:-1], length


def say_lost_tail(path: Path) -> None:
    """Warn that the incomplete last line of a file is ignored, unless a process is still writing to the file."""
    if is_locked(path.parent / LOCK_NAME):
        return
    with open_ordinary(path) as file:
        size = file.seek(0, os.SEEK_END)
        lost = size > 0 and (file.seek(size - 1), file.read(1))[1] != b"\n"
    if lost:
        logger.warning("%s: its last line is incomplete and is ignored", path)
