"""Reader for the rows of published data in JSON, JSON lines and Parquet files.

Its error messages name the file, the row and the column.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from betterbench.errors import InvalidInputError, one_line
from betterbench.json_form import parse_json, read_bounded
from betterbench.ordinary_file import open_ordinary
from betterbench.records.parquet_rows import ParquetRows

MOST_BYTES = 2 << 30
"""Maximum size of a JSON file that is read [byte]. The largest published file has 1.2 GB."""
_CURE = "Use the published file, or write the row in the published form"
_FOLDERS = ("", "data", "default", "annotations")
Span = tuple[int, int]
"""Start and end of a row in a file [byte]."""
_BLOCK = 1 << 22
_TOKEN = re.compile(rb'"[^"\\]*(?:\\.[^"\\]*)*("?)|[\[\]{}]', re.DOTALL)
"""Pattern for the strings and brackets in JSON. If a string is not terminated, the group is empty."""
_QUOTE, _BRACE, _BRACKET = b'"{['


@dataclass(frozen=True, slots=True)
class Row:
    """One row of a data file.

    Attributes:
        file: The data file.
        number: Number of the row, counted from 1.
        values: Cells of the row, keyed by column name. Large cells are left out.
        large: Function that reads a large cell, given the name of its column.
        columns: Names of all columns.
    """

    file: Path
    number: int
    values: Mapping[str, Any]
    large: Callable[[str], Any]
    columns: frozenset[str]

    def where(self, column: str) -> str:
        """Return the location of a cell (file, row and column) for an error message."""
        return f"{self.file}, row {self.number}, column {column}"

    def error(self, column: str, problem: str, cure: str = _CURE) -> InvalidInputError:
        """Return an error about a cell. It names the file, the row and the column."""
        return InvalidInputError(self.where(column), problem, cure)

    def named(self, *names: str) -> str:
        """Return the first of the given names that is a column of the row.

        Raises InvalidInputError if the row has no column with any of the names.
        """
        for name in names:
            if name in self.columns:
                return name
        other = f" (or {', '.join(names[1:])})" if len(names) > 1 else ""
        raise self.error(f"{names[0]}{other}", f"is missing. The row has {_listed(self.columns)}")

    def text(self, *names: str) -> str:
        """Return the string in the first of the given columns that exists. A number is converted to a string."""
        name = self.named(*names)
        value = self.values.get(name)
        if isinstance(value, bool) or not isinstance(value, str | int | float) or not str(value).strip():
            raise self.error(name, f"expected a string, got {_shown(value)}")
        return str(value)

    def text_or(self, otherwise: str, *names: str) -> str:
        """Return the string in the first of the given columns that exists.

        If the row has none of the columns or the cell is empty, return ``otherwise``.
        """
        value = next((self.values[name] for name in names if name in self.columns), None)
        return otherwise if value is None or not str(value).strip() else str(value)

    def integer(self, *names: str) -> int:
        """Return the integer in the first of the given columns that exists. The integer must be at least 0."""
        name = self.named(*names)
        value = self.values.get(name)
        if isinstance(value, str) and value.strip().isascii() and value.strip().isdigit() and len(value) < 10:
            value = int(value)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 1 << 40:
            raise self.error(name, f"expected an integer of at least 0, got {_shown(value)}")
        return value

    def texts(self, *names: str) -> tuple[str, ...]:
        """Return the list of strings in the first of the given columns that exists."""
        name = self.named(*names)
        value = self.values.get(name)
        if not isinstance(value, list | tuple) or not value or not all(isinstance(v, str) and v.strip() for v in value):
            raise self.error(name, f"expected a list of strings, got {_shown(value)}")
        return tuple(value)

    def letter(self, options: int, *names: str) -> str:
        """Return the letter of the correct option. The cell contains either the letter or an index from 0."""
        name = self.named(*names)
        value = self.values.get(name)
        text = str(value).strip().upper() if isinstance(value, str) else ""
        if len(text) == 1 and "A" <= text < chr(ord("A") + options):
            return text
        try:
            index = self.integer(name)
        except InvalidInputError:
            index = options
        if index >= options:
            last = chr(ord("A") + options - 1)
            raise self.error(name, f"expected a letter from A to {last} or an index from 0, got {_shown(value)}")
        return chr(ord("A") + index)


def distinct(identifier: str, taken: set[str]) -> str:
    """Make an identifier unique, and add it to the set of identifiers that are taken.

    If the identifier is already taken, a number is appended to it ("q7#2").
    """
    found, number = identifier, 1
    while found in taken:
        number += 1
        found = f"{identifier}#{number}"
    taken.add(found)
    return found


def find_files(folder: Path, suffixes: Sequence[str], *, prefix: str = "") -> list[Path]:
    """Return the data files in a folder and in subfolders with common names such as "data", sorted by path.

    If a file is given, return only this file.
    """
    if folder.is_file():
        return [folder] if folder.suffix.lower() in suffixes else []
    found = [
        path
        for name in _FOLDERS
        if (folder / name).is_dir()
        for path in (folder / name).iterdir()
        if path.suffix.lower() in suffixes and path.name.lower().startswith(prefix) and path.is_file()
    ]
    return sorted(set(found))


def read_rows(file: Path, *, large: Sequence[str]) -> list[Row]:
    """Return the rows of a JSON, JSON lines or Parquet file.

    Args:
        file: The file.
        large: Names of columns with large cells, such as embedded images. These cells are only read when they are
            needed.

    Raises:
        InvalidInputError: If the file cannot be read, or a row is not an object.
    """
    if file.suffix.lower() == ".parquet":
        return _parquet_rows(file, large)
    spans = _spans_of(file)
    if spans is not None:
        rows = _rows_at(file, spans, large)
        if rows is not None:
            return rows
    return _parsed_rows(file)


def _parsed_rows(file: Path) -> list[Row]:
    """Return the rows of a JSON document with any of the supported structures. The whole document is loaded."""
    raw = read_bounded(file, max_bytes=MOST_BYTES, cure="Use the published file")
    try:
        if file.suffix.lower() == ".jsonl":
            forms: object = [parse_json(line) for line in raw.splitlines() if line.strip()]
        else:
            forms = parse_json(raw)
    except ValueError as error:
        raise InvalidInputError(str(file), f"it is not JSON ({one_line(error)})", "Download the file again") from error
    if isinstance(forms, dict):  # some mirrors wrap the rows
        forms = next((v for v in forms.values() if isinstance(v, list)), forms)
    if not isinstance(forms, list) or not forms:
        raise InvalidInputError(str(file), "it is not a list of rows", "Use the published file")
    rows = []
    for number, form in enumerate(forms, start=1):
        if not isinstance(form, dict):
            raise InvalidInputError(f"{file}, row {number}", f"expected an object, got {_shown(form)}", _CURE)
        rows.append(Row(file, number, form, form.__getitem__, frozenset(form)))
    return rows


def _spans_of(file: Path) -> list[Span] | None:
    """Return the byte range of each row in a JSON file that contains a list, or in a JSON lines file.

    Returns None if the file has a different structure.
    """
    try:
        with open_ordinary(file) as opened:
            if os.fstat(opened.fileno()).st_size > MOST_BYTES:
                return None
            return _lines_in(opened) if file.suffix.lower() == ".jsonl" else _objects_in(opened)
    except OSError:
        return None  # the full parser will report the problem


def _lines_in(opened: BinaryIO) -> list[Span]:
    spans, at = [], 0
    for line in opened:
        if line.strip():
            spans.append((at, at + len(line)))
        at += len(line)
    return spans


def _objects_in(opened: BinaryIO) -> list[Span] | None:
    """Return the byte range of each object in a JSON list, or None if the file is not a list of objects.

    The file is read block by block.
    """
    spans, depth, is_over = list[Span](), 0, False
    data, base, at, kept = b"", 0, 0, 0  # ``kept`` is the start of the current object, or the end of the previous one
    while block := opened.read(_BLOCK):
        data, at, base = data[kept - base :] + block, at - (kept - base), kept
        for token in _TOKEN.finditer(data, at):
            letter = data[token.start()]
            if letter == _QUOTE:
                if token.start(1) == token.end(1):
                    break  # the end of the text is in the next block
                if depth < 2:
                    return None
            elif letter in b"[{":
                between = data[kept - base : token.start()].strip()
                if depth < 2 and (is_over or letter != b"[{"[depth] or between != (b"," if spans else b"")):
                    return None
                depth += 1
                kept = base + token.start() if depth == 2 and letter == _BRACE else kept
            else:
                is_over = depth == 1
                if depth == 0 or (is_over and data[kept - base : token.start()].strip()):
                    return None
                depth -= 1
                if depth == 1:
                    spans.append((kept, base + token.end()))
                if depth < 2:
                    kept = base + token.end()
            if depth == 1 and letter == _BRACKET:
                kept = base + token.end()
            at = token.end()
    return spans if is_over and spans and not data[at:].strip() else None


def _rows_at(file: Path, spans: list[Span], large: Sequence[str]) -> list[Row] | None:
    """Return the rows at the given byte ranges, or None if a row is not an object.

    Large cells are not kept in memory. They are read from the file again when they are needed.
    """
    rows = []
    with open_ordinary(file) as opened:
        for number, span in enumerate(spans, start=1):
            try:
                form = _form_at(opened, span)
            except ValueError:
                return None
            if not isinstance(form, dict):
                return None
            columns = frozenset(form)
            small = {name: value for name, value in form.items() if name not in large}
            rows.append(Row(file, number, small, _cell_reader(file, number, span), columns))
    return rows


def _cell_reader(file: Path, number: int, span: Span) -> Callable[[str], Any]:
    def cell(column: str) -> Any:  # noqa: ANN401 - any JSON
        try:
            with open_ordinary(file) as opened:
                return _form_at(opened, span)[column]
        except (OSError, ValueError, KeyError, TypeError) as error:
            problem = f"cannot be read again ({one_line(error)})"
            raise InvalidInputError(
                f"{file}, row {number}, column {column}", problem, "Do not change the file while it is being read"
            ) from error

    return cell


def _form_at(opened: BinaryIO, span: Span) -> Any:  # noqa: ANN401 - any JSON
    opened.seek(span[0])
    return parse_json(opened.read(span[1] - span[0]))


def _parquet_rows(file: Path, large: Sequence[str]) -> list[Row]:
    table = ParquetRows(file)
    small = [name for name in table.columns if name not in large]
    columns = frozenset(table.columns)

    def cell_of(index: int) -> Callable[[str], Any]:
        return lambda column: table.cell(index, column)

    return [Row(file, index + 1, values, cell_of(index), columns) for index, values in enumerate(table.rows(small))]


def _listed(columns: Iterable[str]) -> str:
    return one_line(", ".join(sorted(columns)) or "no columns", most=200)


def _shown(value: object) -> str:
    return "nothing" if value is None else one_line(repr(value), most=60)
