"""A run folder: where everything of a run lies, and whose run it is."""

from __future__ import annotations

import io
import json
import re
import stat
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from betterbench.errors import InvalidInputError, RecordError, RunConflictError
from betterbench.recording.durable import PART_SUFFIX, write_durably
from betterbench.recording.journal import LOCK_NAME, Journal, JournalEntry, read_journal
from betterbench.recording.lock import RunLock, is_locked
from betterbench.recording.metadata import dump_json
from betterbench.recording.parquet import read_record, write_record
from betterbench.recording.record import Record
from betterbench.tasks.user_files import COPIES, loaded_files, require_origins

RUN_SCHEMA_VERSION = 1
"""Version of ``run.json`` and of the layout of the folder."""

MAX_SCENE_BYTES = 256 * 1024 * 1024
"""Largest size of a stored scene after decompression."""

MAX_SCENE_FILES = 10_000
"""Largest number of files of a stored scene."""

_MAX_RUN_JSON_BYTES = 64 * 1024 * 1024
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
_HASH = re.compile(r"[0-9a-f]{8,128}")
_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time a zip archive can hold
_READ_BLOCK = 1 << 20


@dataclass(frozen=True, slots=True)
class RunFolder:
    """A folder that holds one run.

    Attributes:
        path: The folder.
        plan: What was asked for: everything that two runs must share to be the same run.
        context: What is good to know and may differ on resuming: machine, policy handshake.
    """

    path: Path
    plan: Mapping[str, Any]
    context: Mapping[str, Any]

    @classmethod
    def start(cls, path: Path, plan: Mapping[str, Any], *, context: Mapping[str, Any] | None = None) -> RunFolder:
        """Create a run, or resume the one in the folder if it has the same plan.

        ``run.json`` is written before anything else. A resumed run keeps the context of its first start.

        Args:
            path: The folder; it is made if missing.
            plan: JSON form of everything that makes this run what it is.
            context: JSON form of what else is good to know.

        Returns:
            The run folder.

        Raises:
            RunConflictError: If the folder holds a run with another plan, other files, or is being written to.
            RecordError: If its ``run.json`` is corrupt.
            InvalidInputError: If plan or context is not JSON.
        """
        wanted = {"schema_version": RUN_SCHEMA_VERSION, "plan": dict(plan), "context": dict(context or {})}
        data = dump_json(wanted)
        wanted = json.loads(data)
        if path.exists() and not path.is_dir():
            raise RunConflictError(f"{path}: this is a file. Choose another folder for the run.")
        fresh = not (path / "run.json").exists()
        if fresh and path.exists() and any(not _is_leftover(p) for p in path.iterdir()):
            raise RunConflictError(f"{path}: the folder holds other files and no run. Choose an empty or a new folder.")
        with RunLock(path / LOCK_NAME):
            _remove_parts(path)
            if not (path / "run.json").exists():
                write_durably(path / "run.json", _run_json(wanted))
                _copy_task_files(path, wanted["plan"])
                return cls(path, wanted["plan"], wanted["context"])
        existing = cls.open(path)
        difference = first_difference(existing.plan, wanted["plan"], "plan")
        if difference is not None:
            where, there, asked = difference
            raise RunConflictError(
                f"{path}: the run in this folder is another one: {where} is {there} there and {asked} here. "
                "Give the same arguments to resume it, or choose another folder."
            )
        _copy_task_files(path, existing.plan)
        return existing

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """Open an existing run for reading.

        Raises:
            RecordError: If the folder holds no run, a corrupt one or one of another version, or its tasks are defined
                by a user's file that is not loaded.
        """
        file = path / "run.json"
        try:
            if file.stat().st_size > _MAX_RUN_JSON_BYTES:
                raise RecordError(f"{file}: is larger than {_MAX_RUN_JSON_BYTES} bytes. This is no run.")
            form = json.loads(file.read_bytes())
        except (FileNotFoundError, NotADirectoryError):
            raise RecordError(f"{path}: holds no run (no run.json). Give the folder that `--out` named.") from None
        except (ValueError, RecursionError) as error:
            raise RecordError(f"{file}: is corrupt ({error}). Restore it, or start the run in a new folder.") from error
        version = form.get("schema_version") if isinstance(form, dict) else None
        if version != RUN_SCHEMA_VERSION:
            raise RecordError(
                f"{file}: schema version {version!r} is not {RUN_SCHEMA_VERSION}. "
                "Read the run with the version of betterbench that wrote it."
            )
        for name in ("plan", "context"):
            if not isinstance(form.get(name), dict):
                raise RecordError(f"{file}: {name!r} is missing or malformed. Restore it, or start in a new folder.")
        require_origins(form["plan"], path)
        return cls(path, form["plan"], form["context"])

    @property
    def journal_path(self) -> Path:
        """The file with one line per finished trial."""
        return self.path / "journal.jsonl"

    @property
    def report_path(self) -> Path:
        """The folder of the report."""
        return self.path / "report"

    @property
    def is_running(self) -> bool:
        """Whether a process is writing to the run now."""
        return is_locked(self.path / LOCK_NAME)

    def amended(self, changes: Mapping[str, Any]) -> RunFolder:
        """Write what became known about the run later into its context, and return the run.

        Args:
            changes: JSON form by name; what the context held under a name is replaced.

        Raises:
            RunConflictError: If a process is writing to the run.
            InvalidInputError: If a change is not JSON.
        """
        form = {"schema_version": RUN_SCHEMA_VERSION, "plan": dict(self.plan), "context": {**self.context, **changes}}
        form = json.loads(dump_json(form))
        with RunLock(self.path / LOCK_NAME):
            write_durably(self.path / "run.json", _run_json(form))
        return RunFolder(self.path, form["plan"], form["context"])

    def journal(self) -> Journal:
        """Open the journal for appending; this locks the folder until it is closed.

        Raises:
            RunConflictError: If another process writes to the run.
            RecordError: If the journal is corrupt.
        """
        return Journal(self.journal_path)

    def entries(self) -> tuple[JournalEntry, ...]:
        """Read the journal without locking the folder.

        Raises:
            RecordError: If the journal is corrupt.
        """
        return read_journal(self.journal_path)

    def record_path(self, task: str, condition: str, seed: int) -> Path:
        """Return the place of a trial's record.

        Args:
            task: Task id.
            condition: Name of the condition within the task: a variation's name, or "train1".
            seed: Seed of the trial.

        Raises:
            InvalidInputError: If a name could leave the folder or the seed is negative.
        """
        return self._inside("records", task, condition, f"{_seed(seed)}.parquet")

    def video_path(self, task: str, condition: str, seed: int, *, camera: str) -> Path:
        """Return the place of a trial's video; see :meth:`record_path`.

        Raises:
            InvalidInputError: If a name could leave the folder or the seed is negative.
        """
        return self._inside("videos", task, condition, f"{_seed(seed)}_{_safe_name('camera', camera)}.mp4")

    def scene_path(self, scene_hash: str) -> Path:
        """Return the place of a stored scene.

        Raises:
            InvalidInputError: If it is no hash in lower-case hexadecimal digits.
        """
        if not _HASH.fullmatch(scene_hash):
            raise InvalidInputError("scene hash", f"{scene_hash!r} is none", "Give 8 to 128 hexadecimal digits")
        return self._inside("scenes", f"{scene_hash}.zip")

    def write_record(self, record: Record) -> Path:
        """Write a record to its place and return it."""
        m = record.metadata
        path = self.record_path(m.task, m.condition, m.seed)
        write_record(record, path)
        return path

    def read_record(self, task: str, condition: str, seed: int) -> Record:
        """Read a trial's record.

        Raises:
            RecordError: If it is missing or unreadable, or is the record of another trial.
        """
        path = self.record_path(task, condition, seed)
        record = read_record(path)
        m = record.metadata
        if (m.task, m.condition, m.seed) != (task, condition, seed):
            raise RecordError(
                f"{path}: is the record of {m.task}/{m.condition} seed {m.seed}. "
                "Put the right file back, or run the trial again."
            )
        return record

    def records(self) -> Iterator[Record]:
        """Yield the record of every trial that the journal calls done, in the order of the journal.

        Raises:
            RecordError: If a record is missing or unreadable.
        """
        for entry in self.entries():
            if entry.status == "done":
                yield self.read_record(entry.task, entry.condition, entry.seed)

    def store_scene(self, scene_hash: str, files: Mapping[str, bytes]) -> Path:
        """Store a scene once; the same files give the same bytes.

        Args:
            scene_hash: Name of the scene, which stands for its content.
            files: Content by relative name with forward slashes.

        Returns:
            The archive; one that exists is left as it is.

        Raises:
            InvalidInputError: If a name could leave the archive's folder or the scene is too large.
        """
        path = self.scene_path(scene_hash)
        if path.exists():
            return path
        for name in files:
            problem = _member_problem(name)
            if problem:
                raise InvalidInputError(f"scene file {name!r}", problem, "Give a relative name with forward slashes")
        total = sum(len(data) for data in files.values())
        if total > MAX_SCENE_BYTES or len(files) > MAX_SCENE_FILES:
            problem = f"{len(files)} files with {total} bytes exceed {MAX_SCENE_FILES} files or {MAX_SCENE_BYTES} bytes"
            raise InvalidInputError("scene", problem, "Reduce its meshes and textures")
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(files):
                member = zipfile.ZipInfo(name, _ZIP_EPOCH)
                member.compress_type = zipfile.ZIP_DEFLATED
                member.create_system = 3  # Unix, whatever the machine
                member.external_attr = (stat.S_IFREG | 0o644) << 16
                archive.writestr(member, files[name])
        write_durably(path, buffer.getvalue())
        return path

    def load_scene(self, scene_hash: str) -> dict[str, bytes]:
        """Return the files of a stored scene by name, without writing any of them.

        Raises:
            RecordError: If the scene is missing, damaged or too large, or a name could leave a folder.
        """
        path = self.scene_path(scene_hash)
        try:
            with zipfile.ZipFile(path) as archive:
                return _read_members(path, archive)
        except FileNotFoundError:
            raise RecordError(f"{path}: the scene is not stored. Run the trial again to store it.") from None
        except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError, OSError) as error:
            raise RecordError(f"{path}: is damaged ({error}). Delete it and run the trial again.") from error

    def _inside(self, top: str, *names: str) -> Path:
        """Return a path below the folder, and refuse one that would lead out of it."""
        path = self.path / top
        for what, name in zip(("task", "condition", "file")[-len(names) :], names, strict=True):
            path /= _safe_name(what, name)
        if not path.resolve().is_relative_to(self.path.resolve()):
            raise InvalidInputError(str(path), "leads out of the run folder by a link", "Remove the link")
        return path


