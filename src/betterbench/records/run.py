"""Run folder: the paths of its files, its plan, its lock and its context."""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
import re
import time
from collections.abc import Iterator, Mapping
from dataclasses import astuple, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired

from pydantic import Field, TypeAdapter
from typing_extensions import TypedDict

from betterbench.errors import InvalidInputError, RecordError, RunConflictError, one_line
from betterbench.jobs.conflict import require_free, require_same
from betterbench.jobs.durable import remove_parts, write_durably
from betterbench.jobs.line_journal import say_lost_tail
from betterbench.jobs.lock import LOCK_NAME, RunLock, is_locked
from betterbench.jobs.places import require_inside
from betterbench.json_form import (
    dump_json,
    file_digest,
    growing_form,
    open_seal,
    read_bounded,
    read_form,
    sealed_form,
    strict_form,
)
from betterbench.ordinary_file import read_ordinary
from betterbench.records.journal import Journal, JournalEntry, read_journal
from betterbench.records.metadata import Outcome, RecordMetadata
from betterbench.records.parquet import AGAIN, RecordBrief, read_brief, read_record, write_record
from betterbench.records.record import Record
from betterbench.records.scene_archive import StorableScene, has_digest, read_scene, scene_digest, write_scene
from betterbench.tasks.trial_id import TrialId
from betterbench.tasks.user_files import COMPANION_SUFFIX, COPIES, loaded_files, require_origins
from betterbench.tasks.worlds.facts import WorldFacts, facts_of_plan

logger = logging.getLogger(__name__)

RUN_SCHEMA_VERSION = 2
"""Version of ``run.json`` and of the layout of the folder. Version 1 had no checksum."""

_MAX_RUN_JSON_BYTES = 64 * 1024 * 1024
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
_HASH = re.compile(r"[0-9a-f]{8,128}")


@growing_form
class _PolicyChange(TypedDict):
    """Context entry of a run that was continued with a different policy."""

    policy: dict[str, Any]
    trials_before: NotRequired[Annotated[int, Field(ge=0)]]
    difference: NotRequired[str]


@growing_form
class _RunContext(TypedDict, total=False):
    """Fields of a run's context that this module reads. All other fields are ignored."""

    policy: dict[str, Any]
    policy_changes: list[_PolicyChange]
    extended: list[dict[str, Any]]
    sources: str


@strict_form
@dataclass(frozen=True, slots=True)
class _RunDocument:
    schema_version: Literal[1, 2]
    plan: dict[str, Any]
    context: _RunContext


_RUN_DOCUMENT = TypeAdapter(_RunDocument)


