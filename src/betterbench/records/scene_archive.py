"""Scene archives: reproducible zip files with compiled scenes. They may come from an untrusted source.

The comment of the zip file contains a digest of the scene's name and all its files (:func:`scene_digest`). The digest
is verified before any file is used, so that MuJoCo never loads a changed model or the archive of a different scene. The
journal of a run also contains the digest of each trial's scene, so an archive that was replaced together with its
digest is detected too.
"""

from __future__ import annotations

import hashlib
import io
import os
import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Protocol

from betterbench.errors import InvalidInputError, RecordError, one_line
from betterbench.jobs.durable import write_durably
from betterbench.json_form import content_digest, read_bounded, say_unsealed
from betterbench.ordinary_file import open_ordinary

MAX_SCENE_BYTES = 256 * 1024 * 1024
"""Maximum size of a stored scene after decompression [byte]."""

MAX_SCENE_FILES = 10_000
"""Maximum number of files in a stored scene."""

_LEVEL = 3
"""Compression level. Compression takes half as long as with zlib's default level 6 (60 to 100 ms) and archives are
5 % larger.
"""
_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip archive can store
_SEAL_MARK = b"betterbench scene sha256 "
_READ_BLOCK = 1 << 20
_AGAIN = "Repeat the command of the run to store it again"

_WRITTEN: dict[str, tuple[Path, str]] = {}
"""Archives that this process has written: path and SHA-256 of the file, by the digest of the scene."""


class StorableScene(Protocol):
    """Compiled scene that can be stored with the records of its trials."""

    @property
    def content_hash(self) -> str:
        """Name under which the scene is stored. Within one process, it identifies the scene's files."""

    def files(self) -> dict[str, bytes]:
        """Return the stored files of the scene by name."""


def scene_digest(name: str, files: Mapping[str, bytes]) -> str:
    """Return the SHA-256 of a scene's name and of the names and contents of its files (hex, 64 characters)."""
    lines = [f"{hashlib.sha256(files[file]).hexdigest()} {file}\n" for file in sorted(files)]
    return content_digest(name, "".join(lines).encode())


def write_scene(path: Path, files: Mapping[str, bytes]) -> None:
    """Store the files of a scene as ``HASH.zip``. The same files always give the same bytes.

    Raises:
        InvalidInputError: If a name would lead out of the archive's folder, or if the scene is too large.
    """
    for name in files:
        problem = _member_problem(name)
        if problem:
            raise InvalidInputError(f"scene file {name!r}", problem, "Use a relative name with forward slashes")
    total = sum(len(data) for data in files.values())
    if total > MAX_SCENE_BYTES or len(files) > MAX_SCENE_FILES:
        problem = f"{len(files)} files with {total} bytes exceed {MAX_SCENE_FILES} files or {MAX_SCENE_BYTES} bytes"
        raise InvalidInputError("scene", problem, "Reduce its meshes and textures")
    digest = scene_digest(path.stem, files)
    data = _archive_of_another_run(digest) or _archive(files, digest)
    write_durably(path, data)
    _WRITTEN[digest] = (path.absolute(), hashlib.sha256(data).hexdigest())


def _archive(files: Mapping[str, bytes], digest: str) -> bytes:
    """Return a reproducible zip file with the digest as its comment."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            member = zipfile.ZipInfo(name, _ZIP_EPOCH)
            member.compress_type = zipfile.ZIP_DEFLATED
            member.create_system = 3  # always Unix, so that the bytes do not depend on the machine
            member.external_attr = (stat.S_IFREG | 0o644) << 16
            archive.writestr(member, files[name], compresslevel=_LEVEL)
        archive.comment = _seal(digest)
    return buffer.getvalue()


def _archive_of_another_run(digest: str) -> bytes | None:
    """Return the archive that this process wrote earlier for the same scene, or None if it was removed or changed.

    This saves time when several policies are evaluated on the same scenes: reading an archive takes 1 ms of CPU time,
    and creating it takes 34 ms.
    """
    path, checksum = _WRITTEN.get(digest, (None, ""))
    if path is None:
        return None
    try:
        with open_ordinary(path) as stream:
            data = stream.read(MAX_SCENE_BYTES)
    except OSError:
        return None
    return data if hashlib.sha256(data).hexdigest() == checksum else None


def has_digest(path: Path, digest: str) -> bool:
    """Return whether an archive contains the given digest. Its files are verified later, when the archive is read."""
    seal = _seal(digest)
    try:
        with open_ordinary(path) as stream:
            stream.seek(-len(seal), os.SEEK_END)
            return stream.read() == seal
    except OSError:
        return False


def read_scene(path: Path, *, digest: str | None = None) -> dict[str, bytes]:
    """Return the files of a stored scene by name, without writing them to disk.

    ``digest`` is the digest in the journal. If it is given, the files must match it. Archives of earlier versions
    contain no digest. For these, one warning is logged per run unless the journal's digest is given.

    Raises:
        RecordError: If the scene is missing, damaged, changed or too large, if it belongs to a different trial or has a
            different hash, or if a file name would lead out of a folder.
    """
    try:
        data = read_bounded(path, max_bytes=MAX_SCENE_BYTES, cure=_AGAIN, raises=RecordError)
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            files, seal = _read_members(path, archive), archive.comment
    except RecordError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            raise RecordError(f"{path}: the scene is not stored. {_AGAIN}.") from None
        raise
    except Exception as error:  # decompressors may raise any exception for a damaged archive
        said = one_line(error, most=200) or type(error).__name__
        raise RecordError(f"{path}: the file is damaged ({said}). {_AGAIN}.") from error
    found = scene_digest(path.stem, files)
    if seal and seal != _seal(found):
        problem = "its digest does not match: the file was changed after it was written, or belongs to another scene"
        raise RecordError(f"{path}: {problem}. {_AGAIN}.")
    if digest is not None and found != digest:
        problem = "this is not the scene of the trial: its digest differs from the digest in the journal"
        raise RecordError(f"{path}: {problem}. {_AGAIN}.")
    if not seal and digest is None:
        say_unsealed(str(path.parent))
    return files


def _seal(digest: str) -> bytes:
    """Return the comment of an archive with the given digest."""
    return _SEAL_MARK + digest.encode()


def _member_problem(name: str) -> str | None:
    """Return the reason a name is not allowed in an archive, or None if it is allowed."""
    if not name or len(name) > 200 or any(ord(c) < 32 for c in name) or "\\" in name or ":" in name:
        return "is not a portable file name"
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or str(path) != name:
        return "could lead out of its folder"
    return None


def _read_members(path: Path, archive: zipfile.ZipFile) -> dict[str, bytes]:
    """Return the files in an archive, within the limits. Raises RecordError if a name is unsafe or repeated."""
    members = archive.infolist()
    too_large = RecordError(
        f"{path}: the file unpacks to more than {MAX_SCENE_BYTES} bytes. This is not a scene of a run."
    )
    if len(members) > MAX_SCENE_FILES or sum(m.file_size for m in members) > MAX_SCENE_BYTES:
        raise too_large
    files: dict[str, bytes] = {}
    left = MAX_SCENE_BYTES
    for member in members:
        problem = "occurs twice" if member.filename in files else _member_problem(member.filename)
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            problem = "has an unexpected compression method"
        if problem:
            raise RecordError(f"{path}: the member {member.filename!r} {problem}. This is not a scene of a run.")
        blocks: list[bytes] = []
        with archive.open(member) as stream:
            while block := stream.read(_READ_BLOCK):
                left -= len(block)
                if left < 0:
                    raise too_large
                blocks.append(block)
        files[member.filename] = b"".join(blocks)
    return files
