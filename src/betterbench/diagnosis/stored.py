"""Diagnosis of a run, stored as ``RUN/diagnosis.json`` for comparison with later diagnoses of the same run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import AliasPath, BeforeValidator, Field, TypeAdapter

from betterbench.diagnosis.verdict import RunDiagnosis
from betterbench.errors import RecordError
from betterbench.jobs import write_durably
from betterbench.json_form import dump_json, open_form, open_seal, read_bounded, read_form, sealed_form
from betterbench.quoting import json_text
from betterbench.records import RunFolder
from betterbench.version import __version__

STORED_SCHEMA_VERSION = 2
"""Version of the format of ``diagnosis.json``. Version 2 has a checksum. Version 1 is read with a warning."""

_MAX_BYTES = 256 * 1024 * 1024
_CURE = "Restore the file, or move it elsewhere and store a new diagnosis"


@open_form
@dataclass(frozen=True, slots=True)
class StoredAttempt:
    """Stored grasp attempt, with its start time [s], its object and its result."""

    start_s: float
    object: str | None
    result: str


def _of_evidence(name: str) -> Any:  # noqa: ANN401 -- what pydantic's Field returns
    return Field(validation_alias=AliasPath("evidence", name))


@open_form
@dataclass(frozen=True, slots=True)
class StoredTrial:
    """Stored diagnosis of one trial.

    Attributes:
        key: Key of the trial ("fast_food/T1/3").
        label: Outcome label, as named by the version of betterbench that wrote the file.
        success: Whether the trial succeeded.
        rule: Evidence rule that decided the label.
        text: Explanation of the label.
        start_s: Beginning of the evidence [s].
        end_s: End of the evidence [s].
        candidates: Labels that are possible if only this trial is considered.
        attempts: Grasp attempts in the trial.
        steps: Number of control steps of the trial.
        has_record: Whether the trial had a record.
    """

    key: str
    label: str
    success: bool
    rule: Annotated[str, _of_evidence("rule")]
    text: Annotated[str, _of_evidence("text")]
    start_s: Annotated[float, _of_evidence("start_s")]
    end_s: Annotated[float, _of_evidence("end_s")]
    candidates: Annotated[tuple[str, ...], _of_evidence("candidates")]
    attempts: tuple[StoredAttempt, ...]
    steps: int
    has_record: Annotated[bool, BeforeValidator(lambda path: path is not None), Field(validation_alias="record")]


@open_form
@dataclass(frozen=True, slots=True)
class StoredMetric:
    """Stored metric, with its name, scope, numerator, denominator and value."""

    name: str
    scope: str
    k: int | None
    n: int
    value: float | None


def _readable(version: object) -> object:
    if isinstance(version, int) and not isinstance(version, bool) and version not in (1, STORED_SCHEMA_VERSION):
        raise ValueError(
            f"expected {STORED_SCHEMA_VERSION}, got {version}; a different version of betterbench wrote the file"
        )
    return version


@open_form
@dataclass(frozen=True, slots=True)
class _File:
    schema_version: Annotated[int, BeforeValidator(_readable)]
    package_version: str
    thresholds: dict[str, float]
    trials: list[StoredTrial]
    metrics: list[StoredMetric]


_FILE = TypeAdapter(_File)


@dataclass(frozen=True, slots=True)
class StoredDiagnosis:
    """Stored diagnosis of a run, for comparison with later diagnoses of the same run."""

    package_version: str
    thresholds: Mapping[str, float]
    trials: Mapping[str, StoredTrial]
    metrics: Mapping[tuple[str, str], StoredMetric]

    @classmethod
    def of(cls, diagnosis: RunDiagnosis) -> StoredDiagnosis:
        """Convert a new diagnosis to its stored form."""
        return cls.from_json(dump_json(_stored_form(diagnosis)), where="diagnosis")

    @classmethod
    def from_json(cls, raw: bytes, *, where: str) -> StoredDiagnosis:
        """Read a stored diagnosis from a JSON document.

        Args:
            raw: Content of the document.
            where: Name of the document in error messages.

        Raises:
            RecordError: If the document was changed after it was written, has a schema version that is not supported,
                or has a field that is missing or of the wrong type.
        """
        form = open_seal(raw, where=where, cure=_CURE, raises=RecordError, since=("schema_version", 2))
        file = read_form(_FILE, form, where=where, cure=_CURE, raises=RecordError)
        for what, keys in (
            ("trials", [t.key for t in file.trials]),
            ("metrics", [(m.name, m.scope) for m in file.metrics]),
        ):
            if len(set(keys)) < len(keys):
                raise RecordError(f"{where}: {what}: an entry occurs twice. {_CURE}.")
        return cls(
            package_version=file.package_version,
            thresholds=file.thresholds,
            trials={t.key: t for t in file.trials},
            metrics={(m.name, m.scope): m for m in file.metrics},
        )


def _stored_form(diagnosis: RunDiagnosis) -> dict[str, Any]:
    versions = {"schema_version": STORED_SCHEMA_VERSION, "package_version": __version__}
    return sealed_form(json.loads(dump_json({**versions, **diagnosis.to_json()})))


def stored_path(run: RunFolder) -> Path:
    """Return the path of a run's stored diagnosis."""
    return run.path / "diagnosis.json"


def store_diagnosis(run: RunFolder, diagnosis: RunDiagnosis) -> Path:
    """Write the diagnosis of a run into the run's folder, replacing any earlier diagnosis, and return the file's path.

    Raises:
        OSError: If the folder cannot be written.
        RunConflictError: If another process is writing to the run.
        StorageError: If the disk is full, broken or write-protected.
        InvalidInputError: If the path is a link that leads out of the folder.
    """
    path = stored_path(run)
    form = _stored_form(diagnosis)
    with run.locked():
        write_durably(path, json_text(form, indent=1).encode() + b"\n")
    return path


def read_stored(run: RunFolder) -> StoredDiagnosis | None:
    """Return the stored diagnosis of a run, or None if the run has none.

    Raises:
        RecordError: If the file cannot be read or is malformed.
    """
    path = stored_path(run)
    if not path.exists():
        return None
    raw = read_bounded(path, max_bytes=_MAX_BYTES, cure=_CURE, raises=RecordError)
    return StoredDiagnosis.from_json(raw, where=str(path))
