"""Suite folders. Each contains tasks as JSON files, and a file ``suite.json`` that lists the tasks and their digests.

The name of the folder ends with the first digits of a digest over all tasks, so that equal names mean the same
benchmark.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, one_line
from betterbench.json_form import NO_TRUTH, Digest, dump_json, json_schema_of, read_bounded, read_form, strict_form

HEAD = "suite.json"
"""Name of the file that lists the tasks of a suite."""

TASKS = "tasks"
"""Name of the folder with the tasks of a suite."""

CERTIFICATE = "certificate.json"
"""Name of the certificate of a suite's tasks, which ``better certify`` writes into the suite's folder.

It is not part of the suite's digest.
"""

POWER = "power.json"
"""Name of the power matrix of a suite's tasks, which ``better calibrate --power`` measures.

It is in the suite's folder, but is not part of the suite's digest.
"""

_MOST_BYTES = 16 << 20
_DIGITS = 12
_CURE = "Get the folder again, or write the suite again"

_NAME_PATTERN = r"^[a-z][a-z0-9_]{0,63}$"
_Name = Annotated[str, Field(pattern=_NAME_PATTERN)]


@strict_form
@dataclass(frozen=True, slots=True)
class _Head:
    schema_version: Annotated[Literal[1], NO_TRUTH]
    name: _Name
    tasks: Annotated[dict[_Name, Digest], Field(min_length=1)]


_HEAD = TypeAdapter(_Head)


def suite_schema() -> dict[str, Any]:
    """Return the JSON schema for the file that lists the tasks of a suite."""
    return json_schema_of(_HEAD, title="Suite")


@dataclass(frozen=True, slots=True)
class SuiteFolder:
    """Suite in a folder. All of its files match the digests in the list of tasks.

    Attributes:
        name: Name of the suite, including the digits of the digest ("kitchen-3f2a91c0d4e5").
        tasks: Names of the tasks, sorted.
        files: Files of the tasks, in the same order.
    """

    name: str
    tasks: tuple[str, ...]
    files: tuple[Path, ...]


def is_suite_folder(path: Path | str) -> bool:
    """Return whether a path is a suite folder."""
    return (Path(path) / HEAD).is_file()


def require_suite_name(name: str, *, where: str = "name of the suite") -> None:
    """Check that a string is a valid name for a suite. The name does not include the digest.

    Raises:
        InvalidInputError: If the string is not a valid name.
    """
    if re.fullmatch(_NAME_PATTERN, name) is None:
        cure = "Use up to 64 lower-case letters, digits and '_', and begin with a letter"
        raise InvalidInputError(where, f"{one_line(name, most=80)!r} is not a valid name", cure)


def suite_files(name: str, forms: Mapping[str, Mapping[str, Any]]) -> tuple[str, dict[str, bytes]]:
    """Return the name of a suite's folder, and the content of its files by path.

    Args:
        name: Name of the suite, not including the digest.
        forms: Tasks by name, in the JSON form returned by :func:`betterbench.tasks.task_to_json`.

    Raises:
        InvalidInputError: If the name is invalid, or if no task is given.
    """
    contents = {task: dump_json(dict(form)) + b"\n" for task, form in sorted(forms.items())}
    digests = {task: hashlib.sha256(content).hexdigest() for task, content in contents.items()}
    head = {"schema_version": 1, "name": name, "tasks": digests}
    read_form(
        _HEAD, head, where="suite", cure="Use lower-case letters, digits and '_' in names, and list at least one task"
    )
    files = {HEAD: dump_json(head) + b"\n"}
    files |= {f"{TASKS}/{task}.json": content for task, content in contents.items()}
    return _full_name(name, digests), files


def read_suite_folder(path: Path | str) -> SuiteFolder:
    """Read the suite in a folder, and check the digest of every file.

    Raises:
        InvalidInputError: If the folder does not contain a suite, if a file is missing, is not listed or does not match
            its digest, or if the name of the folder contains a different digest.
    """
    folder = Path(path).absolute()
    where = str(folder / HEAD)
    cure = f"Pass a folder that contains {HEAD}"
    head = read_form(_HEAD, read_bounded(folder / HEAD, max_bytes=_MOST_BYTES, cure=cure), where=where, cure=_CURE)
    files = []
    for task, digest in sorted(head.tasks.items()):
        file = folder / TASKS / f"{task}.json"
        found = hashlib.sha256(read_bounded(file, max_bytes=_MOST_BYTES, cure=_CURE)).hexdigest()
        if found != digest:
            problem = f"has the digest {found[:_DIGITS]}…, but {HEAD} lists {digest[:_DIGITS]}…"
            raise InvalidInputError(str(file), problem, _CURE)
        files.append(file)
    strange = sorted(f.name for f in (folder / TASKS).glob("*.json") if f not in files and not _is_companion(f))
    if strange:
        problem = f"the suite does not list {one_line(repr(strange[0]), most=120)}"
        raise InvalidInputError(str(folder / TASKS), problem, "Move the file to a different folder")
    full = _full_name(head.name, head.tasks)
    stated = re.fullmatch(r".*-([0-9a-f]{12})", folder.name)
    if stated and not full.endswith(stated[1]):
        problem = f"its tasks have the digest {full[-_DIGITS:]}"
        raise InvalidInputError(str(folder), problem, f"{_CURE}. A changed suite needs a different name")
    return SuiteFolder(full, tuple(sorted(head.tasks)), tuple(files))


def _is_companion(file: Path) -> bool:
    """Return whether a file contains measurements for a task rather than a task."""
    return file.name.endswith(".demonstrations.json")


def _full_name(name: str, digests: Mapping[str, str]) -> str:
    return f"{name}-{hashlib.sha256(dump_json(dict(digests))).hexdigest()[:_DIGITS]}"
