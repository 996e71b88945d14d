"""Compare the records of two runs bit for bit, to see whether a code change has altered the trials.

    python tools/compare_records.py BEFORE AFTER [--rename "OLD=>NEW" ...]

Every column of every record must contain the same bytes. Metadata may be renamed: ``--rename`` replaces words in the
old metadata, and remaining differences are counted by key. Folders that contain several runs are compared run by run,
by name.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

METADATA_KEY = b"betterbench"
"""Key of the Parquet schema under which a record keeps its metadata."""


@dataclass
class Findings:
    """Result of a comparison.

    Attributes:
        same: Number of records whose columns contain the same bytes.
        missing: Records of the first run that the second lacks.
        changed: Records whose columns differ, with the first such column.
        keys: Number of differences per metadata key after renaming, with one example each.
    """

    same: int = 0
    missing: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    keys: Counter[str] = field(default_factory=Counter)
    examples: dict[str, str] = field(default_factory=dict)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare and print; return 1 if any column differs or a record is missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("before", type=Path, help="run, or folder of runs, of the old code")
    parser.add_argument("after", type=Path, help="run, or folder of runs, of the new code")
    parser.add_argument("--rename", nargs="*", default=[], metavar="OLD=>NEW", help="words replaced in old metadata")
    asked = parser.parse_args(arguments)
    renames = [tuple(pair.split("=>", 1)) for pair in asked.rename]
    failed = False
    for name, before, after in runs(asked.before, asked.after, renames):
        found = compare(before, after, renames)
        failed |= bool(found.missing or found.changed or not found.same)
        sys.stdout.write(report(name, found))
    return int(failed)


def runs(before: Path, after: Path, renames: Sequence[tuple[str, ...]]) -> Iterator[tuple[str, Path, Path]]:
    """Yield the runs below two folders that have the same name, or the two folders themselves."""
    if (before / "records").is_dir():
        yield before.name, before, after
        return
    for folder in sorted(before.iterdir()):
        if (folder / "records").is_dir():
            yield folder.name, folder, after / renamed(folder.name, renames)


def compare(before: Path, after: Path, renames: Sequence[tuple[str, ...]]) -> Findings:
    """Return the differences between the records of two runs."""
    found = Findings()
    for path in sorted((before / "records").rglob("*.parquet")):
        name = str(path.relative_to(before / "records"))
        other = after / "records" / name
        if not other.is_file():
            found.missing.append(name)
            continue
        old, new = pq.read_table(path), pq.read_table(other)
        column = first_difference(old, new)
        if column is not None:
            found.changed.append(f"{name}: {column}")
            continue
        found.same += 1
        for key, example in differences(metadata(old, renames), metadata(new, ())):
            found.keys[key] += 1
            found.examples.setdefault(key, f"{name}: {example}")
    return found


def first_difference(old: pa.Table, new: pa.Table) -> str | None:
    """Return the first column that does not contain the same values and types, or None."""
    if old.schema.names != new.schema.names:
        return f"columns {old.schema.names} against {new.schema.names}"
    for name in old.schema.names:
        if column_bytes(old, name) != column_bytes(new, name):
            return str(name)
    return None


def column_bytes(table: pa.Table, name: str) -> bytes:
    """Return the type and the values of a column as bytes: not-a-number equals itself, and zero is not minus zero."""
    column = table.select([name]).combine_chunks().replace_schema_metadata(None)
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, column.schema) as stream:
        stream.write_table(column)
    return bytes(sink.getvalue())


def metadata(table: pa.Table, renames: Sequence[tuple[str, ...]]) -> dict[str, Any]:
    """Return a record's metadata as a flat dictionary by path of keys."""
    text = (table.schema.metadata or {}).get(METADATA_KEY, b"{}").decode()
    return dict(flat(json.loads(renamed(text, renames)), ""))


def renamed(text: str, renames: Sequence[tuple[str, ...]]) -> str:
    """Return a string with words replaced."""
    for old, new in renames:
        text = text.replace(old, new)
    return text


def flat(value: object, path: str) -> Iterator[tuple[str, object]]:
    """Yield the leaves of a JSON value with their paths; list indices are left out of the path."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from flat(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and any(isinstance(v, dict | list) for v in value):
        for i, inner in enumerate(value):
            yield from flat(inner, f"{path}[{i}]")
    else:
        yield path, value


def differences(old: dict[str, Any], new: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the keys, without indices, whose values differ, with both values."""
    for key in sorted(set(old) | set(new)):
        if old.get(key) != new.get(key):
            plain = "".join("[]" if part.isdigit() else part for part in key.replace("]", "[").split("[") if part)
            yield plain, f"{old.get(key)!r} -> {new.get(key)!r}"


def report(name: str, found: Findings) -> str:
    """Return the findings on one run as text."""
    lines = [f"{name}: {found.same} records with the same bytes in every column"]
    lines += [f"  MISSING {one}" for one in found.missing[:5]]
    lines += [f"  CHANGED {one}" for one in found.changed[:5]]
    hidden = max(0, len(found.missing) - 5) + max(0, len(found.changed) - 5)
    lines += [f"  and {hidden} more"] if hidden else []
    lines += [f"  metadata {key} differs in {n}, {found.examples[key]}"[:220] for key, n in found.keys.most_common(8)]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    raise SystemExit(main())