@dataclass(frozen=True, slots=True)
class RunFolder:
    """Folder of one evaluation run.

    ``plan`` defines the run. A run can only be resumed with the same plan, or extended with more trials. ``context``
    contains further information that may differ when the run is resumed, such as the machine and the handshake of the
    policy.
    """

    path: Path
    plan: Mapping[str, Any]
    context: Mapping[str, Any]
    _planned: Mapping[TrialId, Mapping[str, Any]] | None = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Make the path absolute, so that it stays valid if the working directory changes."""
        object.__setattr__(self, "path", self.path.absolute())
        object.__setattr__(self, "_planned", _planned(self.plan))

    @property
    def planned(self) -> tuple[TrialId, ...]:
        """Trials of the plan in order. The sequence is empty if the plan does not list its trials."""
        return tuple(self._planned or ())

    @classmethod
    def start(cls, path: Path, plan: Mapping[str, Any], *, context: Mapping[str, Any] | None = None) -> RunFolder:
        """Create a run, or resume the run in the folder if its plan is the same or has only some of the new trials.

        The folder is created if it is missing, and ``run.json`` is written first. A resumed run keeps the context of
        its first start. If the new plan contains more trials, it replaces the stored plan, and the time of this change
        is added to the context.

        Raises:
            RunConflictError: If the folder contains other files or a run with a different plan, or if another process
                is writing to the folder.
            RecordError: If ``run.json`` is corrupt.
            InvalidInputError: If the plan or the context cannot be written as JSON.
        """
        path = path.absolute()
        wanted = _plain({"plan": dict(plan), "context": dict(context or {})})
        require_free(path, "run", file="run.json")
        with RunLock(path / LOCK_NAME):
            remove_parts(path)
            if not (path / "run.json").exists():
                write_durably(path / "run.json", _run_json(wanted["plan"], wanted["context"]))
                _copy_task_files(path, wanted["plan"])
                return cls(path, wanted["plan"], wanted["context"])
        existing = cls.open(path)
        if holds_more(wanted["plan"], existing.plan):
            existing = existing._grown(wanted["plan"])
        if holds_more(existing.plan, wanted["plan"]):
            stored, fewer = (len(plan["trials"]) for plan in (existing.plan, wanted["plan"]))
            raise RunConflictError(
                f"{path}: the run in this folder has {stored} trials, but this command requests only {fewer} of them. "
                "Request the same trials, tasks and variations to resume it, or more to extend it, or choose a "
                "different folder."
            )
        require_same(path, existing.plan, wanted["plan"], "run", where="plan")
        _copy_task_files(path, existing.plan)
        return existing

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """Open an existing run for reading.

        Raises:
            RecordError: If the folder contains no run, if the run is corrupt or of a different version, or if its tasks
                need a user's file that is not loaded.
        """
        try:
            holds_run = (path / "run.json").is_file()
        except OSError as error:
            raise RecordError(f"{one_line(path)}: {error.strerror}. Pass the --out folder of the run.") from error
        if not holds_run:
            inside = sorted(str(path / found.parent.name) for found in path.glob("*/run.json"))
            cure = f"Pass a run inside it: {', '.join(inside)}" if inside else "Pass the --out folder of a run"
            raise RecordError(f"{path}: contains no run (no run.json). {cure}.")
        cure = "Restore it, or start the run in a new folder. Read a run of another version with that version"
        data = read_bounded(path / "run.json", max_bytes=_MAX_RUN_JSON_BYTES, cure=cure, raises=RecordError)
        where = str(path / "run.json")
        form = open_seal(data, where=where, cure=cure, raises=RecordError, since=("schema_version", 2))
        if "plan" not in form and isinstance(form.get("kind"), str):
            kind = one_line(form["kind"], most=60)
            raise RecordError(
                f"{path}: the folder contains a {kind} instead of trials of a policy. Pass the folder of a run "
                "made with `better eval`. For a run made with `better vlm`, use `better compare` to see the scores or "
                "`better export --to lmms-eval` to write the answers."
            )
        document = read_form(_RUN_DOCUMENT, form, where=where, cure=cure, raises=RecordError)
        require_origins(document.plan, path)
        return cls(path, document.plan, dict(document.context))

    @property
    def journal_path(self) -> Path:
        """Path of the file with one line per finished trial."""
        return self.path / "journal.jsonl"

    @property
    def report_path(self) -> Path:
        """Path of the report folder. Raises the same errors as :meth:`inside`."""
        return self.inside("report")

    @property
    def world(self) -> WorldFacts:
        """Properties of the world (a simulator with its scenes) in which the trials were run.

        Raises RecordError if the plan names an unknown world.
        """
        return facts_of_plan(self.plan, where=str(self.path / "run.json"))

    @property
    def is_running(self) -> bool:
        """Whether a process is writing to the run now."""
        return is_locked(self.path / LOCK_NAME)

    def amended(self, changes: Mapping[str, Any]) -> RunFolder:
        """Add information to the context, and return the updated run.

        Raises:
            RunConflictError: If a process is writing to the run.
            InvalidInputError: If a change cannot be written as JSON.
        """
        return self._rewritten(self.plan, {**self.context, **changes})

    def restore(self) -> bool:
        """Write ``run.json`` again, with a warning, if it was removed or changed after the run was opened.

        Return whether the file was written.
        """
        path, content = self.path / "run.json", _run_json(self.plan, self.context)
        with contextlib.suppress(OSError, ValueError):
            unsealed = {"schema_version": 1, "plan": self.plan, "context": self.context}
            if json.loads(read_ordinary(path)) in (json.loads(content), unsealed):
                return False
        logger.warning("%s was removed or changed by another process and is written again", path)
        write_durably(path, content)
        return True

    def _grown(self, plan: Mapping[str, Any]) -> RunFolder:
        """Write a plan that extends the current plan, and return the updated run."""
        done = sum(entry.status == "done" for entry in self.entries())
        at_utc = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        step = {"at_utc": at_utc, "trials_before": len(self.plan["trials"]), "done_before": done}
        context = {**self.context, "extended": [*self.context.get("extended", []), step]}
        return self._rewritten(plan, context)

    def _rewritten(self, plan: Mapping[str, Any], context: Mapping[str, Any]) -> RunFolder:
        """Write ``run.json`` with a new plan or context, and return the updated run."""
        form = _plain({"plan": dict(plan), "context": dict(context)})
        with self.locked():
            write_durably(self.path / "run.json", _run_json(form["plan"], form["context"]))
        return RunFolder(self.path, form["plan"], form["context"])

    def journal(self, *, renews: bool = False) -> Journal:
        """Open the journal for appending. The folder is locked until the journal is closed.

        If ``renews`` is True, the journal stays usable even if the folder is removed or moved. The caller must then
        restore the run and repeat all trials whose records are missing.

        Raises:
            RecordError: If the journal lists trials that are not planned. For other errors, see
                :class:`~betterbench.records.journal.Journal`.
        """
        journal = Journal(self.journal_path, renews=renews)
        try:
            self._check_entries(journal.entries)
        except BaseException:
            journal.close()
            raise
        return journal

    def entries(self) -> tuple[JournalEntry, ...]:
        """Read the entries of the journal without locking the folder.

        Raises:
            RecordError: If the journal is corrupt or lists trials that are not planned.
        """
        entries = tuple(_known_entries(self.journal_path).values())
        self._check_entries(entries)
        self._say_unlisted(entries)
        return entries

    def entry(self, trial: TrialId) -> JournalEntry | None:
        """Return the last journal entry of a trial, or None if it has none.

        Raises the same errors as :meth:`entries`.
        """
        return _known_entries(self.journal_path).get(trial)

    def record_digest(self, entry: JournalEntry) -> str:
        """Return the SHA-256 of a finished trial's record.

        If an older version wrote the journal, the file is hashed.
        """
        return entry.record or file_digest(self.record_path(entry.task, entry.condition, entry.seed))

    def _say_unlisted(self, entries: tuple[JournalEntry, ...]) -> None:
        """Warn once about records that the journal does not list, unless this process is writing them."""
        told = (self.path, len(entries))
        if told in _TOLD or self.is_running:
            return
        _TOLD.add(told)
        listed = {TrialId(e.task, e.variation or e.condition, e.seed) for e in entries}
        unlisted = [t for t in self._planned or () if t not in listed and self.record_path(*astuple(t)).exists()]
        if unlisted:
            logger.warning(
                "%s: the journal does not list %d existing records (%s and others). It was truncated, or the run was "
                "killed. These records are ignored; run the command of this run again to repeat their trials",
                self.journal_path,
                len(unlisted),
                one_line(unlisted[0]),
            )

    def _check_entries(self, entries: tuple[JournalEntry, ...]) -> None:
        """Raise RecordError if the journal lists a trial that is not planned, or lists it twice."""
        planned, listed = self._planned, set[TrialId]()
        for entry in entries if planned is not None else ():
            key = TrialId(entry.task, entry.variation or entry.condition, entry.seed)
            trial = planned.get(key)  # type: ignore[union-attr] # checked above
            problem = ""
            if trial is None:
                problem = "is not planned"
            elif trial.get("variation") != entry.variation:
                problem = f"is not planned as a trial of {one_line(entry.variation)}"
            elif key in listed:
                problem = f"is a second result of {one_line(key)}"
            listed.add(key)
            if problem:
                raise RecordError(
                    f"{self.journal_path}: {one_line(entry.key)} {problem}, so the journal or run.json belongs to "
                    f"a different run. Restore both from a copy, or evaluate into a new folder."
                )

    def record_path(self, task: str, condition: str, seed: int) -> Path:
        """Return the path of a trial's record.

        Raises:
            InvalidInputError: If a name would lead out of the folder, or if the seed is negative.
        """
        return self._inside("records", task, condition, f"{_seed(seed)}.parquet")

    def video_path(self, task: str, condition: str, seed: int, *, camera: str) -> Path:
        """Return the path of a trial's video. Raises the same errors as :meth:`record_path`."""
        return self._inside("videos", task, condition, f"{_seed(seed)}_{_safe_name('camera', camera)}.mp4")

    def scene_path(self, scene_hash: str) -> Path:
        """Return the path of a stored scene. Raises InvalidInputError if the hash is not lower-case hexadecimal."""
        if not _HASH.fullmatch(scene_hash):
            raise InvalidInputError(
                "scene hash", f"{scene_hash!r} is not a hash", "Use a hash of 8 to 128 hexadecimal digits"
            )
        return self._inside("scenes", f"{scene_hash}.zip")

    def write_record(self, record: Record) -> Path:
        """Write a record to its path in the folder, and return the path."""
        m = record.metadata
        path = self.record_path(m.task, m.condition, m.seed)
        write_record(record, path)
        return path

    def read_record(self, task: str, condition: str, seed: int, *, digest: str | None = None) -> Record:
        """Read the record of a trial.

        ``digest`` is the expected digest of the file. Pass the digest from an earlier read to detect whether the run
        has changed since. By default, the digest in the journal is used.

        Raises:
            RecordError: If the record is missing or unreadable, if its bytes have changed, or if its trial, policy or
                action space differs from the plan and the journal.
        """
        trial = TrialId(task, condition, seed)
        path = self.record_path(task, condition, seed)
        record = read_record(path, digest=digest or self._digest(self.entry(trial)))
        self._check_record(path, trial, record.metadata)
        return record

    def read_brief(self, trial: TrialId, *, entry: JournalEntry | None = None) -> RecordBrief:
        """Read only the trial, the assets and the outcome of a record. This is faster than reading the whole record.

        Raises the same errors as :meth:`read_record`. If ``entry`` is given, the journal is not read.
        """
        path = self.record_path(trial.task, trial.condition, trial.seed)
        brief = read_brief(path, digest=self._digest(entry or self.entry(trial)))
        self._check_record(path, trial, brief.metadata)
        return brief

    def outcome(self, entry: JournalEntry) -> Outcome:
        """Return the outcome of the trial in a journal entry. Raises the same errors as :meth:`read_record`."""
        return self.read_brief(entry.key, entry=entry).outcome

    def succeeded(self, trial: TrialId, entry: JournalEntry | None = None) -> bool:
        """Return whether a trial succeeded, according to its record.

        The arguments and the errors are the same as for :meth:`read_brief`.
        """
        return self.read_brief(trial, entry=entry).outcome.success

    @staticmethod
    def _digest(entry: JournalEntry | None) -> str | None:
        return entry.record if entry is not None and entry.status == "done" else None

    def _check_record(self, path: Path, trial: TrialId, found: RecordMetadata | Any) -> None:  # noqa: ANN401
        """Raise RecordError if the metadata of a record contradict its path or the plan."""
        wanted: dict[str, object] = {"task": trial.task, "condition": trial.condition, "seed": trial.seed}
        if self._planned is not None:
            if trial not in self._planned:
                raise RecordError(
                    f"{path}: {one_line(trial)} is not planned in this run. Choose a record of a planned trial."
                )
            wanted["variation"] = self._planned[trial].get("variation")
            wanted |= {name: self.plan[name] for name in ("policy", "action_space") if name in self.plan}
        for name, value in wanted.items():
            there = getattr(found, name)
            if there != value:
                raise RecordError(
                    f"{path}: this is the record of {one_line(f'{found.task}/{found.condition} seed {found.seed}')} of "
                    f"{one_line(found.policy)}: its {name} is {one_line(repr(there), most=80)} but the run plans "
                    f"{one_line(repr(value), most=80)}. {AGAIN}."
                )

    def records(self) -> Iterator[Record]:
        """Yield the records of the finished trials, in the order of the journal.

        Raises RecordError if a record is invalid.
        """
        for entry in self.entries():
            if entry.status == "done":
                yield self.read_record(entry.task, entry.condition, entry.seed)

    def set_aside(self, path: Path) -> Path | None:
        """Move an unusable file to ``RUN/set-aside``. Return its new path, or None if there is no file.

        The file is not deleted, because it may be the only copy that the user has.
        """
        if not path.exists() and not path.is_symlink():
            return None
        folder = self.inside("set-aside")
        folder.mkdir(exist_ok=True)
        name = "-".join(path.relative_to(self.path).parts[1:])
        place = next(p for n in itertools.count() if not (p := folder / f"{n}-{name}").exists())
        path.rename(place)
        return place

    def store_scene(self, scene_hash: str, files: Mapping[str, bytes]) -> Path:
        """Store a scene once. Raises the same errors as :func:`~betterbench.records.scene_archive.write_scene`."""
        path = self.scene_path(scene_hash)
        if not path.exists():
            write_scene(path, files)
        return path

    def keep_scene(self, scene: StorableScene) -> str:
        """Store the scene of a trial unless it is already stored, and return its digest for the journal.

        An empty file means that the scene is stored elsewhere. A file that does not contain a scene is moved aside.

        Raises:
            RunConflictError: If a different scene has the same name, because it comes from another version or source.
            InvalidInputError: For the same reasons as in :func:`~betterbench.records.scene_archive.write_scene`.
        """
        name = scene.content_hash
        path = self.scene_path(name)
        if name not in _DIGESTS:  # computing the digest takes 30 ms, so do it only once per scene
            _DIGESTS[name] = scene_digest(name, scene.files())
        digest = _DIGESTS[name]
        if has_digest(path, digest) or (path.is_file() and path.stat().st_size == 0):
            return digest
        if path.exists():
            try:
                there = scene_digest(path.stem, read_scene(path))
            except RecordError as problem:
                logger.warning("%s The file is kept as %s.", problem, self.set_aside(path))
            else:
                if there == digest:
                    return digest  # stored by an earlier version without a checksum
                raise RunConflictError(
                    f"{path}: this is not the scene of this trial, although it has the same name. It comes from a "
                    f"different version or source. Evaluate into a new folder, or move the file away if no finished "
                    f"trial has used it."
                )
        write_scene(path, scene.files())
        return digest

    def load_scene(self, scene_hash: str, *, digest: str | None = None) -> dict[str, bytes]:
        """Return the files of a stored scene by name, without writing them to disk.

        Raises the same errors as ``read_scene``.
        """
        return read_scene(self.scene_path(scene_hash), digest=digest)

    def scene_digest(self, trial: TrialId) -> str | None:
        """Return the digest of a trial's scene according to the journal.

        If an earlier version wrote the journal, return None and log one warning.
        """
        entry = self.entry(trial)
        if entry is None or entry.status != "done":
            return None
        if entry.scene is None and self.path not in _WITHOUT_SCENES:
            _WITHOUT_SCENES.add(self.path)
            logger.warning(
                "%s: an earlier version wrote this journal without scene digests, so a replaced scene would not be "
                "detected",
                self.journal_path,
            )
        return entry.scene

    def scene_of(self, record: RecordMetadata) -> dict[str, bytes]:
        """Return the scene files of a recorded trial, after verifying them against the journal.

        Raises the same errors as :func:`~betterbench.records.scene_archive.read_scene`.
        """
        digest = self.scene_digest(TrialId(record.task, record.condition, record.seed))
        return self.load_scene(record.scene_hash, digest=digest)

    def _inside(self, top: str, *names: str) -> Path:
        """Return a path inside the folder. Raises InvalidInputError if the path leads out of the folder."""
        path = self.path / top
        for what, name in zip(("task", "condition", "file")[-len(names) :], names, strict=True):
            path /= _safe_name(what, name)
        return self.inside(*path.relative_to(self.path).parts)

    def inside(self, *names: str) -> Path:
        """Return a path inside the folder. Raises InvalidInputError if a link leads out of the folder."""
        path = self.path.joinpath(*names)
        require_inside(path, self.path)
        return path

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Context manager that locks the folder. Raises RunConflictError if another process is writing to it."""
        with RunLock(self.path / LOCK_NAME):
            yield


_DIGESTS: dict[str, str] = {}
"""Digests of the scenes that this process has used, by the scene's name."""

