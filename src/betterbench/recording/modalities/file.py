"""Files of modalities: written row group by row group beside their place, read row by row."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from betterbench.errors import BetterError, RecordError
from betterbench.json_form import open_ordinary, read_form
from betterbench.recording.durable import DurableFile
from betterbench.recording.metadata import dump_json
from betterbench.recording.modalities.columns import (
    ViewColumn,
    chunk_rows,
    from_batch,
    to_batch,
    view_columns,
    view_schema,
)
from betterbench.recording.modalities.header import HEADER, ViewHeader

HEADER_KEY = b"betterbench.modalities"
"""Key of the header's JSON in the metadata of the Parquet schema."""

COMPRESSION_LEVEL = 1
"""Level of zstd: a row group holds the same scene many times, which every level finds; higher ones cost time only."""

AGAIN = "The same better materialize command draws it again"
"""What to do about a file that cannot be read."""

_MAX_HEADER_BYTES = 1 << 20
_MAX_ROWS = 10_000_000


class ModalityWriter:
    """Writes one file; it stands at its place when it is finished, and not before.

    A context manager, which removes what is not finished. The same rows give the same bytes on one installation. Raises
    OSError if the disk is full or may not be written.
    """

    def __init__(self, path: Path, columns: tuple[ViewColumn, ...]) -> None:
        self.columns = columns
        self._path, self._rows = path, 0
        self._chunk = chunk_rows(self.columns)
        self._kept: list[dict[str, np.ndarray]] = []
        self._file = DurableFile(path)
        self._writer = pq.ParquetWriter(
            self._file.file,
            view_schema(self.columns),
            compression="zstd",
            compression_level=COMPRESSION_LEVEL,
            use_dictionary=False,
            write_statistics=False,
            write_page_checksum=True,
        )

    def append(self, values: dict[str, np.ndarray]) -> None:
        """Append the values of one row by column, but for ``row``, which is counted."""
        self._kept.append({**values, "row": np.array(self._rows, np.int32)})
        self._rows += 1
        if len(self._kept) == self._chunk:
            self._flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(OSError, pa.ArrowException, ValueError):  # of a full disk, told before
            self._writer.close()
        self._file.__exit__(kind, error, trace)

    def finish(self, header: ViewHeader) -> Path:
        """Write what the file says about itself, force it to disk and put it at its place, which is returned."""
        self._flush()
        self._writer.add_key_value_metadata({HEADER_KEY: dump_json(HEADER.dump_python(header, mode="json"))})
        self._writer.close()
        self._file.finish()
        return self._path

    def _flush(self) -> None:
        if self._kept:
            stacked = {c.name: np.stack([values[c.name] for values in self._kept]) for c in self.columns}
            self._kept.clear()
            table = to_batch(self.columns, stacked)
            self._writer.write_table(table, row_group_size=table.num_rows)


class ModalityFile:
    """A file of modalities, open for reading any of its rows; a context manager.

    Raises RecordError if it is missing, damaged, of another version, or holds something else than its header says.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with _reading(path):
            self._source = open_ordinary(path)
            self._file = pq.ParquetFile(self._source, page_checksum_verification=True, memory_map=False)
            try:
                self.header = self._checked_header()
                self.columns = view_columns(self.header.view, self.header.modalities, len(self.header.objects))
                self._check()
            except BaseException:
                self._file.close(force=True)
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
        """Return the values of one row by column, of all columns or some; arrays are read-only.

        The row group of the row is read, and kept for its neighbors.

        Raises:
            IndexError: If there is no such row.
            RecordError: If the row is damaged, or a column is not there.
        """
        if not 0 <= row < len(self):
            msg = f"row {row} of a file with {len(self)} rows"
            raise IndexError(msg)
        names = tuple(c.name for c in self.columns) if columns is None else tuple(columns)
        group, place = divmod(row, self._chunk)
        if self._last is None or self._last[:2] != (group, names):
            self._last = group, names, self._group(group, names)
        return {name: values[place] for name, values in self._last[2].items()}

    def rows(self, columns: Sequence[str] | None = None) -> Iterator[dict[str, np.ndarray]]:
        """Yield the values of every row; raises what :meth:`read` raises."""
        for row in range(len(self)):
            yield self.read(row, columns)

    def check(self) -> int:
        """Read everything, which compares all checksums, and return the number of rows; raises what read raises."""
        for group in range(self._file.metadata.num_row_groups):
            self._group(group, tuple(c.name for c in self.columns))
        return len(self)

    def close(self) -> None:
        """Close the file; harmless when closed."""
        self._last = None
        self._file.close(force=True)

    def _group(self, group: int, names: tuple[str, ...]) -> dict[str, np.ndarray]:
        known = [c.name for c in self.columns]
        missing = [name for name in names if name not in known]
        if missing:
            raise RecordError(
                f"{self.path}: has no column {missing[0]!r}. It has {', '.join(known)}; materialize the others too."
            )
        with _reading(self.path):
            return from_batch(self.columns, self._file.read_row_group(group, columns=list(names)))

    def _checked_header(self) -> ViewHeader:
        raw = (self._file.metadata.metadata or {}).get(HEADER_KEY)
        if not isinstance(raw, bytes) or len(raw) > _MAX_HEADER_BYTES:
            raise RecordError(f"{self.path}: is a Parquet file without modalities. Choose one of better materialize.")
        return read_form(HEADER, raw, where=str(self.path), cure=AGAIN, raises=RecordError)

    def _check(self) -> None:
        """Refuse other columns than the header says, and row groups of another size."""
        meta, chunk = self._file.metadata, chunk_rows(self.columns)
        sizes = [meta.row_group(i).num_rows for i in range(meta.num_row_groups)]
        fits = all(size == chunk for size in sizes[:-1]) and (not sizes or 0 < sizes[-1] <= chunk)
        if not fits or meta.num_rows > _MAX_ROWS:
            raise RecordError(f"{self.path}: its row groups do not hold {chunk} rows. {AGAIN}.")
        if not self._file.schema_arrow.equals(view_schema(self.columns), check_metadata=False):
            raise RecordError(f"{self.path}: its columns are not those of its header. {AGAIN}.")


def fault_text(path: Path, problem: RecordError) -> str:
    """Return what an error about a file says is wrong with it, without its name and the cure."""
    return str(problem).removeprefix(f"{path}: ").removesuffix(f". {AGAIN}.").rstrip(".")


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Turn what reading a damaged file can raise into an error that names it."""
    try:
        yield
    except BetterError:
        raise
    except FileNotFoundError:
        raise RecordError(f"{path}: there is no such file. Run better materialize for the trial.") from None
    except Exception as error:  # what native code raises about a damaged file
        said = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise RecordError(f"{path}: is damaged ({said}). {AGAIN}.") from error
