"""Records on disk: one Parquet file each, with the metadata as JSON in its schema."""

from __future__ import annotations

import hashlib
import io
import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

import pyarrow as pa
import pyarrow.parquet as pq

from betterbench.errors import BetterError, RecordError
from betterbench.recording.columns import WIDTH_NAMES, arrow_schema, from_table, split_columns, to_table
from betterbench.recording.durable import write_durably
from betterbench.recording.metadata import Outcome, RecordMetadata, dump_json
from betterbench.recording.record import Record

METADATA_KEY = b"betterbench"
"""Key of the JSON document in the metadata of the Parquet schema."""

SEAL_KEY = b"betterbench.sha256"
"""Key of the SHA-256 of the whole file, computed with the digest itself as zeros."""

COMPRESSION_LEVEL = 3
"""Level of zstd, its default. Level 9 saved 1 % on 20 s of 15 objects and took more than twice as long."""

_NO_DIGEST = b"0" * 64
# In the compact Thrift form of the footer a key is followed by the head of a text (18) and its length, 64 (40).
_SEAL = re.compile(re.escape(SEAL_KEY) + rb"\x18\x40([0-9a-f]{64})")

MAX_FILE_BYTES = 1 << 30
"""Largest file that is read. An episode of an hour at 60 kB/s takes 0.2 GiB."""

MAX_UNPACKED_BYTES = 2 << 30
"""Largest size of all columns together after decompression. An hour of 500 numbers a row takes 0.3 GB."""


def write_record(record: Record, path: Path) -> None:
    """Write a record; the same record gives the same bytes on one installation.

    Args:
        record: What to write.
        path: Final place; a file that stands there is replaced at once, never half.

    Raises:
        OSError: If the place cannot be written.
    """
    write_durably(path, record_bytes(record))


def record_bytes(record: Record) -> bytes:
    """Return the content of a record's file."""
    table = to_table(record.arrays(), record.contacts, record.widths)
    form = {
        "metadata": record.metadata.to_json(),
        "outcome": asdict(record.outcome),
        "bodies": list(record.bodies),
        "widths": record.widths,
    }
    table = table.replace_schema_metadata({METADATA_KEY: dump_json(form), SEAL_KEY: _NO_DIGEST})
    splits = split_columns(table.schema)
    buffer = io.BytesIO()
    pq.write_table(
        table,
        buffer,
        row_group_size=max(1, table.num_rows),
        compression="zstd",
        compression_level=COMPRESSION_LEVEL,
        use_dictionary=False,
        use_byte_stream_split=splits,
        write_statistics=False,
    )
    return seal(buffer.getvalue())


def seal(data: bytes) -> bytes:
    """Return a record's file with the digest of its content put in place of the zeros.

    Args:
        data: Parquet file with one seal, whatever its digest.

    Raises:
        RecordError: If the file has no seal.
    """
    start, end = _seal_span(data)
    blank = data[:start] + _NO_DIGEST + data[end:]
    return data[:start] + hashlib.sha256(blank).hexdigest().encode("ascii") + data[end:]


def _seal_span(data: bytes) -> tuple[int, int]:
    """Return where the digest stands.

    Raises:
        RecordError: If there is not exactly one.
    """
    spans = [match.span(1) for match in _SEAL.finditer(data)]
    if len(spans) != 1:
        raise RecordError(
            "is damaged or no record; choose a file of a run, or delete it and run the same command again"
        )
    return spans[0]


def read_record(path: Path) -> Record:
    """Read a record, bit for bit the one that was written.

    Args:
        path: A file that :func:`write_record` wrote; it may come from a stranger.

    Returns:
        The record.

    Raises:
        RecordError: If the file is missing, damaged, not a record, too large or of another schema version.
    """
    try:
        data = _intact(path)
        with pq.ParquetFile(io.BytesIO(data)) as file:
            form = _metadata_form(file)
            metadata = RecordMetadata.from_json(_member(form, "metadata", dict))
            outcome = _outcome(_member(form, "outcome", dict))
            bodies = tuple(str(name) for name in _member(form, "bodies", list))
            widths = _widths(_member(form, "widths", dict), metadata)
            _check_columns(file, arrow_schema(widths))
            table = file.read(use_threads=False)
        arrays, contacts = from_table(table, widths, len(bodies))
        return Record(metadata, outcome, bodies, contacts=contacts, **cast("dict[str, Any]", arrays))
    except FileNotFoundError:
        raise RecordError(f"{path}: there is no such record. List the folder, or record the trial first.") from None
    except _UNREADABLE as error:
        raise RecordError(f"{path}: {_reason(error)}.") from error


