"""Record files: one Parquet file per record, with the metadata as JSON in its schema."""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, cast

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, Field, TypeAdapter

from betterbench.errors import BetterError, InvalidInputError, RecordError
from betterbench.jobs.durable import write_durably
from betterbench.json_form import dump_json, read_bounded, read_form, strict_form
from betterbench.records.columns import WIDTH_NAMES, arrow_schema, from_table, to_table
from betterbench.records.metadata import SCHEMA_VERSION, Outcome, RecordMetadata
from betterbench.records.record import Record

METADATA_KEY = b"betterbench"
"""Key of the JSON document in the metadata of the Parquet schema."""

SEAL_KEY = b"betterbench.sha256"
"""Key of the SHA-256 of the whole file. To compute the SHA-256, the digest itself is replaced by zeros."""

COMPRESSION_LEVEL = 1
"""Compression level of zstd.

With zstd's default level 3, files are less than 1 % smaller and compression takes 20 % longer. Level 9 takes more than
twice as long. Parquet's byte stream split encoding for the floats of the arm was tried too: 17 of 18 episodes became
larger, by 4 % in the median.
"""

NO_DIGEST = b"0" * 64
"""Placeholder for the digest in a file that is not sealed yet."""
# In the footer's compact Thrift encoding, a string value is preceded by its type (0x18) and its length 64 (0x40).
_SEAL = re.compile(re.escape(SEAL_KEY) + rb"\x18\x40([0-9a-f]{64})")

MAX_FILE_BYTES = 1 << 30
"""Maximum size of a file that is read [byte]. An episode of one hour at 60 kB/s has 0.2 GiB."""

MAX_UNPACKED_BYTES = 2 << 30
"""Maximum total size of all columns after decompression [byte]. One hour with 500 numbers per row has 0.3 GB."""


_CURE = "Record the trial again"

AGAIN = "Repeat the command of the run to record the trial again"
"""Remedy to suggest for a record of a run that cannot be read."""


@strict_form
@dataclass(frozen=True, slots=True)
class _Document:
    """JSON document in the Parquet schema of a record: metadata, outcome, and widths of the columns."""

    metadata: RecordMetadata
    outcome: Outcome
    bodies: tuple[str, ...]
    widths: dict[str, Annotated[int, Field(ge=0, le=100_000)]]

    def __post_init__(self) -> None:
        """Raise InvalidInputError if widths are missing or contradict the metadata."""
        if set(self.widths) != set(WIDTH_NAMES):
            raise InvalidInputError("widths", f"are not {', '.join(WIDTH_NAMES)}", _CURE)
        told = {
            "objects": len(self.metadata.scene.objects),
            "action": len(self.metadata.action_components),
            "predicates": len(self.metadata.predicate_names),
            "subgoals": len(self.metadata.subgoal_names),
        }
        for name, count in told.items():
            if self.widths[name] != count:
                raise InvalidInputError(
                    f"widths.{name}", f"is {self.widths[name]}, but the metadata lists {count}", _CURE
                )


class _Version(BaseModel, strict=True):
    schema_version: int


class _VersionOnly(BaseModel):
    metadata: _Version


class _AssetOnly(BaseModel, strict=True):
    asset: str
    source: str = ""
    license: str = ""


class _SceneOnly(BaseModel, strict=True):
    objects: tuple[_AssetOnly, ...]


class _TrialOnly(BaseModel, strict=True):
    task: str
    condition: str
    variation: str | None
    seed: int
    policy: str
    action_space: str
    scene_hash: str
    task_version: int
    suite_version: str
    scene: _SceneOnly = _SceneOnly(objects=())


class RecordBrief(BaseModel):
    """Trial, assets and outcome of a record, which can be read without reading the columns."""

    metadata: _TrialOnly
    outcome: Outcome


_DOCUMENT, _VERSION, _BRIEF = TypeAdapter(_Document), TypeAdapter(_VersionOnly), TypeAdapter(RecordBrief)

_PLACE = f"Use a record of a run (RUN/records/TASK/CONDITION/SEED.parquet). {AGAIN}"
_WHOLE = f"Copy it again from an intact source. {AGAIN}"
"""Remedy to suggest for a truncated or changed record.

A resumed run moves such a record aside instead of deleting it.
"""
_MAGIC = b"PAR1"


def write_record(record: Record, path: Path) -> None:
    """Write a record. Within one installation, the same record gives the same bytes.

    An existing file is replaced atomically. Raises OSError if the path is not writable.
    """
    write_durably(path, record_bytes(record))


def record_bytes(record: Record) -> bytes:
    """Return the content of the file for a record."""
    table = to_table(record.arrays(), record.contacts, record.widths)
    form = {
        "metadata": record.metadata.to_json(),
        "outcome": asdict(record.outcome),
        "bodies": list(record.bodies),
        "widths": record.widths,
    }
    table = table.replace_schema_metadata({METADATA_KEY: dump_json(form), SEAL_KEY: NO_DIGEST})
    buffer = io.BytesIO()
    pq.write_table(
        table,
        buffer,
        row_group_size=max(1, table.num_rows),
        compression="zstd",
        compression_level=COMPRESSION_LEVEL,
        use_dictionary=False,
        write_statistics=False,
    )
    return seal(buffer.getvalue())


def seal(data: bytes) -> bytes:
    """Insert the digest into the bytes of a record file. Raises RecordError if they contain no placeholder."""
    start, end = _seal_span(data)
    blank = data[:start] + NO_DIGEST + data[end:]
    return data[:start] + hashlib.sha256(blank).hexdigest().encode("ascii") + data[end:]


