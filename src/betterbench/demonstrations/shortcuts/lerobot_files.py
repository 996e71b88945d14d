"""Reader for the files of LeRobot data sets (versions 2.0 to 3.0): description, instructions and frames.

The file layout follows huggingface/lerobot 0.4. The files are untrusted: their sizes are checked before they are read,
named pipes are rejected, and Git LFS pointers are reported.
"""

from __future__ import annotations

import itertools
import json
import re
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from betterbench.errors import InvalidInputError, RecordError, UnknownNameError, one_line
from betterbench.json_form import parse_json, read_bounded, read_object
from betterbench.ordinary_file import open_ordinary

CURE = "Use the folder of a LeRobot dataset, which contains meta/info.json and data"
POINTER = b"version https://git-lfs.github.com/spec/"
"""First bytes of a Git LFS pointer file."""
FETCH = "It is a Git LFS pointer instead of the file itself. Run git lfs pull in the dataset"

MOST_ROWS = 20_000_000
"""Maximum number of frames in a file."""
MOST_VALUES = 400_000_000
"""Maximum number of values in the columns that are read from one file."""
MOST_BYTES = 8 << 30
"""Maximum uncompressed size of the columns that are read from one file [byte]."""
MOST_TASKS = 1_000_000
"""Maximum number of instructions in a data set."""
MOST_TEXT = 2_000
"""Maximum length of an instruction [characters]. Longer instructions are truncated."""
_MAX_JSON_BYTES = 256 * 1024 * 1024
_HAS_DIGITS = "set_int_max_str_digits"
"""Part of Python's error message about integers with too many digits.

The message is replaced, because its advice to change a setting of the interpreter does not help the user.
"""
_TOO_LONG = "it contains an integer of more than 4,300 digits"
_INDEX = re.compile(r"__index_level_\d+__")
_TEXTS = ("task", "tasks", "instruction", "language_instruction", "task_description", "prompt")
"""Columns of ``tasks.parquet`` that may contain the instruction. The first existing column is used."""

FrameColumn = pa.ChunkedArray
"""Column of a frame file."""

_Floats = npt.NDArray[np.float64]
_Ints = npt.NDArray[np.int64]


def is_pointer(path: Path) -> bool:
    """Return whether a file is a Git LFS pointer. Return False if it cannot be read or is not a regular file."""
    try:
        with open_ordinary(path) as file:
            return file.read(len(POINTER)) == POINTER
    except (OSError, ValueError):
        return False


