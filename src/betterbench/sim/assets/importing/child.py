"""Import of an untrusted file in a separate process with memory and time limits. The results are cached.

A separate process is needed because the mesh readers, the image readers and the convex decomposition are written in
C++, and a malicious file can crash or hang them.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import platformdirs
from pydantic import TypeAdapter

from betterbench.errors import InvalidInputError, described, one_line
from betterbench.jobs.durable import write_durably
from betterbench.jobs.limited_process import LimitedProcess, LimitedProcessError, RefusedError, answer_requests
from betterbench.json_form import dump_json, file_digest, read_bounded, read_form
from betterbench.ordinary_file import open_ordinary
from betterbench.sim.assets.importing.importer import Imported, Wishes, import_mesh
from betterbench.sim.assets.importing.mesh_file import MAX_FILE_BYTES, FolderResolver
from betterbench.sim.assets.importing.stored import from_bytes, to_bytes

VERSION = 10
"""Version of the importer. It is incremented whenever the same file would give a different asset than before."""
MAX_MEMORY_BYTES = 6 * 1024**3
MAX_CPU_S = 120.0
MAX_S = 900.0
"""Wall-clock time limit of an import [s], well above the CPU time limit because machines may be busy."""

_MAIN = "betterbench.sim.asset_checks.tried_grasps:import_for_parent"
"""Main function of the child process.

It is given by name, because it tests grasps in the simulator, which asset packages must not import.
"""
MOST_STORED_BYTES = 64 << 20
"""Maximum size of an imported object's file [byte]."""
_MOST_NOTE_BYTES = 1 << 20
_FILES = TypeAdapter(dict[Literal["files"], dict[str, str]])
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@dataclass(frozen=True, slots=True)
class Made:
    """Imported object in serialized form.

    Attributes:
        data: The object in the format of :func:`~betterbench.sim.assets.importing.stored.to_bytes`.
        files: SHA-256 of each file that was read, keyed by its path relative to the folder of the imported file.
    """

    data: bytes
    files: Mapping[str, str]


def import_safely(path: Path, wishes: Wishes = Wishes()) -> Imported:  # noqa: B008 - frozen
    """Import the object in a file like :func:`import_bytes`, but return it as an object instead of bytes."""
    return from_bytes(import_bytes(path, wishes).data, one_line(path.name, most=120))


def import_bytes(path: Path, wishes: Wishes = Wishes()) -> Made:  # noqa: B008 - frozen
    """Import the object in a file, using a separate process with limited time and memory.

    If the user's cache contains the result of this import, the cached result is returned.

    Raises:
        InvalidInputError: If the file cannot be read, does not contain an object of tabletop size, or takes more memory
            or time than allowed.
        MissingDependencyError: If a package that reads the file format is not installed.
    """
    where = one_line(path.name, most=120)
    place = cache_folder() / _key(path, _digest(path, where), wishes)
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


def _digest(path: Path, where: str) -> str:
    """Return the SHA-256 of a file. Raises InvalidInputError if the file exceeds the size limit or cannot be read."""
    try:
        with open_ordinary(path) as file:
            size = file.seek(0, 2)
            if size > MAX_FILE_BYTES:
                problem = f"it has {size >> 20:,} MB, expected at most {MAX_FILE_BYTES >> 20}"
                raise InvalidInputError(where, problem, "Reduce the mesh in a mesh editor")
            file.seek(0)
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        problem = f"it cannot be read ({error.strerror or error})"
        raise InvalidInputError(where, problem, "Pass the path of a readable file") from error


def cache_folder() -> Path:
    """Return the folder that caches imported objects. Users can delete the folder at any time."""
    return platformdirs.user_cache_path("betterbench") / "imported"


def _key(path: Path, digest: str, wishes: Wishes) -> str:
    """Return a digest of everything that the result of an import depends on.

    The digest covers the file, the names that determine the kind of object, and the import options.
    """
    named = "/".join(path.absolute().parts[-4:])
    known = f"{VERSION}|{json.dumps(asdict(wishes), sort_keys=True)}|{named}|{digest}"
    return hashlib.sha256(known.encode()).hexdigest()[:32]


def _content(files: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps(dict(files), sort_keys=True).encode()).hexdigest()[:16]


def _kept(path: Path, place: Path, where: str) -> Made | None:
    """Return the cached result of an import. If there is none, or a source file has changed, return None."""
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
    except (InvalidInputError, OSError):  # if the cached file is missing or damaged, the object is imported again
        return None
    return Made(data, files)


def _in_child(path: Path, wishes: Wishes, where: str) -> Made:
    asked = {"path": str(path.absolute()), "wishes": asdict(wishes)}
    process = LimitedProcess(_MAIN, cpu_s=MAX_CPU_S, environment=_ONE_THREAD)
    try:
        process.send(asked, b"", within_s=MAX_S)
        files = json.loads(process.receive(most=_MOST_NOTE_BYTES, within_s=MAX_S))
        return Made(bytes(process.receive(most=MOST_STORED_BYTES, within_s=MAX_S)), files)
    except RefusedError as error:
        raise InvalidInputError(where, str(error), "Export the object again, or leave out this file") from error
    except LimitedProcessError as error:
        problem = f"its import takes more than {MAX_CPU_S:g} s or {MAX_MEMORY_BYTES >> 30} GB, or fails ({error})"
        raise InvalidInputError(where, problem, "Reduce the mesh in a mesh editor, or export it again") from error
    finally:
        process.close()


def answer_imports(finish: Callable[[Imported], Imported]) -> None:
    """Import the objects that the parent process requests. This function runs in the child process.

    Args:
        finish: Function for the final step of an import. It is applied to each imported object.
    """
    answers = functools.partial(_answers, finish=finish)
    answer_requests(answers, memory_bytes=MAX_MEMORY_BYTES, cpu_s=MAX_CPU_S, unexpected=_unexpected)


def _unfinished(imported: Imported) -> Imported:
    return imported


def _answers(
    asked: Mapping[str, Any], _data: bytes, *, finish: Callable[[Imported], Imported] = _unfinished
) -> Iterator[bytes]:
    path = Path(asked["path"])
    files = FolderResolver(path.parent, one_line(path.name, most=120))
    data = to_bytes(finish(import_mesh(path, Wishes(**asked["wishes"]), files)))
    yield json.dumps(files.digests).encode()
    yield data


def _unexpected(problem: Exception) -> str:
    if isinstance(problem, MemoryError):
        return f"its import takes more than {MAX_MEMORY_BYTES >> 30} GB"
    return f"it cannot be imported ({described(problem)})"