def read_outcome(path: Path) -> Outcome:
    """Read how the episode of a record ended, and nothing else, which is fast.

    Args:
        path: A file that :func:`write_record` wrote.

    Raises:
        RecordError: As :func:`read_record`, of which it checks less.
    """
    try:
        with pq.ParquetFile(io.BytesIO(_intact(path))) as file:
            return _outcome(_member(_metadata_form(file), "outcome", dict))
    except FileNotFoundError:
        raise RecordError(f"{path}: there is no such record. List the folder, or record the trial first.") from None
    except _UNREADABLE as error:
        raise RecordError(f"{path}: {_reason(error)}.") from error


_UNREADABLE = (BetterError, pa.ArrowException, OSError, ValueError, KeyError, TypeError, RecursionError)
"""What reading a damaged record, or one of a stranger, can raise."""


def _intact(path: Path) -> bytes:
    """Return the content of a record's file.

    Raises:
        RecordError: If it is too large or damaged.
        OSError: If it cannot be read.
    """
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise RecordError(f"{size} bytes are more than the limit of {MAX_FILE_BYTES}; this is no record of an episode")
    data = path.read_bytes()
    # The Parquet reader is native code that can crash on damaged files, so it only gets to see intact ones.
    if seal(data) != data:
        raise RecordError("is damaged (its digest does not fit); delete it and run the same command again")
    return data


def _reason(error: Exception) -> str:
    """Return why a record cannot be read, without a full stop."""
    return str(error).rstrip(".") if isinstance(error, BetterError) else _first_line(error)


def _first_line(error: Exception) -> str:
    """Return what a library says about a damaged file, with the cure."""
    said = (str(error).splitlines() or [type(error).__name__])[0][:200]
    return f"is damaged or no record ({said}); delete it and run the same command again"


def _metadata_form(file: pq.ParquetFile) -> dict[str, Any]:
    """Return the JSON document of a file.

    Raises:
        RecordError: If there is none.
    """
    raw = (file.schema_arrow.metadata or {}).get(METADATA_KEY)
    if raw is None:
        raise RecordError(
            "is a Parquet file but no record: it lacks the metadata 'betterbench'; choose a file of a run"
        )
    form = json.loads(raw)
    if not isinstance(form, dict):
        raise RecordError("its metadata is no JSON object; record the trial again")
    return form


def _member(form: dict[str, Any], name: str, kind: type) -> Any:  # noqa: ANN401 -- checked against ``kind``
    """Return a member of the JSON document.

    Raises:
        RecordError: If it is missing or of another kind.
    """
    value = form.get(name)
    if not isinstance(value, kind):
        raise RecordError(f"its {name!r} is missing or malformed; record the trial again")
    return value


def _outcome(form: dict[str, Any]) -> Outcome:
    """Return the outcome from its JSON form.

    Raises:
        RecordError: If a field is missing, unknown or of the wrong type.
    """
    kinds = {"termination": str, "success": bool, "error": str | None, "clipped_actions": int, "invalid_actions": int}
    if set(form) != set(kinds) or not all(isinstance(form[name], kind) for name, kind in kinds.items()):
        raise RecordError("its 'outcome' is malformed; record the trial again")
    return Outcome(**form)


def _widths(form: dict[str, Any], metadata: RecordMetadata) -> dict[str, int]:
    """Return the widths from their JSON form.

    Raises:
        RecordError: If a width is missing, out of range or at odds with the metadata.
    """
    for name in WIDTH_NAMES:
        value = form.get(name)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= 100_000:
            raise RecordError(f"its width {name!r} cannot be {value!r}; record the trial again")
    told = {
        "objects": len(metadata.scene.objects),
        "action": len(metadata.action_components),
        "predicates": len(metadata.predicate_names),
        "subgoals": len(metadata.subgoal_names),
    }
    for name, count in told.items():
        if form[name] != count:
            raise RecordError(f"its width {name!r} is {form[name]}, but {count} are named; record the trial again")
    return {name: form[name] for name in WIDTH_NAMES}


def _check_columns(file: pq.ParquetFile, expected: pa.Schema) -> None:
    """Refuse a file with other columns than its metadata says, without rows, or that unpacks to too much.

    Raises:
        RecordError: If it is such a file.
    """
    actual = file.schema_arrow
    if not actual.equals(expected):
        names = sorted(set(expected.names) ^ set(actual.names)) or [
            field.name for field in expected if not field.equals(actual.field(field.name))
        ]
        raise RecordError(
            f"its columns {', '.join(names[:5]) or 'in another order'} do not fit; record the trial again"
        )
    if file.metadata.num_rows < 1:
        raise RecordError("has no rows; record the trial again")
    # Metadata of single columns is left alone: asking for it aborts the process on some malformed files (pyarrow 26)
    rows, per_row = file.metadata.num_rows, sum(getattr(field.type, "list_size", 1) for field in expected)
    groups = (file.metadata.row_group(i) for i in range(file.metadata.num_row_groups))
    if max(sum(group.total_byte_size for group in groups), rows * per_row * 8) > MAX_UNPACKED_BYTES:
        raise RecordError(f"unpacks to more than {MAX_UNPACKED_BYTES} bytes; this is no record of an episode")
