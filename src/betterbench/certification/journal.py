"""The journal of a certification: one synced line per examined trial, from which the same command goes on."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter

from betterbench.certification.certificate import CertificateVersions, TrialCertificate
from betterbench.errors import RecordError, RunConflictError
from betterbench.json_form import read_form, strict_form
from betterbench.recording import LineJournal
from betterbench.tasks import TrialId

JOURNAL_NAME = "journal.jsonl"
_CURE = "Delete the line to examine its trial again"


@strict_form
@dataclass(frozen=True, slots=True)
class _Header:
    package_version: str
    suite_version: str
    mujoco: str
    version: Literal[1] = 1
    form: Literal["betterbench certification journal"] = "betterbench certification journal"


@strict_form
@dataclass(frozen=True, slots=True)
class _Line:
    trial: TrialCertificate
    task_version: int
    session: str
    elapsed_s: float


_HEADER, _LINE = TypeAdapter(_Header), TypeAdapter(_Line)


class CertificationJournal(LineJournal):
    """The journal of a certification, open for appending by one process at a time.

    Trials that were examined for another version of their task are examined again.

    Raises:
        RunConflictError: If another process writes to the folder, or it was begun under other versions.
        RecordError: If a line is corrupt.
    """

    def __init__(self, folder: Path, versions: CertificateVersions) -> None:
        self.trials: dict[TrialId, TrialCertificate] = {}
        self._versions = versions
        self._sessions: dict[str, float] = {}
        super().__init__(folder / JOURNAL_NAME)

    @property
    def wall_s(self) -> float:
        """Wall time of all sessions together [s]."""
        return round(sum(self._sessions.values()), 3)

    def append(self, trial: TrialCertificate, *, session: str, elapsed_s: float) -> None:
        """Append an examined trial and force it to disk."""
        if self.is_empty:
            self._append_line(asdict(self._header()))
        self._append_line(asdict(_Line(trial, self._versions.tasks[trial.task], session, round(elapsed_s, 3))))
        self.trials[trial.key] = trial
        self._sessions[session] = elapsed_s

    def _take_in(self, lines: list[bytes]) -> None:
        if lines:
            self._check_header(lines[0])
        for number, line in enumerate(lines[1:], start=2):
            where = f"{self._path}: line {number} is corrupt"
            form = read_form(_LINE, line, where=where, cure=_CURE, raises=RecordError)
            self._sessions[form.session] = form.elapsed_s
            if self._versions.tasks.get(form.trial.task, form.task_version) == form.task_version:
                self.trials[form.trial.key] = form.trial

    def _header(self) -> _Header:
        return _Header(self._versions.package, self._versions.suite, self._versions.engine)

    def _check_header(self, line: bytes) -> None:
        cure = "Choose another folder"
        where = f"{self._path}: this is not a certification journal"
        found = read_form(_HEADER, line, where=where, cure=cure, raises=RunConflictError)
        for name, value in asdict(self._header()).items():
            if (there := getattr(found, name)) != value:
                raise RunConflictError(f"{self._path}: begun with {name} {there}, this is {value}. {cure}.")