def _seal_span(data: bytes) -> tuple[int, int]:
    """Return the byte range of the digest in a file. Raises RecordError unless the digest occurs exactly once."""
    spans = [match.span(1) for match in _SEAL.finditer(data)]
    if len(spans) != 1:
        raise RecordError(f"the file is damaged or not a record. {_PLACE}")
    return spans[0]


def read_record(path: Path, *, digest: str | None = None) -> Record:
    """Read a record exactly as it was written. The file may come from an untrusted source.

    Raises:
        RecordError: If the file is missing, damaged, not a record, too large or of a different schema version, or if
            its SHA-256 is not ``digest``.
    """
    with _reading(path), pq.ParquetFile(io.BytesIO(_intact(path, digest))) as file:
        document = read_form(_DOCUMENT, _document_bytes(file), where="metadata", cure=_CURE, sealed=True)
        _check_columns(file, arrow_schema(document.widths))
        arrays, contacts = from_table(file.read(use_threads=False), document.widths, len(document.bodies))
        columns = cast("dict[str, Any]", arrays)
        return Record(document.metadata, document.outcome, document.bodies, contacts=contacts, **columns)


def read_outcome(path: Path, *, digest: str | None = None) -> Outcome:
    """Read only the outcome of a record. This is faster than reading the whole record.

    Raises:
        RecordError: For the same reasons as in :func:`read_record`, except that the columns and most of the metadata
            are not checked.
    """
    return read_brief(path, digest=digest).outcome


def read_brief(path: Path, *, digest: str | None = None) -> RecordBrief:
    """Read only the trial, the assets and the outcome of a record. Raises the same errors as :func:`read_outcome`."""
    with _reading(path), pq.ParquetFile(io.BytesIO(_intact(path, digest))) as file:
        return read_form(_BRIEF, _document_bytes(file), where="metadata", cure=_CURE, sealed=True)


def _intact(path: Path, digest: str | None) -> bytes:
    """Return the content of a record file. Raises RecordError if it is too large, damaged, or has a wrong digest."""
    data = read_bounded(path, max_bytes=MAX_FILE_BYTES, cure=_PLACE, raises=RecordError)
    if not data.endswith(_MAGIC) and (digest is not None or data.startswith(_MAGIC)):
        raise RecordError(f"the record is damaged (its end is missing). {_WHOLE}")
    # The Parquet reader is native code that may crash on damaged files, so the digest is checked first.
    try:
        intact = seal(data) == data
    except RecordError:
        if digest is None:
            raise
        intact = False
    if not intact:
        raise RecordError(f"the record is damaged (its digest does not match). {_WHOLE}")
    if digest is not None and hashlib.sha256(data).hexdigest() != digest:
        raise RecordError(f"this is not the record that the journal lists for this trial. {_WHOLE}")
    return data


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Context manager that converts errors from reading a damaged record to an error that names the file."""
    try:
        yield
    except BetterError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            raise RecordError(f"{path}: the record does not exist. {AGAIN}.") from None
        text = str(error).removeprefix(f"{path}: ").rstrip(".")
        raise RecordError(f"{path}: {text}.") from error
    except Exception as error:  # native code may raise any exception for a damaged file
        said = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise RecordError(f"{path}: the file is damaged or not a record ({said}). {AGAIN}.") from error


def _document_bytes(file: pq.ParquetFile) -> bytes:
    """Return the JSON document of a file after checking its schema version."""
    raw = (file.schema_arrow.metadata or {}).get(METADATA_KEY)
    if not isinstance(raw, bytes):
        raise RecordError(
            "this is a Parquet file but not a record, because it lacks the metadata 'betterbench'; choose a file of a "
            "run"
        )
    version = read_form(_VERSION, raw, where="metadata", cure=_CURE, sealed=True).metadata.schema_version
    if version != SCHEMA_VERSION:
        raise RecordError(
            f"the record has schema version {version}, but this version of betterbench reads {SCHEMA_VERSION}; "
            "read it with the version that wrote it, or record the trial again"
        )
    return raw


def _check_columns(file: pq.ParquetFile, expected: pa.Schema) -> None:
    """Raise RecordError if the columns do not match the metadata, if there are no rows, or if the file is too large."""
    actual = file.schema_arrow
    if not actual.equals(expected):
        names = sorted(set(expected.names) ^ set(actual.names)) or [
            field.name for field in expected if not field.equals(actual.field(field.name))
        ]
        raise RecordError(
            f"the columns ({', '.join(names[:5]) or 'their order'}) do not match the metadata; record the trial again"
        )
    if file.metadata.num_rows < 1:
        raise RecordError("the record has no rows; record the trial again")
    if unpacked_bytes(file) > MAX_UNPACKED_BYTES:
        raise RecordError(f"the file unpacks to more than {MAX_UNPACKED_BYTES} bytes, so it is not a record")


def unpacked_bytes(file: pq.ParquetFile) -> int:
    """Return the size of all columns after decompression [byte], as the metadata of the file state it."""
    # Do not read the metadata of single columns: pyarrow 26 then aborts the process on some malformed files.
    rows, per_row = file.metadata.num_rows, sum(getattr(field.type, "list_size", 1) for field in file.schema_arrow)
    groups = (file.metadata.row_group(i) for i in range(file.metadata.num_row_groups))
    return int(max(sum(group.total_byte_size for group in groups), rows * per_row * 8))
