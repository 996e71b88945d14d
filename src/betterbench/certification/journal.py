"""Journal of a certification, from which the certification is resumed after an interruption.

The first line contains the versions. Every further line contains one trial and is flushed to the disk. In journals of
version 2, each line is linked to the previous one by a hash. Journals of version 1 can be read, with a warning.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import TypeAdapter

from betterbench.certification.certificate import CertificateVersions, TrialCertificate
from betterbench.errors import RecordError, RunConflictError, one_line
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.jobs import LineJournal
from betterbench.jobs.line_journal import LINK, link_after, linked_forms
from betterbench.json_form import read_form, strict_form
from betterbench.ordinary_file import open_ordinary
from betterbench.tasks import TrialId

JOURNAL_NAME, DEMONSTRATIONS_NAME = "journal.jsonl", "demonstrations.jsonl"
_MOST_HEADER = 10_000
CURE = "Restore the file from a copy, or work in a new folder"
"""Remedy that error messages suggest if a line of the journal is corrupt."""


@strict_form
@dataclass(frozen=True, slots=True)
class JournalHeader:
    """First line of a journal: the kind of the journal, and the versions with which it was created."""

    form: str
    package_version: str = ""
    suite_version: str = ""
    mujoco: str = ""
    version: Literal[1, 2] = 2
    robot: str = USUAL_ROBOT

    def to_json(self) -> dict[str, Any]:
        """Return the header as a JSON-serializable dict.

        The default robot is left out, as in journals of earlier versions.
        """
        form = asdict(self)
        if self.robot == USUAL_ROBOT:
            del form["robot"]
        return form


@strict_form
@dataclass(frozen=True, slots=True)
class _Line:
    trial: TrialCertificate
    task_version: int
    session: str
    elapsed_s: float


_HEADER, _LINE = TypeAdapter(JournalHeader), TypeAdapter(_Line)


def holds_journal(folder: Path) -> bool:
    """Return whether a folder contains a journal of certified trials or of measured demonstrations."""
    for name in (JOURNAL_NAME, DEMONSTRATIONS_NAME):
        with contextlib.suppress(OSError), open_ordinary(folder / name) as file:
            if file.readline(_MOST_HEADER).startswith(b'{"form":"betterbench '):
                return True
    return False


class VersionedJournal(LineJournal):
    """Journal that can be resumed only with the same versions, and only by one process at a time.

    Raises:
        RunConflictError: If another process writes to the folder, or if the journal was started with other versions.
        RecordError: If a line is corrupt.
    """

    form: ClassVar[str]
    """Kind of the journal, as stated in its first line."""

    def __init__(self, path: Path, versions: CertificateVersions, *, renews: bool = False) -> None:
        self._versions = versions
        self._header = JournalHeader(self.form, versions.package, versions.suite, versions.engine, robot=versions.robot)
        self._link = link_after("", self._header.to_json())
        super().__init__(path, renews=renews)

    def _append_form(self, form: dict[str, Any]) -> None:
        if self.is_empty:
            self._append_line(self._header.to_json())
        link = link_after(self._link, form)
        self._append_line({**form, LINK: link})
        self._link = link

    def _take_in(self, lines: list[bytes]) -> None:
        if not lines:
            return
        self._check_header(lines[0])
        for number, (form, link) in enumerate(forms_after_header(self._path, lines), start=2):
            self._take_in_line(form, f"{self._path}: line {number} is corrupt")
            self._link = link or self._link

    def _take_in_line(self, form: dict[str, Any], where: str) -> None:
        """Parse a line after the header. ``where`` is the location of the line, for messages."""
        raise NotImplementedError

    def _check_header(self, line: bytes) -> None:
        cure = "Choose another folder"
        where = f"{self._path}: this is not a {self.form.removeprefix('betterbench ')}"
        found = read_form(_HEADER, line, where=where, cure=cure, raises=RunConflictError)
        if found.form != self.form:
            raise RunConflictError(f"{where}. {cure}.")
        self._link = link_after("", found.to_json())
        for name, value in asdict(replace(self._header, version=found.version)).items():
            if (there := getattr(found, name)) != value:
                raise RunConflictError(
                    f"{self._path}: the journal was started with {name} {one_line(there, most=80)}, but "
                    f"{value} is in use now. {cure}."
                )


def forms_after_header(path: Path, lines: list[bytes]) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield each line after the header as a JSON object, together with the hash that links it to the previous line.

    See :func:`~betterbench.jobs.line_journal.linked_forms`.
    """
    header = read_form(_HEADER, lines[0], where=f"{path}: line 1 is corrupt", cure=CURE, raises=RecordError)
    before = link_after("", header.to_json())
    yield from linked_forms(path, lines[1:], cure=CURE, first=2, before=before, needed=header.version > 1)


class CertificationJournal(VersionedJournal):
    """Journal of a certification. Trials that were examined with another version of their task are examined again.

    Raises the errors of :class:`VersionedJournal`.
    """

    form = "betterbench certification journal"

    def __init__(self, folder: Path, versions: CertificateVersions) -> None:
        self.trials: dict[TrialId, TrialCertificate] = {}
        self._sessions: dict[str, float] = {}
        super().__init__(folder / JOURNAL_NAME, versions)

    @property
    def wall_s(self) -> float:
        """Wall-clock time of all sessions together [s]."""
        return round(sum(self._sessions.values()), 3)

    def append(self, trial: TrialCertificate, *, session: str, elapsed_s: float) -> None:
        """Append a trial that has been examined, and flush the file to the disk."""
        self._append_form(asdict(_Line(trial, self._versions.tasks[trial.task], session, round(elapsed_s, 3))))
        self.trials[trial.key] = trial
        self._sessions[session] = elapsed_s

    def _take_in_line(self, form: dict[str, Any], where: str) -> None:
        line = read_form(_LINE, form, where=where, cure=CURE, raises=RecordError)
        self._sessions[line.session] = line.elapsed_s
        if self._versions.tasks.get(line.trial.task, line.task_version) == line.task_version:
            self.trials[line.trial.key] = line.trial
