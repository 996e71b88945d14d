"""Modality files. They are written in row groups and read row by row.

The footer contains the header, its own checksum, and the SHA-256 of each row group. All checksums are verified before
the bytes are passed to the Parquet reader, which is native code.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import TypeAdapter

from betterbench.errors import BetterError, RecordError
from betterbench.jobs.durable import DurableFile
from betterbench.json_form import dump_json, read_form
from betterbench.records.modalities.columns import (
    ViewColumn,
    chunk_rows,
    from_batch,
    to_batch,
    view_columns,
    view_schema,
)
from betterbench.records.modalities.header import HEADER, ViewHeader
from betterbench.records.parquet import NO_DIGEST, SEAL_KEY, seal

HEADER_KEY = b"betterbench.modalities"
"""Key of the header's JSON in the metadata of the Parquet schema."""

GROUPS_KEY = b"betterbench.groups"
"""Key of a JSON list with the end of each row group [byte] and the SHA-256 of the group's bytes."""

COMPRESSION_LEVEL = 1
"""Compression level of zstd. Higher levels take longer and do not find more of the repetitions in a row group."""

_GROUPS = TypeAdapter(tuple[tuple[int, str], ...])

AGAIN = "Run the same `better materialize` command again to recreate it"
"""Remedy to suggest for a file that cannot be read."""

_MAX_HEADER_BYTES = 1 << 20
_MAX_ROWS = 10_000_000
_MAX_FOOTER_BYTES = 1 << 26
_MAGIC = b"PAR1"
_TAIL = 8
"""Size of the end of a Parquet file [byte], which consists of the footer's length and a magic number."""


class _Sink(io.RawIOBase):
    """Output stream that hashes each row group. The footer is written only after its checksum has been computed."""

    def __init__(self, file: BinaryIO) -> None:
        super().__init__()
        self._file, self._digest, self._at = file, hashlib.sha256(), 0
        self._footer: bytearray | None = None
        self.groups: list[tuple[int, str]] = []

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:  # noqa: ANN401 - a buffer
        view = memoryview(data).cast("B")
        if self._footer is not None:
            self._footer += view
        else:
            self._file.write(view)
            self._digest.update(view)
            self._at += len(view)
        return len(view)

    def end_group(self) -> None:
        """Mark the end of a row group."""
        self.groups.append((self._at, self._digest.hexdigest()))
        self._digest = hashlib.sha256()

    def begin_footer(self) -> None:
        """Mark the end of all row groups."""
        self._footer = bytearray()

    def end_footer(self) -> None:
        """Write the footer with its checksum."""
        self._file.write(seal(bytes(self._footer or b"")))


class ModalityWriter:
    """Writer of a modality file. The file is moved to its path only when it is complete.

    When the context manager exits, an incomplete file is removed. Within one installation, equal rows give equal bytes.
    Raises OSError if the disk is full or not writable.
    """

    def __init__(self, path: Path, columns: tuple[ViewColumn, ...]) -> None:
        self.columns = columns
        self._path, self._rows = path, 0
        self._chunk = chunk_rows(self.columns)
        self._kept: list[dict[str, np.ndarray]] = []
        self._file = DurableFile(path)
        self._sink = _Sink(self._file.file)
        self._writer = pq.ParquetWriter(
            pa.PythonFile(self._sink, mode="w"),
            view_schema(self.columns),
            compression="zstd",
            compression_level=COMPRESSION_LEVEL,
            use_dictionary=False,
            write_statistics=False,
            write_page_checksum=True,
        )

    def append(self, values: dict[str, np.ndarray]) -> None:
        """Append one row, given as the value of each column by name. The column ``row`` is filled automatically."""
        self._kept.append({**values, "row": np.array(self._rows, np.int32)})
        self._rows += 1
        if len(self._kept) == self._chunk:
            self._flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # the error of a full disk has already been raised
        with contextlib.suppress(OSError, pa.ArrowException, ValueError):
            self._writer.close()
        self._file.__exit__(kind, error, trace)

    def finish(self, header: ViewHeader) -> Path:
        """Write the header, sync the file to disk, move it to its path and return the path."""
        self._flush()
        told = {
            HEADER_KEY: dump_json(HEADER.dump_python(header, mode="json")),
            GROUPS_KEY: dump_json(self._sink.groups),
        }
        self._writer.add_key_value_metadata({**told, SEAL_KEY: NO_DIGEST})
        self._sink.begin_footer()
        self._writer.close()
        self._sink.end_footer()
        self._file.finish()
        return self._path

    def _flush(self) -> None:
        if self._kept:
            stacked = {c.name: np.stack([values[c.name] for values in self._kept]) for c in self.columns}
            self._kept.clear()
            table = to_batch(self.columns, stacked)
            self._writer.write_table(table, row_group_size=table.num_rows)
            self._sink.end_group()


