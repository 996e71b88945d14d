"""Columns of a record, and their conversion to and from Parquet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from betterbench.errors import RecordError

Widths = Mapping[str, int]
"""Number of items per row for each name in ``WIDTH_NAMES``."""

WIDTH_NAMES = ("nq", "nv", "na", "nu", "joints", "action", "objects", "predicates", "subgoals")


class Column(NamedTuple):
    """Column of a record. The field of the record and the Parquet column have the same name.

    Attributes:
        kind: Data type of each value.
        width: Name in ``WIDTH_NAMES`` of the number of items per row ("objects"), or None if there is one item per row.
        tail: Number of values that make up an item (3 for a position).
    """

    name: str
    kind: Literal["float64", "bool", "int16"]
    width: str | None = None
    tail: int = 1

    def size(self, widths: Widths) -> int:
        """Return the number of values per row."""
        return self.tail if self.width is None else widths[self.width] * self.tail

    def shape(self, rows: int, widths: Widths) -> tuple[int, ...]:
        """Return the shape of the column's array in a record."""
        shape = (rows,) if self.width is None else (rows, widths[self.width])
        return shape if self.tail == 1 else (*shape, self.tail)


COLUMNS: tuple[Column, ...] = (
    Column("time", "float64"),
    Column("qpos", "float64", "nq"),
    Column("qvel", "float64", "nv"),
    Column("act", "float64", "na"),
    Column("ctrl", "float64", "nu"),
    Column("action", "float64", "action"),
    Column("applied", "float64", "action"),
    Column("ee_position", "float64", None, 3),
    Column("ee_quaternion", "float64", None, 4),
    Column("commanded_position", "float64", None, 3),
    Column("commanded_quaternion", "float64", None, 4),
    Column("finger_width", "float64"),
    Column("gripper_command", "float64"),
    Column("joint_positions", "float64", "joints"),
    Column("joint_velocities", "float64", "joints"),
    Column("object_positions", "float64", "objects", 3),
    Column("object_quaternions", "float64", "objects", 4),
    Column("object_linear_speeds", "float64", "objects"),
    Column("object_angular_speeds", "float64", "objects"),
    Column("held", "int16"),
    Column("predicates", "bool", "predicates"),
    Column("subgoals", "bool", "subgoals"),
    Column("goal", "bool"),
    Column("forbidden", "bool"),
)
"""All columns with a fixed number of values per row. Contacts are stored separately, because their number varies."""

CONTACTS = "contacts"
"""Name of the Parquet column that contains the contacts of each row."""

_NUMBERS = {"float64": pa.float64(), "bool": pa.bool_(), "int16": pa.int16()}
_CONTACT_FIELDS = [
    pa.field("a", pa.int16(), nullable=False),
    pa.field("b", pa.int16(), nullable=False),
    pa.field("force", pa.float64(), nullable=False),
]


@dataclass(frozen=True, slots=True, eq=False)
class Contacts:
    """Contacts of all rows, concatenated.

    Attributes:
        offsets: Start of each row's contacts (T + 1,) int32. Row ``t`` has the contacts from ``offsets[t]`` up to, but
            not including, ``offsets[t + 1]``.
        bodies: Both bodies of each contact (C, 2) int16, as indices into the record's list of body names.
        forces: Normal force of each contact (C,) [N].
    """

    offsets: npt.NDArray[np.int32]
    bodies: npt.NDArray[np.int16]
    forces: npt.NDArray[np.float64]


def arrow_schema(widths: Widths) -> pa.Schema:
    """Return the Parquet schema of a record with the given widths. Columns of width zero are omitted."""
    fields = []
    for column in COLUMNS:
        number = _NUMBERS[column.kind]
        size = column.size(widths)
        if column.width is None and column.tail == 1:
            fields.append(pa.field(column.name, number, nullable=False))
        elif size:
            item = pa.field("element", number, nullable=False)
            fields.append(pa.field(column.name, pa.list_(item, size), nullable=False))
    contact = pa.field("element", pa.struct(_CONTACT_FIELDS), nullable=False)
    fields.append(pa.field(CONTACTS, pa.list_(contact), nullable=False))
    return pa.schema(fields)


def to_table(arrays: Mapping[str, npt.NDArray[np.generic]], contacts: Contacts, widths: Widths) -> pa.Table:
    """Convert the columns of a record to a Parquet table."""
    schema = arrow_schema(widths)
    parts: list[pa.Array] = []
    for field in schema:
        if field.name == CONTACTS:
            item = pa.StructArray.from_arrays(
                [
                    pa.array(np.ascontiguousarray(contacts.bodies[:, 0])),
                    pa.array(np.ascontiguousarray(contacts.bodies[:, 1])),
                    pa.array(contacts.forces),
                ],
                fields=_CONTACT_FIELDS,
            )
            parts.append(pa.ListArray.from_arrays(pa.array(contacts.offsets), item, type=field.type))
            continue
        values = pa.array(np.ascontiguousarray(arrays[field.name]).reshape(-1))
        if pa.types.is_fixed_size_list(field.type):
            values = pa.FixedSizeListArray.from_arrays(values, type=field.type)
        parts.append(values)
    return pa.Table.from_arrays(parts, schema=schema)


def from_table(table: pa.Table, widths: Widths, bodies: int) -> tuple[dict[str, npt.NDArray[np.generic]], Contacts]:
    """Convert a table with the schema ``arrow_schema(widths)``. Return the columns by name, and the contacts.

    Raises:
        RecordError: If an index is out of range.
    """
    rows = table.num_rows
    arrays: dict[str, npt.NDArray[np.generic]] = {}
    for column in COLUMNS:
        shape = column.shape(rows, widths)
        if column.size(widths) == 0:
            arrays[column.name] = np.zeros(shape, dtype=column.kind)
            continue
        chunk = table.column(column.name).combine_chunks()
        flat = chunk.flatten() if pa.types.is_fixed_size_list(chunk.type) else chunk
        arrays[column.name] = flat.to_numpy(zero_copy_only=False).reshape(shape)
    listed = table.column(CONTACTS).combine_chunks()
    offsets = listed.offsets.to_numpy()
    items = listed.flatten()
    pairs = np.stack([items.field(0).to_numpy(), items.field(1).to_numpy()], axis=1)
    held = arrays["held"].astype(np.int64)
    if pairs.size and (pairs.min() < 0 or pairs.max() >= bodies):
        raise RecordError("a contact refers to a body that the record does not list; record the trial again")
    if held.min() < -1 or held.max() >= widths["objects"]:
        raise RecordError("the held object is not in the scene; record the trial again")
    return arrays, Contacts((offsets - offsets[0]).astype(np.int32), pairs, items.field(2).to_numpy())
