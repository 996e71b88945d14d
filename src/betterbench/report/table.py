"""Tables as values, and their CSV form."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

from betterbench.errors import printable
from betterbench.report.html import LONGEST_TEXT

Scalar = str | int | float | bool | None
"""What a cell of a plain table holds; None is an empty cell."""

_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")
"""A spreadsheet takes a text with such a beginning for a formula (OWASP, "CSV Injection")."""


@dataclass(frozen=True, slots=True)
class Table:
    """A plain table, each row as long as the columns; ``name`` is a file name without its ending."""

    name: str
    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Scalar, ...], ...]


def to_csv(table: Table) -> str:
    """Return a table as CSV (RFC 4180): one header line, CRLF line ends, UTF-8.

    Texts that a spreadsheet would run as a formula get an apostrophe in front. Numbers are written as numbers; the full
    precision of a fraction is kept.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(_guard(column) for column in table.columns)
    writer.writerows([_cell(value) for value in row] for row in table.rows)
    return buffer.getvalue()


def _cell(value: Scalar) -> str:
    """Return the text of a cell."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return f"{value:.12g}" if isinstance(value, float) else str(value)
    return _guard(value)


def _guard(text: str) -> str:
    """Return a text of bounded length that no spreadsheet takes for a formula."""
    text = printable(text, most=LONGEST_TEXT)
    return f"'{text}" if text.lstrip(" ").startswith(_FORMULA_STARTS) else text