class ModalityFile:
    """Modality file that is open for reading individual rows. It is a context manager.

    Raises:
        RecordError: If the file is missing, damaged, of a different version, or does not match its header.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with _reading(path):
            self._source: int | None = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            try:
                footer = self._checked_footer()
                self._file = pq.ParquetFile(path, page_checksum_verification=True, memory_map=False)
            except BaseException:
                os.close(self._source)
                raise
            try:
                self.header = self._checked_header()
                self._groups = self._checked_groups(footer)
                self.columns = view_columns(self.header.view, self.header.modalities, len(self.header.objects))
                self._check()
            except BaseException:
                self.close()
                raise
        self._chunk = chunk_rows(self.columns)
        self._last: tuple[int, tuple[str, ...], dict[str, np.ndarray]] | None = None

    def __len__(self) -> int:
        return int(self._file.metadata.num_rows)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def read(self, row: int, columns: Sequence[str] | None = None) -> dict[str, np.ndarray]:
        """Read one row and return the values of all columns, or only of the given ones. The arrays are read-only.

        The whole row group is read and cached for neighboring rows.

        Raises:
            IndexError: If the row does not exist.
            RecordError: If the row is damaged or a column is missing.
        """
        if not 0 <= row < len(self):
            msg = f"row {row} does not exist in a file with {len(self)} rows"
            raise IndexError(msg)
        names = tuple(c.name for c in self.columns) if columns is None else tuple(columns)
        group, place = divmod(row, self._chunk)
        if self._last is None or self._last[:2] != (group, names):
            self._last = group, names, self._group(group, names)
        return {name: values[place] for name, values in self._last[2].items()}

    def rows(self, columns: Sequence[str] | None = None) -> Iterator[dict[str, np.ndarray]]:
        """Yield the values of every row. Raises the same errors as :meth:`read`."""
        for row in range(len(self)):
            yield self.read(row, columns)

    def check(self) -> int:
        """Read the whole file, verify all checksums, and return the number of rows."""
        for group in range(self._file.metadata.num_row_groups):
            self._group(group, tuple(c.name for c in self.columns))
        return len(self)

    def close(self) -> None:
        """Close the file. Closing it again does nothing."""
        self._last = None
        self._file.close()
        if self._source is not None:
            os.close(self._source)
            self._source = None

    def _group(self, group: int, names: tuple[str, ...]) -> dict[str, np.ndarray]:
        known = [c.name for c in self.columns]
        missing = [name for name in names if name not in known]
        if missing:
            raise RecordError(
                f"{self.path}: has no column {missing[0]!r}. It has {', '.join(known)}. Materialize the missing "
                "modalities too."
            )
        with _reading(self.path):
            (begin, _), (end, digest) = self._groups[group - 1] if group else (0, ""), self._groups[group]
            if hashlib.sha256(self._bytes(begin, end)).hexdigest() != digest:
                raise RecordError(
                    f"{self.path}: is damaged (the checksum of row group {group} does not match). {AGAIN}."
                )
            return from_batch(self.columns, self._file.read_row_group(group, columns=list(names)))

    def _bytes(self, begin: int, end: int) -> bytes:
        if self._source is None:
            msg = f"{self.path}: the file is closed"
            raise ValueError(msg)
        return os.pread(self._source, end - begin, begin)

    def _checked_footer(self) -> int:
        """Verify the checksum of the footer, and return the footer's offset [byte].

        Raises RecordError if the checksum does not match.
        """
        size = os.fstat(self._source or 0).st_size
        tail = self._bytes(max(0, size - _TAIL), size)
        length = int.from_bytes(tail[:4], "little")
        begin = size - _TAIL - length
        if tail[4:] != _MAGIC or begin < len(_MAGIC) or length > _MAX_FOOTER_BYTES:
            raise RecordError(f"{self.path}: is damaged (its end is missing). {AGAIN}.")
        footer = self._bytes(begin, size)
        if SEAL_KEY not in footer:
            raise RecordError(
                f"{self.path}: has no checksum, because an earlier version wrote it or it is damaged. {AGAIN}."
            )
        try:
            intact = seal(footer) == footer
        except RecordError:
            intact = False
        if not intact:
            raise RecordError(f"{self.path}: is damaged (its checksum does not match). {AGAIN}.")
        return begin

    def _checked_groups(self, footer: int) -> tuple[tuple[int, str], ...]:
        """Return the end offset [byte] and the digest of each row group.

        Raises RecordError if they do not match the file.
        """
        raw = (self._file.metadata.metadata or {}).get(GROUPS_KEY, b"")
        found = read_form(_GROUPS, raw, where=f"{self.path}: row groups", cure=AGAIN, raises=RecordError)
        ends = [0, *(end for end, _ in found)]
        if len(found) != self._file.metadata.num_row_groups or ends != sorted(ends) or (found and ends[-1] != footer):
            raise RecordError(f"{self.path}: its row groups do not match its header. {AGAIN}.")
        return found

    def _checked_header(self) -> ViewHeader:
        raw = (self._file.metadata.metadata or {}).get(HEADER_KEY)
        if not isinstance(raw, bytes) or len(raw) > _MAX_HEADER_BYTES:
            raise RecordError(
                f"{self.path}: is a Parquet file without modalities. Choose a file written by `better materialize`."
            )
        return read_form(HEADER, raw, where=str(self.path), cure=AGAIN, raises=RecordError)

    def _check(self) -> None:
        """Raise RecordError if the columns or the sizes of the row groups do not match the header."""
        meta, chunk = self._file.metadata, chunk_rows(self.columns)
        sizes = [meta.row_group(i).num_rows for i in range(meta.num_row_groups)]
        fits = all(size == chunk for size in sizes[:-1]) and (not sizes or 0 < sizes[-1] <= chunk)
        if not fits or meta.num_rows > _MAX_ROWS:
            raise RecordError(f"{self.path}: its row groups do not have {chunk} rows. {AGAIN}.")
        if not self._file.schema_arrow.equals(view_schema(self.columns), check_metadata=False):
            raise RecordError(f"{self.path}: its columns do not match its header. {AGAIN}.")


def fault_text(path: Path, problem: RecordError) -> str:
    """Return the message of an error about a modality file, without the file name and the remedy."""
    return str(problem).removeprefix(f"{path}: ").removesuffix(f". {AGAIN}.").rstrip(".")


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Context manager that converts exceptions from reading a damaged file to an error that names the file."""
    try:
        yield
    except BetterError:
        raise
    except FileNotFoundError:
        raise RecordError(f"{path}: the file does not exist. Run `better materialize` for the trial.") from None
    except Exception as error:  # native code may raise any exception for a damaged file
        said = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise RecordError(f"{path}: is damaged ({said}). {AGAIN}.") from error