_WITHOUT_SCENES: set[Path] = set()
"""Runs whose missing scene digests have already been reported."""

_TOLD: set[tuple[Path, int]] = set()
"""Runs that have been checked for unlisted records, with the number of listed trials at that time."""


@lru_cache(maxsize=8)
def _entries_at(path: Path, size: int, changed_ns: int) -> dict[TrialId, JournalEntry]:
    """Return the entries of a journal by trial. The cache depends on the file's size and time of last change."""
    del size, changed_ns
    entries = {entry.key: entry for entry in read_journal(path)}
    say_lost_tail(path)
    return entries


def _known_entries(path: Path) -> dict[TrialId, JournalEntry]:
    try:
        known = path.stat()
    except FileNotFoundError:
        return {}
    return _entries_at(path, known.st_size, known.st_mtime_ns)


def _planned(plan: Mapping[str, Any]) -> dict[TrialId, Mapping[str, Any]] | None:
    """Return the trials of a plan by their id, or None if the plan does not list its trials."""
    listed = plan.get("trials")
    if not isinstance(listed, list):
        return None
    found: dict[TrialId, Mapping[str, Any]] = {}
    for trial in listed:
        form = trial if isinstance(trial, dict) else {}
        # Variations are listed by their own condition. Plans written by the first versions listed a variation's
        # training condition.
        task, condition, seed = form.get("task"), form.get("variation") or form.get("condition"), form.get("seed")
        if not (isinstance(task, str) and isinstance(condition, str) and isinstance(seed, int)):
            return None  # the code that reads the plan reports this problem
        found[TrialId(task, condition, seed)] = form
    return found


