"""Rows of published data in JSON, JSON lines and Parquet, with errors that name file, row and column."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError, one_line
from betterbench.json_form import parse_json, read_bounded
from betterbench.records.parquet_rows import ParquetRows

MOST_BYTES = 2 << 30
"""Largest JSON file that is read [byte]; the largest published one has 1.2 GB."""
_CURE = "Give the file as published, or the row in that form"
_FOLDERS = ("", "data", "default", "annotations")


@dataclass(frozen=True, slots=True)
class Row:
    """One row of a file.

    Attributes:
        file: The file.
        number: Number of the row, from 1.
        values: Cells by column, without large ones.
        large: Reads a large cell by its column.
    """

    file: Path
    number: int
    values: Mapping[str, Any]
    large: Callable[[str], Any]
    columns: frozenset[str]

    def where(self, column: str) -> str:
        """Return file, row and column for an error."""
        return f"{self.file}, row {self.number}, column {column}"

    def error(self, column: str, problem: str, cure: str = _CURE) -> InvalidInputError:
        """Return an error that names file, row and column."""
        return InvalidInputError(self.where(column), problem, cure)

    def named(self, *names: str) -> str:
        """Return the first of several names that is a column; raise InvalidInputError if none is."""
        for name in names:
            if name in self.columns:
                return name
        other = f" (or {', '.join(names[1:])})" if len(names) > 1 else ""
        raise self.error(f"{names[0]}{other}", f"is missing. The row has {_listed(self.columns)}")

    def text(self, *names: str) -> str:
        """Return a text, or a number as text, in the first of several columns."""
        name = self.named(*names)
        value = self.values.get(name)
        if isinstance(value, bool) or not isinstance(value, str | int | float) or not str(value).strip():
            raise self.error(name, f"expected a text, found {_shown(value)}")
        return str(value)

    def text_or(self, otherwise: str, *names: str) -> str:
        """Return a text, or a default if there is no such column or the cell is empty."""
        value = next((self.values[name] for name in names if name in self.columns), None)
        return otherwise if value is None or not str(value).strip() else str(value)

    def integer(self, *names: str) -> int:
        """Return an integer that is at least 0."""
        name = self.named(*names)
        value = self.values.get(name)
        if isinstance(value, str) and value.strip().isascii() and value.strip().isdigit() and len(value) < 10:
            value = int(value)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 1 << 40:
            raise self.error(name, f"expected an integer of at least 0, found {_shown(value)}")
        return value

    def texts(self, *names: str) -> tuple[str, ...]:
        """Return a list of texts."""
        name = self.named(*names)
        value = self.values.get(name)
        if not isinstance(value, list | tuple) or not value or not all(isinstance(v, str) and v.strip() for v in value):
            raise self.error(name, f"expected a list of texts, found {_shown(value)}")
        return tuple(value)

    def letter(self, options: int, *names: str) -> str:
        """Return the correct letter of a choice, given as letter or as index from 0."""
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
            raise self.error(name, f"expected a letter from A to {last} or an index from 0, found {_shown(value)}")
        return chr(ord("A") + index)


def distinct(identifier: str, taken: set[str]) -> str:
    """Reserve and return a unique identifier; a repeated identifier gets a number ("q7#2")."""
    found, number = identifier, 1
    while found in taken:
        number += 1
        found = f"{identifier}#{number}"
    taken.add(found)
    return found


def find_files(folder: Path, suffixes: Sequence[str], *, prefix: str = "") -> list[Path]:
    """Return the files in a folder of data or its usual subfolders, by name; for a file, return this file."""
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
        large: Columns that are read on demand, such as embedded images.

    Raises:
        InvalidInputError: If the file cannot be read, or a row is not an object.
    """
    if file.suffix.lower() == ".parquet":
        return _parquet_rows(file, large)
    raw = read_bounded(file, max_bytes=MOST_BYTES, cure="Give the file as published")
    try:
        if file.suffix.lower() == ".jsonl":
            forms: object = [parse_json(line) for line in raw.splitlines() if line.strip()]
        else:
            forms = parse_json(raw)
    except ValueError as error:
        raise InvalidInputError(str(file), f"is not JSON ({one_line(error)})", "Download the file again") from error
    if isinstance(forms, dict):  # some mirrors wrap the rows
        forms = next((v for v in forms.values() if isinstance(v, list)), forms)
    if not isinstance(forms, list) or not forms:
        raise InvalidInputError(str(file), "is not a list of rows", "Give the file as published")
    rows = []
    for number, form in enumerate(forms, start=1):
        if not isinstance(form, dict):
            raise InvalidInputError(f"{file}, row {number}", f"expected an object, found {_shown(form)}", _CURE)
        rows.append(Row(file, number, form, form.__getitem__, frozenset(form)))
    return rows


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
