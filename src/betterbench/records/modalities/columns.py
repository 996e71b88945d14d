"""Columns of a modality file. The file has one row for each row of the record."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from betterbench.records.modalities.spec import MODALITIES, ViewSpec


class ViewColumn(NamedTuple):
    """Column of a modality file: the name of the column, and the data type and shape of its values.

    In Parquet, an image is a fixed number of bytes. All other values are numbers or lists of fixed length.
    """

    name: str
    number: str
    shape: tuple[int, ...]
    is_image: bool = False

    @property
    def kind(self) -> np.dtype[np.generic]:
        """Data type of each number, little-endian."""
        return np.dtype(self.number)

    @property
    def size(self) -> int:
        """Number of values per row."""
        return int(np.prod(self.shape, dtype=np.int64))

    @property
    def row_bytes(self) -> int:
        """Number of bytes per row."""
        return self.size * self.kind.itemsize

    def arrow_type(self) -> pa.DataType:
        """Return the Parquet type of the column."""
        if self.is_image:
            return pa.binary(self.row_bytes)
        number = pa.from_numpy_dtype(self.kind)
        return pa.list_(pa.field("element", number, nullable=False), self.size) if self.shape else number


def view_columns(view: ViewSpec, modalities: Collection[str], objects: int) -> tuple[ViewColumn, ...]:
    """Return the non-empty columns of a view, for a scene with the given number of objects."""
    image, n = (view.height, view.width), objects
    images = {
        "rgb": ViewColumn("rgb", "|u1", (*image, 3), is_image=True),
        "depth": ViewColumn("depth", "<f4", image, is_image=True),
        "instances": ViewColumn("instances", "<u2", image, is_image=True),
        "semantics": ViewColumn("semantics", "<u2", image, is_image=True),
        "flow": ViewColumn("flow", "<f2", (*image, 2), is_image=True),
    }
    boxes = (
        ViewColumn("visible_box", "<i2", (n, 4)),
        ViewColumn("full_box", "<i2", (n, 4)),
        ViewColumn("visible_pixels", "<i4", (n,)),
        ViewColumn("full_pixels", "<i4", (n,)),
        ViewColumn("visible_fraction", "<f4", (n,)),
        ViewColumn("box_center_world", "<f8", (n, 3)),
        ViewColumn("box_quaternion_world", "<f8", (n, 4)),
        ViewColumn("box_center_camera", "<f8", (n, 3)),
        ViewColumn("box_quaternion_camera", "<f8", (n, 4)),
    )
    found = [
        ViewColumn("row", "<i4", ()),
        ViewColumn("time", "<f8", ()),
        ViewColumn("camera_position", "<f8", (3,)),
        ViewColumn("camera_quaternion", "<f8", (4,)),
    ]
    for modality in (name for name in MODALITIES if name in modalities):
        found += boxes if modality == "boxes" else (images[modality],)
    return tuple(column for column in found if column.size)


CHUNK_BYTES = 24 * 2**20
"""Maximum size of a row group before compression [byte], unless a single row is larger."""

MAX_CHUNK_ROWS = 32


def chunk_rows(columns: tuple[ViewColumn, ...]) -> int:
    """Return the number of rows in a row group: 32, or fewer if the images are large."""
    return max(1, min(MAX_CHUNK_ROWS, CHUNK_BYTES // sum(column.row_bytes for column in columns)))


def view_schema(columns: tuple[ViewColumn, ...]) -> pa.Schema:
    """Return the Parquet schema of the columns."""
    return pa.schema([pa.field(column.name, column.arrow_type(), nullable=False) for column in columns])


def to_batch(columns: tuple[ViewColumn, ...], values: dict[str, np.ndarray]) -> pa.Table:
    """Build a Parquet table. The values of each column are given as an array of shape (rows, *shape)."""
    parts: list[pa.Array] = []
    schema = view_schema(columns)
    for column, field in zip(columns, schema, strict=True):
        array = np.ascontiguousarray(values[column.name], dtype=column.kind)
        if column.is_image:
            parts.append(pa.Array.from_buffers(field.type, len(array), [None, pa.py_buffer(array)]))
        elif column.shape:
            parts.append(pa.FixedSizeListArray.from_arrays(pa.array(array.reshape(-1)), type=field.type))
        else:
            parts.append(pa.array(array))
    return pa.Table.from_arrays(parts, schema=schema)


def from_batch(columns: tuple[ViewColumn, ...], table: pa.Table) -> dict[str, np.ndarray]:
    """Convert a Parquet table to arrays of shape (rows, *shape), keyed by the name of the column."""
    values: dict[str, np.ndarray] = {}
    for column in columns:
        if column.name not in table.schema.names:
            continue
        chunk = table.column(column.name).combine_chunks()
        if column.is_image:
            data = chunk.buffers()[1]
            flat = np.frombuffer(data, column.kind, len(chunk) * column.size, chunk.offset * column.row_bytes)
        else:
            flat = (chunk.flatten() if column.shape else chunk).to_numpy(zero_copy_only=False)
        values[column.name] = flat.reshape(len(chunk), *column.shape)
    return values