def _plain(form: Mapping[str, Any]) -> dict[str, Any]:
    """Return data after a JSON round trip. Raises InvalidInputError if JSON cannot represent the data."""
    found: dict[str, Any] = json.loads(dump_json(form))
    return found


def _run_json(plan: Mapping[str, Any], context: Mapping[str, Any]) -> bytes:
    """Return the content of ``run.json``, including its checksum."""
    form = sealed_form({"schema_version": RUN_SCHEMA_VERSION, "plan": dict(plan), "context": dict(context)})
    return json.dumps(form, indent=2, sort_keys=True).encode() + b"\n"


def _copy_task_files(path: Path, plan: Mapping[str, Any]) -> None:
    """Copy the user's task files into the run folder, if the plan uses any."""
    if plan.get("task_files"):
        keep_copies(path)


def keep_copies(path: Path) -> None:
    """Copy each loaded user file to an output folder."""
    require_inside(path / COPIES, path)
    for file in loaded_files():
        if not (path / COPIES / file.copy_name).exists():
            write_durably(path / COPIES / file.copy_name, file.source.encode())
        if file.demonstrations is not None:
            measured = (path / COPIES / file.copy_name).with_suffix(COMPANION_SUFFIX)
            content = file.demonstrations.encode()
            # When a data set is resumed, its list of written files does not contain this file, so replacing the file
            # would fail. A file with the same content is therefore kept.
            if not measured.exists() or measured.read_bytes() != content:
                write_durably(measured, content)


