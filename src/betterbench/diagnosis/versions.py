"""Versions in the records of a run.

Records with different versions raise an error unless mixed versions are allowed.
"""

from __future__ import annotations

from collections.abc import Iterator

from betterbench.diagnosis.trial import resolved_of
from betterbench.errors import RunConflictError
from betterbench.records import RecordMetadata

_SCENE_KEYS = ("model", "scene", "hash")
"""Words that occur in the names of those fields of the engine's fingerprint that may differ between scenes."""


class RecordVersions:
    """Collection of all versions found in the records of a run."""

    def __init__(self, *, allow_mixed: bool) -> None:
        self._allow_mixed = allow_mixed
        self._seen: dict[str, dict[str, str]] = {}

    @property
    def found(self) -> dict[str, str]:
        """All versions by name. If a name has several values, they are joined by " | ".

        The name of the policy is only included if the records contain several names.
        """
        return {
            name: " | ".join(values)
            for name, values in sorted(self._seen.items())
            if name != "policy" or len(values) > 1
        }

    def add(self, metadata: RecordMetadata, *, but: str = "") -> None:
        """Add the versions in a record.

        Args:
            metadata: Metadata of the record.
            but: Name of a version that is not added, or "" to add all versions.

        Raises:
            RunConflictError: If a version differs from the version in an earlier record and mixed versions are not
                allowed.
        """
        trial = f"{metadata.task}/{metadata.condition} seed {metadata.seed}"
        for name, value in _versions(metadata):
            if name == but:
                continue
            known = self._seen.setdefault(name, {})
            if known and value not in known and not self._allow_mixed:
                other, at = next(iter(known.items()))
                raise RunConflictError(
                    f"{name} is {value!r} in the record of {trial} and {other!r} in the record of {at}. "
                    "Repeat one of the two trials, or allow mixed versions and interpret the results with care."
                )
            known.setdefault(value, trial)
        if "simulator" in metadata.engine:  # in other worlds, the fingerprint of the task is part of the record
            return
        wanted = resolved_of(metadata).task.version
        if metadata.task_version != wanted and not self._allow_mixed:
            raise RunConflictError(
                f"{trial} was recorded with version {metadata.task_version} of its task; this installation has version "
                f"{wanted}. Judge it with the version of betterbench that recorded it, or record it again."
            )


def _versions(metadata: RecordMetadata) -> Iterator[tuple[str, str]]:
    yield "policy", metadata.policy
    yield "package_version", metadata.package_version
    yield "suite_version", metadata.suite_version
    yield "schema_version", str(metadata.schema_version)
    yield f"task_version:{metadata.task}", str(metadata.task_version)
    yield "action_space", metadata.action_space
    yield "control_rate_hz", f"{metadata.control_rate_hz:g}"
    yield "camera_preset", str(metadata.camera_preset)
    yield "render_quality", str(metadata.render_quality)
    yield "looks", metadata.looks
    for name, value in sorted(metadata.engine.items()):
        if not any(word in name for word in _SCENE_KEYS):
            yield f"engine:{name}", value
