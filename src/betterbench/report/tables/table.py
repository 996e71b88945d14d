"""Tables as values, and their CSV form."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

from betterbench.quoting import csv_text

Scalar = str | int | float | bool | None
"""Cell value of a plain table; None for an empty cell."""


@dataclass(frozen=True, slots=True)
class Table:
    """A plain table with rows as long as its columns; ``name`` is a file name without extension."""

    name: str
    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Scalar, ...], ...]


def to_csv(table: Table) -> str:
    """Return a table as CSV (RFC 4180): one header line, CRLF line ends, UTF-8.

    Texts that a spreadsheet would evaluate as a formula get a leading apostrophe. Numbers keep their full precision.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(csv_text(column) for column in table.columns)
    writer.writerows([_cell(value) for value in row] for row in table.rows)
    return buffer.getvalue()


def _cell(value: Scalar) -> str:
    """Return a cell's text."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return f"{value:.12g}" if isinstance(value, float) else str(value)
    return csv_text(value)