def read_json(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file of the ``meta`` folder. Raises InvalidInputError if the file contains none."""
    if is_pointer(path):
        raise InvalidInputError(str(path), "the file cannot be read", FETCH)
    try:
        return read_object(path, max_bytes=_MAX_JSON_BYTES, cure=CURE)
    except InvalidInputError as error:
        if _HAS_DIGITS in error.problem:
            raise InvalidInputError(str(path), _TOO_LONG, "Correct this number") from error
        raise


def read_info(path: Path) -> Mapping[str, Any]:
    """Read ``meta/info.json``. Raises InvalidInputError if the version of the data set is not supported."""
    file = path / "meta" / "info.json"
    info = read_json(file)
    if not isinstance(info.get("features"), dict):
        raise InvalidInputError(str(file), "it lists no features", CURE)
    version = info.get("codebase_version", "v3.0")
    if not re.match(r"v[23]\.", str(version)):
        problem = f"codebase_version is {one_line(version, most=40)!r}, but only 2.0 to 3.0 are supported"
        raise InvalidInputError(str(file), problem, "Convert the dataset with lerobot's own scripts")
    return info


@dataclass(frozen=True, slots=True)
class Tasks:
    """Instructions of a data set.

    Attributes:
        texts: Instructions by task index; None for an index without a text.
        source: Column and file that the instructions were read from.
        others: Other columns that may contain instructions and were not read.
    """

    texts: Mapping[int, str | None]
    source: str
    others: tuple[str, ...] = ()


def read_tasks(path: Path, column: str | None = None) -> Tasks:
    """Read the instructions from ``tasks.parquet`` (version 3) or ``tasks.jsonl`` (version 2).

    Args:
        path: Folder of the data set.
        column: Column to read instead of ``task``.

    Raises:
        RecordError: If the file cannot be read, or no column is recognized as the instructions.
        UnknownNameError: If the given column does not exist.
    """
    where, rows = _task_rows(path)
    with _one_line(where):
        return _tasks(where, rows, column)


def task_columns(path: Path) -> tuple[str, ...]:
    """Return the names of the text columns in the tasks file. Raises RecordError if the file cannot be read."""
    _, rows = _task_rows(path)
    return tuple(name for name, values in rows.items() if name != "task_index" and _hold_texts(values))


def _task_rows(path: Path) -> tuple[Path, dict[str, list[Any]]]:
    """Return the path of the tasks file and its columns by name. Raises RecordError if the file cannot be read."""
    lines, table = path / "meta" / "tasks.jsonl", path / "meta" / "tasks.parquet"
    where = table if table.exists() or (not lines.exists() and table.is_symlink()) else lines
    if is_pointer(where):
        raise RecordError(f"{where}: the instructions cannot be read. {FETCH}.")
    with _one_line(where):
        return where, _parquet_rows(table) if where == table else _json_rows(lines)


@contextmanager
def _one_line(where: Path) -> Iterator[None]:
    """Return a context manager that raises RecordError with a one-line message if the instructions cannot be read."""
    try:
        yield
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, ArithmeticError) as error:
        said = _TOO_LONG if _HAS_DIGITS in str(error) else one_line(error)
        raise RecordError(f"{where}: the instructions cannot be read ({said}). {CURE}.") from error


def _parquet_rows(file: Path) -> dict[str, list[Any]]:
    """Return the columns of ``tasks.parquet`` by name, including the index that pandas stores."""
    with _table_of(file) as table:
        if table.metadata.num_rows > MOST_TASKS:
            msg = f"it has {table.metadata.num_rows} rows; at most {MOST_TASKS} are supported"
            raise ValueError(msg)
        schema = table.schema_arrow
        flat = [f.name for f in schema if _is_text(f.type) or pa.types.is_integer(f.type)]
        names = [name for name in flat if name in table.schema.names]
        _require_bounded(table.metadata, dict.fromkeys(names, 1))
        found = table.read(names)
        return {name: _listed(found.column(name)) for name in names}


def _listed(column: pa.ChunkedArray) -> list[Any]:
    """Return the values of a column. Equal strings share one object, which saves memory."""
    flat = column.combine_chunks()
    if not pa.types.is_dictionary(flat.type):
        return list(flat.to_pylist())
    texts = flat.dictionary.to_pylist()
    return [None if code is None else texts[code] for code in flat.indices.to_pylist()]


def _json_rows(file: Path) -> dict[str, list[Any]]:
    """Return the fields of ``tasks.jsonl`` by name. A JSON object in the file may span several lines."""
    data = read_bounded(file, max_bytes=_MAX_JSON_BYTES, cure=CURE)
    text = data.decode(json.detect_encoding(data)).lstrip("\ufeff")
    forms = list(_objects(text))
    if len(forms) > MOST_TASKS:
        msg = f"it has {len(forms)} instructions; at most {MOST_TASKS} are supported"
        raise ValueError(msg)
    names = dict.fromkeys(name for form in forms for name in form)
    return {name: [form.get(name) for form in forms] for name in names}


def _objects(text: str) -> Iterator[dict[str, Any]]:
    """Yield the JSON objects in a string. The objects are written either one after the other or in a list."""
    decoder, at = json.JSONDecoder(), 0
    if text.lstrip()[:1] == "[":
        found = parse_json(text)
        if not all(isinstance(form, dict) for form in found):
            raise ValueError("it contains JSON values that are not objects")
        yield from found
        return
    while True:
        while at < len(text) and text[at] in " \t\r\n,":
            at += 1
        if at >= len(text):
            return
        try:
            form, at = decoder.raw_decode(text, at)
        except RecursionError as error:
            raise ValueError("it is nested too deep") from error
        if not isinstance(form, dict):
            raise TypeError("it contains JSON values that are not objects")
        yield form


def _tasks(where: Path, rows: Mapping[str, list[Any]], column: str | None) -> Tasks:
    texts = [name for name, values in rows.items() if name != "task_index" and _hold_texts(values)]
    chosen = column if column is not None else next((name for name in _TEXTS if name in rows), None)
    if chosen is None:
        chosen = next((name for name in texts if _INDEX.fullmatch(name)), None)
    if column is not None and column not in texts:
        raise UnknownNameError("column with instructions", column, texts)
    if chosen is None and texts:
        problem = f"there is no column named task; candidates are {', '.join(map(one_line, texts[:8]))}"
        raise RecordError(f"{where}: {problem}. Choose one with --instruction COLUMN.")
    if chosen is None:
        raise ValueError("it has no column with instructions")
    if "task_index" not in rows:
        raise ValueError("it has no column task_index")
    found: dict[int, str | None] = {}
    for number, text in zip(rows["task_index"], rows[chosen], strict=True):
        key = int(number)
        said = str(text) if text is not None else None
        if key in found and found[key] != said:
            msg = f"task {key} occurs twice with different texts"
            raise ValueError(msg)
        found[key] = said
    index = " (the index of pandas)" if _INDEX.fullmatch(chosen) else ""
    return Tasks(found, f"{chosen}{index} in meta/{where.name}", tuple(name for name in texts if name != chosen))


def _hold_texts(values: Sequence[Any]) -> bool:
    return any(isinstance(value, str) for value in values)


def _holds_texts(kind: pa.DataType) -> bool:
    return _is_text(kind.value_type if pa.types.is_list(kind) or pa.types.is_large_list(kind) else kind)


def _is_text(kind: pa.DataType) -> bool:
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _require_file(file: Path) -> None:
    if not stat.S_ISREG(file.stat().st_mode):
        raise OSError("it is not a regular file")


@dataclass(slots=True)
class Frames:
    """Frame files of a data set.

    Attributes:
        files: Files that can be read, sorted by name.
        pointers: Files that are Git LFS pointers.
    """

    files: list[Path] = field(default_factory=list)
    pointers: list[Path] = field(default_factory=list)

    @classmethod
    def of(cls, path: Path) -> Frames:
        """Find the frame files of a data set."""
        found = cls()
        for file in sorted((path / "data").rglob("*.parquet")):
            (found.pointers if is_pointer(file) else found.files).append(file)
        return found

    def require_some(self, path: Path) -> None:
        """Raise an error if the data set has no readable frame file.

        Raises:
            RecordError: If all frame files are Git LFS pointers.
            InvalidInputError: If there are no frame files.
        """
        if not self.files and self.pointers:
            raise RecordError(f"{self.pointers[0]}: it cannot be read. {FETCH}.")
        if not self.files:
            raise InvalidInputError(str(path / "data"), "it contains no episode", CURE)


@contextmanager
def _table_of(file: Path) -> Iterator[pq.ParquetFile]:
    """Open a Parquet file from an external data set. A string that occurs in many rows is kept in memory only once."""
    _require_file(file)
    with open_ordinary(file) as opened:
        with pq.ParquetFile(opened) as table:
            paths = [table.schema.column(i).path for i in range(len(table.schema))]
            names = tuple(field.name for field in table.schema_arrow if _holds_texts(field.type))
            texts = [path for path in paths if path in names or path.startswith(tuple(f"{name}." for name in names))]
            if not texts:
                yield table
                return
        with pq.ParquetFile(opened, read_dictionary=texts) as table:
            yield table


def column_names(file: Path) -> frozenset[str]:
    """Return the names of the columns in a frame file. Raises RecordError if the file cannot be read."""
    try:
        _require_file(file)
        with open_ordinary(file) as opened, pq.ParquetFile(opened) as table:
            return frozenset(table.schema_arrow.names)
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise RecordError(f"{file}: it cannot be read ({one_line(error)}). Fetch the file again.") from error


def read_columns(file: Path, widths: Mapping[str, int]) -> dict[str, pa.ChunkedArray]:
    """Read columns of a frame file.

    Args:
        file: The frame file.
        widths: Columns to read, each with the maximum number of values per frame.

    Raises:
        RecordError: If a column is missing, the file is invalid, or the file exceeds the size limits.
    """
    try:
        with _table_of(file) as table:
            missing = [name for name in widths if name not in table.schema_arrow.names]
            if missing:
                raise RecordError(f"{file}: it has no column {missing[0]}. {CURE}.")
            _require_bounded(table.metadata, widths)
            found = table.read(list(widths))
            return {name: found.column(name) for name in widths}
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise RecordError(f"{file}: it cannot be read ({one_line(error)}). Fetch the file again.") from error


def _require_bounded(meta: pq.FileMetaData, widths: Mapping[str, int]) -> None:
    """Raise ValueError if the sizes that a Parquet file declares exceed the limits."""
    if meta.num_rows > MOST_ROWS:
        msg = f"it declares {meta.num_rows} rows; at most {MOST_ROWS} are supported"
        raise ValueError(msg)
    values = size = 0
    for group in range(meta.num_row_groups):
        row_group = meta.row_group(group)
        for i in range(row_group.num_columns):
            column = row_group.column(i)
            if any(column.path_in_schema == name or column.path_in_schema.startswith(f"{name}.") for name in widths):
                values += column.num_values
                size += column.total_uncompressed_size
    if values > MOST_VALUES:
        msg = f"its columns have {values} numbers; at most {MOST_VALUES} are supported"
        raise ValueError(msg)
    if size > MOST_BYTES:
        msg = f"its columns have {size} bytes uncompressed; at most {MOST_BYTES} are supported"
        raise ValueError(msg)


def numbers_in(file: Path, name: str, column: pa.ChunkedArray, width: int) -> _Floats:
    """Return a column as numbers: an array of shape (rows,) if ``width`` is 1, or else of shape (rows, width).

    Raises RecordError if the column does not have ``width`` numbers in every row.
    """
    try:
        return _numbers(column, width)
    except (pa.ArrowException, ValueError, TypeError) as error:
        raise RecordError(
            f"{file}: it cannot be read ({name}: {one_line(error)}). Fetch the file again, or correct meta/info.json."
        ) from error


def _numbers(column: pa.ChunkedArray, width: int) -> _Floats:
    flat = column.combine_chunks()
    listed = pa.types.is_list(flat.type) or pa.types.is_large_list(flat.type) or pa.types.is_fixed_size_list(flat.type)
    kind = flat.type.value_type if listed else flat.type
    if not (
        pa.types.is_null(kind) or pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind)
    ):
        msg = f"it contains {one_line(kind, most=80)} instead of numbers"
        raise ValueError(msg)
    if listed and any(count != width for count in pc.unique(pc.list_value_length(flat)).to_pylist()):
        msg = f"it does not have {width} numbers in each row"
        raise ValueError(msg)
    values = np.asarray((flat.flatten() if listed else flat).to_numpy(zero_copy_only=False), dtype=np.float64)
    if len(values) != width * len(flat):
        msg = f"it has {len(values)} numbers in {len(flat)} rows, expected {width} in each"
        raise ValueError(msg)
    return values if width == 1 else values.reshape(len(flat), width)


def require_finite_column(file: Path, name: str, values: _Floats) -> None:
    """Raise RecordError if a column contains a value that is not finite."""
    bad = np.flatnonzero(~np.isfinite(values if values.ndim == 1 else values.sum(axis=1)))
    if bad.size:
        raise RecordError(f"{file}: the value of {name} is not finite in row {bad[0]}. Correct or remove this row.")


def texts_in(file: Path, name: str, column: pa.ChunkedArray) -> tuple[_Ints, list[str | None]] | None:
    """Return a string column as its distinct strings and, for each row, the index of its string.

    Return None if the column does not contain strings. A row may also be a list with one string. Raises RecordError if
    a row does not have exactly one string.
    """
    flat = column.combine_chunks()
    if pa.types.is_list(flat.type) or pa.types.is_large_list(flat.type):
        if not _is_text(flat.type.value_type):
            return None
        if any(count != 1 for count in pc.unique(pc.list_value_length(flat)).to_pylist()):
            problem = f"{name} does not have exactly one string in each row"
            raise RecordError(f"{file}: {problem}. Choose a column with one instruction per frame.")
        flat = flat.flatten()
    if not _is_text(flat.type):
        return None
    coded = flat if pa.types.is_dictionary(flat.type) else flat.dictionary_encode()
    codes = np.asarray(pc.fill_null(coded.indices, -1).to_numpy(zero_copy_only=False), dtype=np.int64)
    return codes, [None if text is None else str(text)[:MOST_TEXT] for text in coded.dictionary.to_pylist()]


def runs(values: _Ints) -> Iterator[tuple[int, int]]:
    """Yield the range of rows [start, stop) of each run of equal values."""
    edges = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), len(values)]
    yield from ((a, b) for a, b in itertools.pairwise(edges) if b > a)
