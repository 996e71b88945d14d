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
from dataclasses import asdict
from pathlib import Path

import platformdirs

from betterbench.errors import InvalidInputError, MissingDependencyError, last_line, one_line
from betterbench.jobs.durable import write_durably
from betterbench.json_form import read_bounded
from betterbench.sim.assets.importing.importer import Imported, Wishes, import_mesh
from betterbench.sim.assets.importing.mesh_file import MAX_FILE_BYTES
from betterbench.sim.assets.importing.stored import from_bytes, to_bytes

VERSION = 2
"""Raised when the same file would become another asset."""
MAX_MEMORY_BYTES = 6 * 1024**3
MAX_CPU_S = 120
MAX_S = 900.0
"""Longest time of an import [s]; much more than the processor time, because a busy machine is slow."""

_MOST_STORED_BYTES = 64 << 20
_BROKEN, _MISSING = 3, 4


def import_safely(path: Path, wishes: Wishes = Wishes()) -> Imported:  # noqa: B008 - frozen
    """Make an asset of a mesh file in a limited process, or take it from the cache of the user.

    Raises:
        InvalidInputError: If the file cannot be read, no object of a table can be made of it, or it takes more memory
            or time than an import may.
        MissingDependencyError: If a package that its format needs is not installed.
    """
    where = one_line(path.name, most=120)
    data = read_bounded(path, max_bytes=MAX_FILE_BYTES, cure="Reduce the mesh in a mesh editor")
    file = cache_folder() / f"{_key(path, data, wishes)}.npz"
    if file.is_file():
        try:
            return from_bytes(read_bounded(file, max_bytes=_MOST_STORED_BYTES, cure="Delete it"), where)
        except InvalidInputError:
            pass  # a damaged file of the cache is made again
    made = _in_child(path, wishes, where)
    imported = from_bytes(made, where)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_durably(file, made)
    return imported


def cache_folder() -> Path:
    """Return the folder in which imported objects are kept; deleting it loses nothing but time."""
    return platformdirs.user_cache_path("betterbench") / "assets"


def _key(path: Path, data: bytes, wishes: Wishes) -> str:
    """Return a digest of what an import depends on: the file, the files beside it that it may use, and the wishes."""
    digest = hashlib.sha256(
        f"{VERSION}|{json.dumps(asdict(wishes), sort_keys=True)}|{path.parent.name}|{path.name}|".encode()
    )
    digest.update(hashlib.sha256(data).digest())
    if path.suffix.lower() in (".obj", ".gltf"):
        # Materials, textures and buffers: by name, size and time, since a scan has megabytes of them.
        for other in sorted(path.parent.iterdir()):
            if other.is_file() and other != path:
                known = other.stat()
                digest.update(f"{other.name}|{known.st_size}|{known.st_mtime_ns}|".encode())
    return digest.hexdigest()[:32]


def _in_child(path: Path, wishes: Wishes, where: str) -> bytes:
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
        return done.stdout
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
    try:
        answers.write(to_bytes(import_mesh(Path(asked["path"]), Wishes(**asked["wishes"]))))
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
