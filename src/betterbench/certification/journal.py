"""The journal of a certification: one synced line per examined trial, from which the same command goes on."""

from __future__ import annotations

import json
import logging
import os
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from betterbench.certification.certificate import CertificateVersions, TrialCertificate, trial_from_json
from betterbench.errors import RecordError, RunConflictError
from betterbench.recording import RunLock
from betterbench.recording.durable import sync_folder
from betterbench.recording.metadata import dump_json

logger = logging.getLogger(__name__)

JOURNAL_NAME = "journal.jsonl"
FORM = "betterbench certification journal"
VERSION = 1


class CertificationJournal:
    """The journal, open for appending by one process at a time.

    Opening takes the lock of the folder and cuts off a last line that a killed process left unfinished. Trials that
    were examined for another version of their task are examined again.

    Args:
        folder: Folder of the certificate; it is made if missing.
        versions: CertificateVersions in use.

    Raises:
        RunConflictError: If another process writes to the folder, or it was begun under other versions.
        RecordError: If a line is corrupt.
    """

    def __init__(self, folder: Path, versions: CertificateVersions) -> None:
        """Open the journal."""
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / JOURNAL_NAME
        self._versions = versions
        self._handle: int | None = None
        self.trials: dict[tuple[str, str, int], TrialCertificate] = {}
        self._sessions: dict[str, float] = {}
        self._lock = RunLock(folder / ".lock")
        try:
            self._length = self._read()
            self._handle = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
            if os.fstat(self._handle).st_size > self._length:
                logger.warning("%s: cut off an unfinished last line; its trial is examined again", self._path)
                os.ftruncate(self._handle, self._length)
            if self._length == 0:
                self._append({"form": FORM, "version": VERSION, **self._header()})
            sync_folder(folder)
        except BaseException:
            self.close()
            raise

    @property
    def wall_s(self) -> float:
        """Wall time of all sessions together [s]."""
        return round(sum(self._sessions.values()), 3)

    def append(self, trial: TrialCertificate, *, session: str, elapsed_s: float) -> None:
        """Append an examined trial and force it to disk.

        Args:
            trial: The findings.
            session: What tells this process from earlier ones.
            elapsed_s: Wall time since the session began [s].
        """
        version = self._versions.tasks[trial.task]
        form = {"trial": asdict(trial), "task_version": version, "session": session, "elapsed_s": round(elapsed_s, 3)}
        self._append(form)
        self.trials[trial.key] = trial
        self._sessions[session] = elapsed_s

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

    def _header(self) -> dict[str, str]:
        v = self._versions
        return {"package_version": v.package, "suite_version": v.suite, "mujoco": v.engine}

    def _append(self, form: dict[str, Any]) -> None:
        if self._handle is None:
            msg = f"{self._path}: the journal is closed"
            raise ValueError(msg)
        line = dump_json(form) + b"\n"
        try:
            written = 0
            while written < len(line):
                written += os.pwrite(self._handle, line[written:], self._length + written)
            os.fsync(self._handle)
        except OSError:
            os.ftruncate(self._handle, self._length)
            raise
        self._length += len(line)

    def _read(self) -> int:
        """Take in all complete lines and return their length in bytes."""
        try:
            data = self._path.read_bytes()
        except FileNotFoundError:
            return 0
        length = data.rfind(b"\n") + 1
        for number, line in enumerate(data[:length].split(b"\n")[:-1], start=1):
            where = f"{self._path}: line {number}"
            try:
                form = json.loads(line)
            except (ValueError, RecursionError) as error:
                raise RecordError(f"{where} is corrupt ({error}). Delete it to examine its trial again.") from error
            if not isinstance(form, dict):
                raise RecordError(f"{where} is corrupt (no object). Delete it to examine its trial again.")
            if number == 1:
                self._check_header(form)
            else:
                self._take_in(form, where)
        return length

    def _check_header(self, form: dict[str, Any]) -> None:
        if form.get("form") != FORM or form.get("version") != VERSION:
            raise RunConflictError(f"{self._path}: it is no certification journal. Choose another folder.")
        for name, here in self._header().items():
            if form.get(name) != here:
                raise RunConflictError(
                    f"{self._path}: begun with {name} {form.get(name)}, this is {here}. Choose another folder."
                )

    def _take_in(self, form: dict[str, Any], where: str) -> None:
        session, elapsed = form.get("session"), form.get("elapsed_s")
        if not isinstance(session, str) or not isinstance(elapsed, int | float) or isinstance(elapsed, bool):
            raise RecordError(f"{where} is corrupt (session or elapsed_s). Delete it to examine its trial again.")
        self._sessions[session] = float(elapsed)
        trial = trial_from_json(form.get("trial"), where=where)
        if self._versions.tasks.get(trial.task, form.get("task_version")) == form.get("task_version"):
            self.trials[trial.key] = trial
