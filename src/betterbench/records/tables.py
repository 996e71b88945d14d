"""Parquet tables of strings, numbers and lists, for use with other tools."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import pyarrow as pa
import pyarrow.parquet as pq

from betterbench.records.parquet import COMPRESSION_LEVEL

PlainCell = str | int | float | bool | None | Sequence[str] | Sequence[int]

_KINDS = {
    "text": pa.string(),
    "integer": pa.int64(),
    "number": pa.float64(),
    "texts": pa.list_(pa.string()),
    "integers": pa.list_(pa.int64()),
}


def table_bytes(
    columns: Mapping[str, str], rows: Sequence[Mapping[str, PlainCell]], metadata: Mapping[str, str]
) -> bytes:
    """Encode rows as a Parquet file (zstd). Within one installation, equal rows give equal bytes.

    Args:
        columns: Kind of each column by name: "text", "integer", "number", "texts" or "integers". Any cell may be None.
        rows: Rows to encode. Missing cells are None.
        metadata: Strings to store in the metadata of the file's schema.
    """
    schema = pa.schema([(name, _KINDS[kind]) for name, kind in columns.items()], metadata=dict(metadata))
    arrays = [pa.array([row.get(name) for row in rows], type=_KINDS[kind]) for name, kind in columns.items()]
    buffer = io.BytesIO()
    pq.write_table(
        pa.Table.from_arrays(arrays, schema=schema), buffer, compression="zstd", compression_level=COMPRESSION_LEVEL
    )
    return buffer.getvalue()
