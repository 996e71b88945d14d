"""The diagnosis that a run keeps: ``RUN/diagnosis.json``, so that a later version can say what it judges otherwise."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import betterbench
from betterbench.diagnosis.verdict import RunDiagnosis
from betterbench.errors import RecordError
from betterbench.recording import RunFolder, write_durably
from betterbench.recording.metadata import dump_json

STORED_SCHEMA_VERSION = 1
"""Version of ``diagnosis.json``; it moves when an older reader would misunderstand a newer file."""

_MAX_BYTES = 256 * 1024 * 1024
_CURE = "Restore the file, or delete it to store a new one"


@dataclass(frozen=True, slots=True)
class StoredTrial:
    """What a stored diagnosis says about one trial.

    Attributes:
        label: The outcome, by the names of the version that gave it.
        success: Whether the trial succeeded.
        rule: PolicyRule that fired.
        text: The evidence in a sentence.
        start_s: Beginning of the evidence [s].
        end_s: End of the evidence [s].
        candidates: Labels that the trial alone could not tell apart.
        attempts: GraspAttempt attempts as (start [s], object, result).
        steps: Control steps of its record.
        has_record: Whether there was a record.
    """

    label: str
    success: bool
    rule: str
    text: str
    start_s: float
    end_s: float
    candidates: tuple[str, ...]
    attempts: tuple[tuple[float, str | None, str], ...]
    steps: int
    has_record: bool


@dataclass(frozen=True, slots=True)
class StoredMetric:
    """What a stored diagnosis says about one metric.

    Attributes:
        k: Count of the numerator, or None.
        n: Count of the denominator.
        value: The number, or None.
    """

    k: int | None
    n: int
    value: float | None


@dataclass(frozen=True, slots=True)
class StoredDiagnosis:
    """What a later diagnosis of the same run is compared with.

    Attributes:
        package_version: Version of betterbench that made it.
        thresholds: Thresholds in force.
        trials: Trials by their key.
        metrics: Metrics by name and scope.
    """

    package_version: str
    thresholds: Mapping[str, float]
    trials: Mapping[str, StoredTrial]
    metrics: Mapping[tuple[str, str], StoredMetric]

    @classmethod
    def of(cls, diagnosis: RunDiagnosis) -> StoredDiagnosis:
        """Return what would be stored of a diagnosis made now."""
        return cls.from_json(stored_form(diagnosis), where="diagnosis")

    @classmethod
    def from_json(cls, form: object, *, where: str) -> StoredDiagnosis:
        """Read the JSON form.

        Args:
            form: The JSON value; it may come from anybody.
            where: Name of the file for errors.

        Raises:
            RecordError: If the schema version is another one, or a field is missing or of the wrong type.
        """
        top = _Form(form, where)
        version = top.get("schema_version", int)
        if version != STORED_SCHEMA_VERSION:
            raise RecordError(
                f"{where}: schema version {version} is not {STORED_SCHEMA_VERSION}. "
                "Read it with the version of betterbench that wrote it, or delete it to store a new one."
            )
        limits = top.get("thresholds", dict)
        trials = [_Form(t, f"{where}: trials[{i}]") for i, t in enumerate(top.get("trials", list))]
        metrics = [_Form(m, f"{where}: metrics[{i}]") for i, m in enumerate(top.get("metrics", list))]
        return cls(
            package_version=top.get("package_version", str),
            thresholds={name: _Form(limits, f"{where}: thresholds").number(name) for name in limits},
            trials={t.get("key", str): _trial(t) for t in trials},
            metrics={(m.get("name", str), m.get("scope", str)): _metric(m) for m in metrics},
        )


def stored_form(diagnosis: RunDiagnosis) -> dict[str, Any]:
    """Return the content of ``diagnosis.json``."""
    versions = {"schema_version": STORED_SCHEMA_VERSION, "package_version": betterbench.__version__}
    # What is compared is what a reader of the file would read: lists for tuples, texts for labels.
    form: dict[str, Any] = json.loads(dump_json({**versions, **diagnosis.to_json()}))
    return form


def stored_path(run: RunFolder) -> Path:
    """Return the place of a run's stored diagnosis."""
    return run.path / "diagnosis.json"


def store_diagnosis(run: RunFolder, diagnosis: RunDiagnosis) -> Path:
    """Write the diagnosis of a run into its folder and return the place; the former one is replaced.

    Raises:
        OSError: If the folder cannot be written.
    """
    path = stored_path(run)
    write_durably(path, json.dumps(stored_form(diagnosis), indent=1, ensure_ascii=False).encode() + b"\n")
    return path


def read_stored(run: RunFolder) -> StoredDiagnosis | None:
    """Return the diagnosis that a run keeps, or None if it keeps none.

    Raises:
        RecordError: If the file cannot be read or is malformed.
    """
    path = stored_path(run)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise RecordError(f"{path}: is larger than {_MAX_BYTES} bytes. {_CURE}.")
        form = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except (ValueError, RecursionError, OSError) as error:
        raise RecordError(f"{path}: is corrupt ({error}). {_CURE}.") from error
    return StoredDiagnosis.from_json(form, where=str(path))


class _Form:
    """A JSON object from a file, whose fields are checked as they are read."""

    def __init__(self, form: object, where: str) -> None:
        if not isinstance(form, dict):
            raise RecordError(f"{where} is no object. {_CURE}.")
        self._form, self._where = form, where

    def get(self, name: str, kind: type) -> Any:  # noqa: ANN401 -- the kind is checked here
        """Return a field of a kind."""
        value = self._form.get(name)
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise RecordError(f"{self._where}: {name!r} is missing or no {_KINDS[kind]}. {_CURE}.")
        return value

    def number(self, name: str) -> float:
        """Return a finite number."""
        value = self._form.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise RecordError(f"{self._where}: {name!r} is missing or no finite number. {_CURE}.")
        return float(value)

    def optional(self, name: str, kind: type) -> Any:  # noqa: ANN401 -- the kind is checked here
        """Return a field that may be null."""
        if name in self._form and self._form[name] is None:
            return None
        return self.number(name) if kind is float else self.get(name, kind)

    def inner(self, name: str) -> _Form:
        """Return a field that is an object."""
        return _Form(self._form.get(name), f"{self._where}: {name!r}")

    def listed(self, name: str) -> list[_Form]:
        """Return a field that is a list of objects."""
        return [_Form(v, f"{self._where}: {name}[{i}]") for i, v in enumerate(self.get(name, list))]


_KINDS = {bool: "truth value", int: "integer", str: "text", list: "list", dict: "object"}


def _trial(form: _Form) -> StoredTrial:
    evidence = form.inner("evidence")
    return StoredTrial(
        label=form.get("label", str),
        success=form.get("success", bool),
        rule=evidence.get("rule", str),
        text=evidence.get("text", str),
        start_s=evidence.number("start_s"),
        end_s=evidence.number("end_s"),
        candidates=tuple(str(c) for c in evidence.get("candidates", list)),
        attempts=tuple(
            (a.number("start_s"), a.optional("object", str), a.get("result", str)) for a in form.listed("attempts")
        ),
        steps=form.get("steps", int),
        has_record=form.optional("record", str) is not None,
    )


def _metric(form: _Form) -> StoredMetric:
    return StoredMetric(form.optional("k", int), form.get("n", int), form.optional("value", float))
