"""The journal of a run: one line per finished trial, the only truth for resuming."""

from __future__ import annotations

import json
import logging
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self, get_args

from betterbench.errors import InvalidInputError, RecordError, RunConflictError
from betterbench.recording.durable import sync_folder
from betterbench.recording.lock import RunLock
from betterbench.recording.metadata import dump_json
from betterbench.tasks import TrialId

logger = logging.getLogger(__name__)

Status = Literal["done", "error"]
"""Whether a trial has a record, or broke down outside the policy and is to be run again when the run is resumed."""

LOCK_NAME = ".lock"
"""File beside the journal that carries the lock of the run."""


@dataclass(frozen=True, slots=True)
class JournalEntry:
    """One finished trial.

    Attributes:
        task: Task id.
        condition: Name of the condition within the task.
        variation: Name of the variation, or None on a training condition.
        seed: Seed of the trial.
        status: "done" when its record is on disk, "error" when it has to be run again.
        message: What broke, for "error".
        wall: Wall-clock figures by name with their unit ("duration_s", "policy_latency_p50_s"); records hold none.
        ground_truth: What a faulty policy knows of its own episode, by name; no record holds it, no verdict reads it.
    """

    task: str
    condition: str
    variation: str | None
    seed: int
    status: Status = "done"
    message: str | None = None
    wall: Mapping[str, float] = field(default_factory=dict)
    ground_truth: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what could not be read back.

        Raises:
            InvalidInputError: If a field has another type or a figure is not finite.
        """
        form = self.to_json()
        for name in ("task", "condition"):
            if not isinstance(form[name], str):
                raise InvalidInputError(name, f"{form[name]!r} is no text", "Give a name")
        for name in ("variation", "message"):
            if not isinstance(form[name], str | None):
                raise InvalidInputError(name, f"{form[name]!r} is no text", "Give a text or nothing")
        if not isinstance(form["seed"], int) or isinstance(form["seed"], bool) or form["seed"] < 0:
            raise InvalidInputError("seed", f"{form['seed']!r} is no seed", "Give an integer of at least 0")
        if self.status not in get_args(Status):
            raise InvalidInputError("status", f"{self.status!r} is unknown", "Use 'done' or 'error'")
        for name, value in form["wall"].items():
            if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
                raise InvalidInputError(f"wall.{name}", f"{value!r} is no finite number", "Leave the figure out")
        for name, text in form["ground_truth"].items():
            if not isinstance(text, str):
                raise InvalidInputError(f"ground_truth.{name}", f"{text!r} is no text", "Give a text")

    @property
    def key(self) -> TrialId:
        """What names the trial within the run."""
        return TrialId(self.task, self.condition, self.seed)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "task": self.task,
            "condition": self.condition,
            "variation": self.variation,
            "seed": self.seed,
            "status": self.status,
            "message": self.message,
            "wall": dict(self.wall),
            "ground_truth": dict(self.ground_truth),
        }

    @classmethod
    def from_json(cls, form: object) -> JournalEntry:
        """Read the JSON form.

        Raises:
            InvalidInputError: If it is no object with exactly the fields of an entry.
        """
        if not isinstance(form, dict) or set(form) | {"ground_truth"} != set(cls.__dataclass_fields__):
            raise InvalidInputError("entry", "has not the fields of a finished trial", "Do not edit the journal")
        if not isinstance(form["wall"], dict):
            raise InvalidInputError("wall", f"{form['wall']!r} is no mapping", "Give figures by name")
        if not isinstance(form.get("ground_truth", {}), dict):
            raise InvalidInputError("ground_truth", f"{form['ground_truth']!r} is no mapping", "Give texts by name")
        return cls(**form)


class Journal:
    """The journal, open for appending by one process at a time.

    Opening takes the lock of the run and cuts off a last line that a killed process left unfinished.

    Args:
        path: The file ``journal.jsonl``; it is made if missing.

    Raises:
        RunConflictError: If another process appends to it.
        RecordError: If a line is corrupt, or a trial is finished twice.
    """

    def __init__(self, path: Path) -> None:
        """Open the journal."""
        self._path = path
        self._lock = RunLock(path.parent / LOCK_NAME)
        self._handle: int | None = None
        try:
            entries, length = _read(path)
            self._handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
            if os.fstat(self._handle).st_size > length:
                logger.warning("%s: cut off an unfinished last line; its trial will be run again", path)
                os.ftruncate(self._handle, length)
            os.fsync(self._handle)
            sync_folder(path.parent)
        except BaseException:
            self.close()
            raise
        self._length = length
        self._entries = {entry.key: entry for entry in entries}

    @property
    def entries(self) -> tuple[JournalEntry, ...]:
        """The last entry of every trial, in order of first appearance."""
        return tuple(self._entries.values())

    def is_done(self, key: TrialId) -> bool:
        """Tell whether a trial is finished and must not be run again."""
        entry = self._entries.get(key)
        return entry is not None and entry.status == "done"

    def append(self, entry: JournalEntry) -> None:
        """Append a finished trial and force it to disk.

        Raises:
            RunConflictError: If the trial is finished already.
            OSError: If the disk is full; the journal is then as it was before.
            ValueError: If the journal is closed.
        """
        if self._handle is None:
            msg = f"{self._path}: the journal is closed"
            raise ValueError(msg)
        if self.is_done(entry.key):
            raise RunConflictError(
                f"{self._path}: {entry.key} is finished already. Ask is_done() before running a trial."
            )
        line = dump_json(entry.to_json()) + b"\n"
        try:
            written = 0
            while written < len(line):
                written += os.pwrite(self._handle, line[written:], self._length + written)
            os.fsync(self._handle)
        except OSError:
            os.ftruncate(self._handle, self._length)
            raise
        self._length += len(line)
        self._entries[entry.key] = entry

    def close(self) -> None:
        """Close the file and give the lock back; harmless when closed."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
        self._lock.release()

    def __enter__(self) -> Self:
        """Return the open journal."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the journal."""
        self.close()


def read_journal(path: Path) -> tuple[JournalEntry, ...]:
    """Read a journal without changing it, also while a run appends to it.

    Args:
        path: The file ``journal.jsonl``; a missing one is empty.

    Returns:
        The last entry of every trial, in order of first appearance; an unfinished last line is left out.

    Raises:
        RecordError: If a line is corrupt, or a trial is finished twice.
    """
    return tuple({entry.key: entry for entry in _read(path)[0]}.values())


def _read(path: Path) -> tuple[list[JournalEntry], int]:
    """Return all complete lines as entries, and their length in bytes."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return [], 0
    length = data.rfind(b"\n") + 1
    entries: list[JournalEntry] = []
    done: dict[TrialId, int] = {}
    for number, line in enumerate(data[:length].split(b"\n")[:-1], start=1):
        try:
            entry = JournalEntry.from_json(json.loads(line))
        except (ValueError, InvalidInputError, RecursionError) as error:
            raise RecordError(
                f"{path}: line {number} is corrupt ({error}). Restore it, or delete the line to run its trial again."
            ) from error
        if entry.key in done:
            raise RecordError(
                f"{path}: line {number} finishes {entry.key} again, after line {done[entry.key]}. "
                "Delete one of the two lines."
            )
        if entry.status == "done":
            done[entry.key] = number
        entries.append(entry)
    return entries, length