def _run_json(form: Mapping[str, Any]) -> bytes:
    """Return the content of ``run.json``."""
    return json.dumps(form, indent=2, sort_keys=True).encode() + b"\n"


def _copy_task_files(path: Path, plan: Mapping[str, Any]) -> None:
    """Keep a copy of each of the user's files that the tasks of a run come from."""
    for file in loaded_files() if plan.get("task_files") else ():
        if not (path / COPIES / file.copy_name).exists():
            write_durably(path / COPIES / file.copy_name, file.source.encode())


def _safe_name(what: str, name: str) -> str:
    """Return a name that can stand in a path.

    Raises:
        InvalidInputError: If it cannot.
    """
    if not _NAME.fullmatch(name):
        problem = f"{name!r} cannot be the name of a file"
        raise InvalidInputError(
            what, problem, "Use up to 100 letters, digits, '_', '-' and '.', the first a letter or digit"
        )
    return name


def _seed(seed: int) -> int:
    """Return a seed that can stand in a file name.

    Raises:
        InvalidInputError: If it is negative.
    """
    if seed < 0:
        raise InvalidInputError("seed", f"{seed} is negative", "Give an integer of at least 0")
    return seed


def _member_problem(name: str) -> str | None:
    """Return why a name must not stand in an archive, or None."""
    if not name or len(name) > 200 or any(ord(c) < 32 for c in name) or "\\" in name or ":" in name:
        return "is no portable file name"
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or str(path) != name:
        return "could lead out of its folder"
    return None


