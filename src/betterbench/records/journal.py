"""Journal of a run, with one line per finished trial. A resumed run repeats all trials that are not listed as done.

Each line contains the SHA-256 of the trial's record, the digest of the trial's scene, and a link. The link is the
SHA-256 of the previous link together with the rest of the line, and reveals changed, missing and reordered lines.
Journals of older versions lack the scene digest, or all three values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, Field, TypeAdapter

from betterbench.errors import RecordError, RunConflictError
from betterbench.jobs.line_journal import LineJournal, complete_lines, link_after, not_following
from betterbench.json_form import Digest, read_form
from betterbench.tasks.trial_id import TrialId

TrialStatus = Literal["done", "error"]
"""Status of a trial.

A trial with the status "done" has a record. A trial with the status "error" failed for a reason other than the policy
and is repeated when the run is resumed.
"""


@dataclass(frozen=True, slots=True)
class JournalEntry:
    """Journal entry of one finished trial.

    Attributes:
        condition: Name of the condition within the task ("train1", "L3").
        status: "done" if the trial's record is on disk, "error" if the trial must be repeated.
        message: Description of the failure, if the status is "error".
        wall: Wall-clock measurements. Their names include the unit ("duration_s", "policy_latency_p50_s"). Records
            contain no such measurements.
        ground_truth: Values that a deliberately faulty policy reports about its own behavior in the episode, by name.
            They affect neither records nor verdicts.
        record: SHA-256 of the record file. None if there is no record or an older version wrote the line.
        scene: Digest of the scene's files (:func:`~betterbench.records.scene_archive.scene_digest`). None if there is
            no record or an older version wrote the line.
    """

    task: str
    condition: str
    variation: str | None
    seed: int
    status: TrialStatus = "done"
    message: str | None = None
    wall: Mapping[str, float] = field(default_factory=dict)
    ground_truth: Mapping[str, str] = field(default_factory=dict)
    record: str | None = None
    scene: str | None = None

    @property
    def key(self) -> TrialId:
        """Id of the trial within the run."""
        return TrialId(self.task, self.condition, self.seed)


class _Line(BaseModel, extra="forbid", strict=True, allow_inf_nan=False):
    """JSON form of an entry. All fields are written. Journals of older versions have no ground truth."""

    task: str
    condition: str
    variation: str | None
    seed: Annotated[int, Field(ge=0)]
    status: TrialStatus
    message: str | None
    wall: dict[str, float]
    ground_truth: dict[str, str] = {}
    record: Digest | None = None
    scene: Digest | None = None
    link: str | None = None


_LINE = TypeAdapter(_Line)
_LINE_CURE = "Restore the file from a copy, or evaluate into a new folder"


class Journal(LineJournal):
    """Journal of a run (``journal.jsonl``). Only one process at a time can append to it.

    Raises:
        RunConflictError: If another process is appending to the journal.
        RecordError: If a line is corrupt, or if two lines state that the same trial is finished.
    """

    def __init__(self, path: Path, *, renews: bool = False) -> None:
        self._entries: dict[TrialId, JournalEntry] = {}
        self._link = ""
        super().__init__(path, renews=renews)

    def _take_in(self, lines: list[bytes]) -> None:
        self._entries, self._link = _last_entries(self._path, lines)

    @property
    def entries(self) -> tuple[JournalEntry, ...]:
        """The last entry of every trial, in the order in which the trials first appear."""
        return tuple(self._entries.values())

    def entry(self, key: TrialId) -> JournalEntry | None:
        """Return the last entry of a trial, or None if it has none."""
        return self._entries.get(key)

    def is_done(self, key: TrialId) -> bool:
        """Return whether a trial is finished and must not be run again."""
        entry = self._entries.get(key)
        return entry is not None and entry.status == "done"

    def append(self, entry: JournalEntry) -> None:
        """Append a finished trial and sync the line to disk.

        Raises:
            InvalidInputError: If a number is not finite or a field has a wrong type.
            RunConflictError: If the trial is already finished.
            OSError: If the disk is full. The journal is then unchanged.
            ValueError: If the journal is closed.
        """
        if self.is_done(entry.key):
            raise RunConflictError(
                f"{self._path}: {entry.key} is already finished. Call is_done() before running a trial."
            )
        self._append(entry)

    def reopen(self, key: TrialId, reason: str) -> None:
        """Mark a finished trial as unfinished, so that it is repeated. Call this if its record cannot be used.

        The method appends a line with the status "error". If the trial is not finished, it does nothing. Raises the
        same errors as :meth:`append`.
        """
        if self.is_done(key):
            self._append(replace(self._entries[key], status="error", message=reason, wall={}, record=None, scene=None))

    def _append(self, entry: JournalEntry) -> None:
        form = asdict(entry)
        read_form(_LINE, form, where="journal entry", cure="Omit the field, or use a value of its type")
        link = link_after(self._link, form)
        self._append_line({**form, "link": link})
        self._entries[entry.key], self._link = entry, link


def read_journal(path: Path) -> tuple[JournalEntry, ...]:
    """Read a journal without changing it, even while a run appends to it. An incomplete last line is ignored.

    Returns:
        The last entry of every trial, in the order in which the trials first appear.

    Raises:
        RecordError: If a line is corrupt, or if two lines state that the same trial is finished.
    """
    return tuple(_last_entries(path, complete_lines(path)[0])[0].values())


def _last_entries(path: Path, lines: Sequence[bytes]) -> tuple[dict[TrialId, JournalEntry], str]:
    """Return the last entry of every trial, and the link of the last line."""
    entries: dict[TrialId, JournalEntry] = {}
    done: dict[TrialId, int] = {}
    link = ""
    for number, line in enumerate(lines, start=1):
        where = f"{path}: line {number}"
        form = read_form(_LINE, line, where=f"{where} is corrupt", cure=_LINE_CURE, raises=RecordError)
        # The link was computed from the fields that existed in the version that wrote the line.
        fields = form.model_dump(exclude_unset=True)
        told = fields.pop("link", None)
        if told is not None or link:
            link = link_after(link, fields)
            if told != link:
                raise not_following(where, _LINE_CURE)
        entry = JournalEntry(**fields)
        if entry.status == "error":
            done.pop(entry.key, None)  # the trial was marked as unfinished, so a later line may finish it again
        elif entry.key in done:
            raise RecordError(f"{where}: {entry.key} is already finished in line {done[entry.key]}. {_LINE_CURE}.")
        else:
            done[entry.key] = number
        entries[entry.key] = entry
    return entries, link