def _safe_name(what: str, name: str) -> str:
    """Return ``name`` unchanged if it is safe to use in a path. Raises InvalidInputError otherwise."""
    if not _NAME.fullmatch(name):
        problem = f"{name!r} cannot be a file name"
        raise InvalidInputError(
            what, problem, "Use up to 100 letters, digits, '_', '-' and '.', and begin with a letter or digit"
        )
    return name


def _seed(seed: int) -> int:
    """Return ``seed`` unchanged. Raises InvalidInputError if it is negative."""
    if seed < 0:
        raise InvalidInputError("seed", f"{seed} is negative", "Use an integer ≥ 0")
    return seed


_GROWING = ("trials", "task_versions", "task_files")
"""Fields of a plan that may get additional entries when a run is extended."""


def holds_more(plan: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether a plan is the same as another plan, except for additional trials."""
    rest, others = ({k: v for k, v in p.items() if k not in _GROWING} for p in (plan, other))
    if dump_json(rest) != dump_json(others):
        return False
    for name in _GROWING:
        mine, theirs = plan.get(name, []), other.get(name, [])
        if isinstance(mine, dict) and isinstance(theirs, dict):
            mine, theirs = list(mine.items()), list(theirs.items())
        if not (isinstance(mine, list) and isinstance(theirs, list)):
            return False
        known = {dump_json(item) for item in mine}
        if not all(dump_json(item) in known for item in theirs):
            return False
    return len(plan.get("trials", [])) > len(other.get("trials", []))
