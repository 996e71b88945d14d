"""The journals of certifications: a header with versions, and one synced line per trial, from which one goes on."""

from __future__ import annotations

import contextlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

from pydantic import TypeAdapter

from betterbench.certification.certificate import CertificateVersions, TrialCertificate
from betterbench.errors import RecordError, RunConflictError
from betterbench.json_form import open_ordinary, read_form, strict_form
from betterbench.recording import LineJournal
from betterbench.tasks import TrialId

JOURNAL_NAME, DEMONSTRATIONS_NAME = "journal.jsonl", "demonstrations.jsonl"
_MOST_HEADER = 10_000
_CURE = "Delete the line to examine its trial again"


@strict_form
@dataclass(frozen=True, slots=True)
class JournalHeader:
    """The first line of a journal: what it is, and the versions that it was begun under."""

    form: str
    package_version: str = ""
    suite_version: str = ""
    mujoco: str = ""
    version: int = 1


@strict_form
@dataclass(frozen=True, slots=True)
class _Line:
    trial: TrialCertificate
    task_version: int
    session: str
    elapsed_s: float


_HEADER, _LINE = TypeAdapter(JournalHeader), TypeAdapter(_Line)


def holds_journal(folder: Path) -> bool:
    """Tell whether a folder holds a journal of ours, of a certification or of measured demonstrations."""
    for name in (JOURNAL_NAME, DEMONSTRATIONS_NAME):
        with contextlib.suppress(OSError), open_ordinary(folder / name) as file:
            if file.readline(_MOST_HEADER).startswith(b'{"form":"betterbench '):
                return True
    return False


class VersionedJournal(LineJournal):
    """A journal that goes on only under the versions that it was begun under, open for appending by one process.

    Raises:
        RunConflictError: If another process writes to the folder, or it was begun under other versions.
        RecordError: If a line is corrupt.
    """

    form: ClassVar[str]
    """What the first line says that the journal is."""

    def __init__(self, path: Path, versions: CertificateVersions) -> None:
        self._versions = versions
        self._header = JournalHeader(self.form, versions.package, versions.suite, versions.engine)
        super().__init__(path)

    def _append_form(self, form: object) -> None:
        if self.is_empty:
            self._append_line(asdict(self._header))
        self._append_line(form)

    def _take_in(self, lines: list[bytes]) -> None:
        if lines:
            self._check_header(lines[0])
        for number, line in enumerate(lines[1:], start=2):
            self._take_in_line(line, f"{self._path}: line {number} is corrupt")

    def _take_in_line(self, line: bytes, where: str) -> None:
        """Read a line after the first; ``where`` is for the error."""
        raise NotImplementedError

    def _check_header(self, line: bytes) -> None:
        cure = "Choose another folder"
        where = f"{self._path}: this is not a {self.form.removeprefix('betterbench ')}"
        found = read_form(_HEADER, line, where=where, cure=cure, raises=RunConflictError)
        if found.form != self.form:
            raise RunConflictError(f"{where}. {cure}.")
        for name, value in asdict(self._header).items():
            if (there := getattr(found, name)) != value:
                raise RunConflictError(f"{self._path}: begun with {name} {there}, this is {value}. {cure}.")


class CertificationJournal(VersionedJournal):
    """The journal of a certification; trials that were examined for another version of their task are examined again.

    Raises as :class:`VersionedJournal` does.
    """

    form = "betterbench certification journal"

    def __init__(self, folder: Path, versions: CertificateVersions) -> None:
        self.trials: dict[TrialId, TrialCertificate] = {}
        self._sessions: dict[str, float] = {}
        super().__init__(folder / JOURNAL_NAME, versions)

    @property
    def wall_s(self) -> float:
        """Wall time of all sessions together [s]."""
        return round(sum(self._sessions.values()), 3)

    def append(self, trial: TrialCertificate, *, session: str, elapsed_s: float) -> None:
        """Append an examined trial and force it to disk."""
        self._append_form(asdict(_Line(trial, self._versions.tasks[trial.task], session, round(elapsed_s, 3))))
        self.trials[trial.key] = trial
        self._sessions[session] = elapsed_s

    def _take_in_line(self, line: bytes, where: str) -> None:
        form = read_form(_LINE, line, where=where, cure=_CURE, raises=RecordError)
        self._sessions[form.session] = form.elapsed_s
        if self._versions.tasks.get(form.trial.task, form.task_version) == form.task_version:
            self.trials[form.trial.key] = form.trial
