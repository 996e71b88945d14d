"""Reader of Parquet files written by other programs. Large cells are loaded only when they are needed."""

from __future__ import annotations

import bisect
import itertools
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from betterbench.errors import InvalidInputError, one_line

_CURE = "Download the file again"


class ParquetRows:
    """Parquet file written by another program. Several threads may read it.

    :meth:`cell` keeps only one row group of one column in memory. A file with embedded images may therefore be larger
    than the memory.
    """

    def __init__(self, path: Path) -> None:
        """Open a file. Raises InvalidInputError if it is not a readable Parquet file."""
        self._path, self._lock = path, threading.Lock()
        try:
            self._file = pq.ParquetFile(path)
        except (OSError, pa.ArrowException) as error:
            raise InvalidInputError(str(path), f"is not readable as Parquet ({one_line(error)})", _CURE) from error
        sizes = [self._file.metadata.row_group(i).num_rows for i in range(self._file.num_row_groups)]
        self._ends = list(itertools.accumulate(sizes))
        self._held: tuple[int, str] | None = None
        self._cells: list[Any] = []

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self._file.schema_arrow.names)

    @property
    def count(self) -> int:
        """Number of rows."""
        return int(self._file.metadata.num_rows)

    def rows(self, columns: Sequence[str]) -> list[dict[str, Any]]:
        """Return all rows with the given columns. Raises InvalidInputError if the file is damaged."""
        with self._lock:
            try:
                rows: list[dict[str, Any]] = self._file.read(columns=list(columns)).to_pylist()
            except (OSError, pa.ArrowException) as error:
                raise InvalidInputError(str(self._path), f"is damaged ({one_line(error)})", _CURE) from error
        return rows

    def cell(self, row: int, column: str) -> Any:  # noqa: ANN401 - any value of Parquet
        """Return one cell. Raises InvalidInputError if the file is damaged."""
        group = bisect.bisect_right(self._ends, row)
        with self._lock:
            if self._held != (group, column):
                try:
                    self._cells = self._file.read_row_group(group, columns=[column]).column(0).to_pylist()
                except (OSError, pa.ArrowException) as error:
                    raise InvalidInputError(str(self._path), f"is damaged ({one_line(error)})", _CURE) from error
                self._held = (group, column)
            return self._cells[row - (self._ends[group - 1] if group else 0)]
