"""Plain tables, and their CSV form."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

from betterbench.quoting import csv_text

Scalar = str | int | float | bool | None
"""Value of a cell in a plain table; None for an empty cell."""


@dataclass(frozen=True, slots=True)
class Table:
    """Plain table, in which each row has one value per column. ``name`` is the file name without extension."""

    name: str
    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Scalar, ...], ...]


def to_csv(table: Table) -> str:
    """Return a table as CSV (RFC 4180) with one header line, CRLF line ends and UTF-8.

    A text that a spreadsheet would evaluate as a formula gets a leading apostrophe. Numbers keep their full precision.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(csv_text(column) for column in table.columns)
    writer.writerows([_cell(value) for value in row] for row in table.rows)
    return buffer.getvalue()


def _cell(value: Scalar) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return f"{value:.12g}" if isinstance(value, float) else str(value)
    return csv_text(value)