def _read_members(path: Path, archive: zipfile.ZipFile) -> dict[str, bytes]:
    """Return the content of an archive within the limits.

    Raises:
        RecordError: If it exceeds them, or holds a name that could lead out of a folder or stands there twice.
    """
    members = archive.infolist()
    too_large = RecordError(f"{path}: unpacks to more than {MAX_SCENE_BYTES} bytes. This is no scene of a run.")
    if len(members) > MAX_SCENE_FILES or sum(m.file_size for m in members) > MAX_SCENE_BYTES:
        raise too_large
    files: dict[str, bytes] = {}
    left = MAX_SCENE_BYTES
    for member in members:
        problem = "stands there twice" if member.filename in files else _member_problem(member.filename)
        if problem:
            raise RecordError(f"{path}: the member {member.filename!r} {problem}. This is no scene of a run.")
        blocks: list[bytes] = []
        with archive.open(member) as stream:
            while block := stream.read(_READ_BLOCK):
                left -= len(block)
                if left < 0:
                    raise too_large
                blocks.append(block)
        files[member.filename] = b"".join(blocks)
    return files


def _is_leftover(path: Path) -> bool:
    """Tell whether a file is one that a run that never began may have left."""
    return path.name == LOCK_NAME or path.name.endswith(PART_SUFFIX)


def _remove_parts(folder: Path) -> None:
    """Delete half-written files of a killed process; the caller holds the lock of the run."""
    for part in folder.rglob(f".*{PART_SUFFIX}"):
        part.unlink(missing_ok=True)


def first_difference(there: object, asked: object, where: str) -> tuple[str, str, str] | None:
    """Return the first place at which two JSON values differ, in sorted order, with both values as text, or None.

    Args:
        there: One value.
        asked: The other.
        where: Name of the whole, which the place begins with.
    """
    if isinstance(there, dict) and isinstance(asked, dict):
        for key in sorted(set(there) | set(asked)):
            if key not in there or key not in asked:
                return f"{where}.{key}", _shown(there.get(key, _ABSENT)), _shown(asked.get(key, _ABSENT))
            found = first_difference(there[key], asked[key], f"{where}.{key}")
            if found:
                return found
        return None
    if isinstance(there, list) and isinstance(asked, list):
        for i, (a, b) in enumerate(zip(there, asked, strict=False)):
            found = first_difference(a, b, f"{where}[{i}]")
            if found:
                return found
        if len(there) != len(asked):
            return f"the length of {where}", str(len(there)), str(len(asked))
        return None
    if type(there) is type(asked) and there == asked:
        return None
    return where, _shown(there), _shown(asked)


_ABSENT = object()


def _shown(value: object) -> str:
    """Return a value for a message, shortened."""
    if value is _ABSENT:
        return "absent"
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 80 else text[:77] + "..."
