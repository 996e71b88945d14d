"""Import of a stranger's mesh in a process of its own, with limits of memory and time, and a cache of what came out.

Readers of meshes and images and the decomposition into convex shapes are C++ that a forged file can crash or hang.
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import platformdirs
from pydantic import TypeAdapter

from betterbench.errors import InvalidInputError, MissingDependencyError, last_line, one_line
from betterbench.jobs.durable import write_durably
from betterbench.json_form import dump_json, file_digest, read_bounded, read_form
from betterbench.sim.assets.importing.importer import Imported, Wishes, import_mesh
from betterbench.sim.assets.importing.mesh_file import MAX_FILE_BYTES, FolderResolver
from betterbench.sim.assets.importing.stored import from_bytes, to_bytes

VERSION = 2
"""Raised when the same file would become another asset."""
MAX_MEMORY_BYTES = 6 * 1024**3
MAX_CPU_S = 120
MAX_S = 900.0
"""Longest time of an import [s]; much more than the processor time, because a busy machine is slow."""

MOST_STORED_BYTES = 64 << 20
"""Largest file of an imported object."""
_MOST_NOTE_BYTES = 1 << 20
_FILES = TypeAdapter(dict[Literal["files"], dict[str, str]])
_BROKEN, _MISSING = 3, 4


@dataclass(frozen=True, slots=True)
class Made:
    """An imported object as bytes.

    Attributes:
        data: Its bytes, as :func:`~betterbench.sim.assets.importing.stored.to_bytes` makes them.
        files: SHA-256 of each file that was read, by its path in the folder of the first one.
    """

    data: bytes
    files: Mapping[str, str]


def import_safely(path: Path, wishes: Wishes = Wishes()) -> Imported:  # noqa: B008 - frozen
    """Make an asset of the object in a file; see :func:`import_bytes`."""
    return from_bytes(import_bytes(path, wishes).data, one_line(path.name, most=120))


def import_bytes(path: Path, wishes: Wishes = Wishes()) -> Made:  # noqa: B008 - frozen
    """Make an asset of the object in a file in a limited process, or take it from the cache of the user.

    Raises:
        InvalidInputError: If the file cannot be read, no object of a table can be made of it, or it takes more memory
            or time than an import may.
        MissingDependencyError: If a package that its format needs is not installed.
    """
    where = one_line(path.name, most=120)
    digest = hashlib.sha256(read_bounded(path, max_bytes=MAX_FILE_BYTES, cure="Reduce the mesh in a mesh editor"))
    place = cache_folder() / _key(path, digest.hexdigest(), wishes)
    kept = _kept(path, place, where)
    if kept is not None:
        return kept
    made = _in_child(path, wishes, where)
    from_bytes(made.data, where)
    place.parent.mkdir(parents=True, exist_ok=True)
    content = _content(made.files)
    write_durably(place.with_suffix(f".{content}.npz"), made.data)
    write_durably(place.with_suffix(".json"), dump_json({"files": dict(made.files)}))
    return made


def cache_folder() -> Path:
    """Return the folder in which imported objects are kept; deleting it loses nothing but time."""
    return platformdirs.user_cache_path("betterbench") / "imported"


def _key(path: Path, digest: str, wishes: Wishes) -> str:
    """Return a digest of what is known before an import: the file, the names that tell its kind, and the wishes."""
    named = "/".join(path.absolute().parts[-4:])
    known = f"{VERSION}|{json.dumps(asdict(wishes), sort_keys=True)}|{named}|{digest}"
    return hashlib.sha256(known.encode()).hexdigest()[:32]


def _content(files: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps(dict(files), sort_keys=True).encode()).hexdigest()[:16]


def _kept(path: Path, place: Path, where: str) -> Made | None:
    """Return what the cache has, if the files that were read then are the same now."""
    note = place.with_suffix(".json")
    try:
        files = read_form(_FILES, read_bounded(note, max_bytes=_MOST_NOTE_BYTES, cure=""), where=where, cure="")[
            "files"
        ]
        if any(file_digest(path.parent / name) != known for name, known in files.items()):
            return None
        stored = place.with_suffix(f".{_content(files)}.npz")
        data = read_bounded(stored, max_bytes=MOST_STORED_BYTES, cure="Delete it")
        from_bytes(data, where)
    except (InvalidInputError, OSError):  # missing or damaged: it is made again
        return None
    return Made(data, files)


def _in_child(path: Path, wishes: Wishes, where: str) -> Made:
    asked = json.dumps({"path": str(path.absolute()), "wishes": asdict(wishes)})
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", f"from {__name__} import import_for_parent; import_for_parent()"]
    too_much = f"its import takes more than {MAX_CPU_S} s or {MAX_MEMORY_BYTES >> 30} GB"
    try:
        done = subprocess.run(  # noqa: S603 - our own Python, with our own words
            command, check=False, input=asked.encode(), capture_output=True, timeout=MAX_S, env=environment
        )
    except subprocess.TimeoutExpired as error:
        raise InvalidInputError(where, too_much, "Reduce the mesh in a mesh editor") from error
    if done.returncode == 0:
        head, _, data = done.stdout.partition(b"\n")
        return Made(data, json.loads(head))
    if done.returncode == _MISSING:
        raise MissingDependencyError(*json.loads(done.stdout))
    if done.returncode == _BROKEN:
        raise InvalidInputError(*json.loads(done.stdout))
    said = last_line(done.stderr.decode("utf-8", "replace")) or f"status {done.returncode}"
    raise InvalidInputError(where, f"{too_much}, or its reader broke off ({said})", "Reduce it or export it again")


def import_for_parent() -> None:
    """Import the mesh that standard input names and write it to standard output: the main function of the child."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print must not stand in the answer
    asked = json.loads(sys.stdin.read())
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_CPU_S, MAX_CPU_S + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    path = Path(asked["path"])
    files = FolderResolver(path.parent, one_line(path.name, most=120))
    try:
        data = to_bytes(import_mesh(path, Wishes(**asked["wishes"]), files))
        answers.write(json.dumps(files.digests).encode() + b"\n" + data)
    except InvalidInputError as error:
        code, told = _BROKEN, [error.where, error.problem, error.cure]
    except MissingDependencyError as error:
        code, told = _MISSING, [str(error)]
    else:
        code, told = 0, []
    if told:
        answers.write(json.dumps(told).encode())
    answers.flush()
    os._exit(code)
