"""Parquet files that store arrays of equal length.

Each array is one column. For a two-dimensional array, each cell of the column is a list of fixed size.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from betterbench.errors import RecordError, one_line
from betterbench.json_form import read_bounded
from betterbench.records.parquet import COMPRESSION_LEVEL, unpacked_bytes

MAX_BYTES = 1 << 28
"""Maximum size of a file that is read [byte]."""

MAX_UNPACKED_BYTES = 1 << 29
"""Maximum size of all columns after decompression [byte]."""

_KINDS = {"number": (pa.float64(), np.float64), "boolean": (pa.bool_(), np.bool_)}

Column = tuple[str, int]
"""Kind ("number" or "boolean") and width of a column. The width is 0 if there is one value per row."""


def array_bytes(columns: Mapping[str, Column], arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return a Parquet file (zstd) with arrays (rows,) or (rows, width) as bytes. Equal arrays give equal bytes."""
    schema = pa.schema([(name, _type(column)) for name, column in columns.items()])
    made = []
    for name, (kind, width) in columns.items():
        flat = pa.array(np.ascontiguousarray(arrays[name]).ravel(), type=_KINDS[kind][0])
        made.append(pa.FixedSizeListArray.from_arrays(flat, width) if width else flat)
    buffer = io.BytesIO()
    table = pa.Table.from_arrays([a.cast(f.type) for a, f in zip(made, schema, strict=True)], schema=schema)
    pq.write_table(table, buffer, compression="zstd", compression_level=COMPRESSION_LEVEL)
    return buffer.getvalue()


def read_arrays(path: Path, columns: Mapping[str, Column], *, cure: str) -> dict[str, np.ndarray]:
    """Read the arrays in a file and return them by column name, each (rows,) or (rows, width). Numbers may be NaN.

    Raises:
        RecordError: If the file cannot be read or is too large, or if a column is missing, has an unexpected type or
            has empty cells.
    """
    raw = read_bounded(path, max_bytes=MAX_BYTES, cure=cure, raises=RecordError)
    try:
        with pq.ParquetFile(pa.BufferReader(raw)) as file:
            if unpacked_bytes(file) > MAX_UNPACKED_BYTES:
                raise RecordError(f"{path}: the file unpacks to more than {MAX_UNPACKED_BYTES} bytes. {cure}.")
            table = file.read()
    except (OSError, pa.ArrowException) as error:
        raise RecordError(f"{path}: the file is not readable as Parquet ({one_line(error)}). {cure}.") from error
    found = {}
    for name, column in columns.items():
        if name not in table.column_names:
            raise RecordError(f"{path}: the file has no column {name!r}. {cure}.")
        given = table.column(name)
        if given.type != _type(column) or given.null_count:
            wanted = "is not of type" if given.type != _type(column) else "has empty cells; expected"
            raise RecordError(f"{path}: column {name!r} {wanted} {_type(column)}. {cure}.")
        found[name] = _array(given.combine_chunks(), column)
    return found


def _type(column: Column) -> Any:  # noqa: ANN401 - of pyarrow
    kind, width = column
    return pa.list_(_KINDS[kind][0], width) if width else _KINDS[kind][0]


def _array(given: Any, column: Column) -> np.ndarray:  # noqa: ANN401 - of pyarrow
    kind, width = column
    flat = given.flatten() if width else given
    values: np.ndarray = np.asarray(flat.to_numpy(zero_copy_only=False), dtype=_KINDS[kind][1])
    return values.reshape(-1, width) if width else values
