"""Conflicts between a job and the content of its folder: unrelated files, or a different job."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from betterbench.errors import RunConflictError
from betterbench.jobs.durable import PART_SUFFIX
from betterbench.jobs.lock import LOCK_NAME
from betterbench.quoting import json_text

_ABSENT = object()


def require_free(path: Path, what: str, *, file: str, besides: Collection[str] = ()) -> None:
    """Raise RunConflictError if a path is a file, or a folder that contains files but no job of this kind.

    Args:
        path: Folder of the job.
        what: Kind of job, for the message ("run").
        file: Name of the file that describes a job. A folder that contains this file is not checked.
        besides: Names of files that are accepted, because a job may leave them behind if it fails to start.
    """
    if path.exists() and not path.is_dir():
        raise RunConflictError(f"{path}: this is a file. Choose a folder for the {what}.")
    if (path / file).exists() or not path.is_dir():
        return
    left = {LOCK_NAME, *besides}
    if any(entry.name not in left and not entry.name.endswith(PART_SUFFIX) for entry in path.iterdir()):
        raise RunConflictError(
            f"{path}: the folder contains other files but no {what}. Choose an empty or a new folder."
        )


def require_same(
    path: Path,
    there: object,
    asked: object,
    what: str,
    *,
    where: str,
    cure: str = "Use the same arguments to resume it",
    cures: Mapping[str, str] | None = None,
) -> None:
    """Raise RunConflictError if the job in a folder differs from the requested job.

    Args:
        path: Folder of the job.
        there: JSON value that describes the job in the folder.
        asked: JSON value that describes the requested job.
        what: Kind of job, for the message ("run").
        where: Name of the description, for the message ("plan").
        cure: Remedy that lets the user resume the job.
        cures: Remedies that replace ``cure`` for certain fields, keyed by the first field of the description that
            differs.
    """
    difference = first_difference(there, asked, where)
    if difference is not None:
        place, stored, wanted = difference
        field = place.removeprefix(f"{where}.").split(".")[0]
        raise RunConflictError(
            f"{path}: this folder contains a different {what}: {place} is {stored} in the folder "
            f"but {wanted} in the request. {(cures or {}).get(field, cure)}, or choose a different folder."
        )


def first_difference(there: object, asked: object, where: str) -> tuple[str, str, str] | None:
    """Compare two JSON values. Return the path of the first difference, and both values at that path as strings.

    Return None if the two JSON values are equal. Keys are compared in sorted order.
    """
    if isinstance(there, dict) and isinstance(asked, dict):
        for key in sorted(set(there) | set(asked)):
            if key not in there or key not in asked:
                return f"{where}.{key}", _shown(there.get(key, _ABSENT)), _shown(asked.get(key, _ABSENT))
            found = first_difference(there[key], asked[key], f"{where}.{key}")
            if found:
                return found
        return None
    if isinstance(there, list) and isinstance(asked, list):
        for i, (a, b) in enumerate(zip(there, asked, strict=False)):
            found = first_difference(a, b, f"{where}[{i}]")
            if found:
                return found
        if len(there) != len(asked):
            return f"the length of {where}", str(len(there)), str(len(asked))
        return None
    if type(there) is type(asked) and there == asked:
        return None
    return where, _shown(there), _shown(asked)


def _shown(value: object) -> str:
    """Return a value as text for a message, shortened to 80 characters."""
    if value is _ABSENT:
        return "absent"
    text = json_text(value)
    return text if len(text) <= 80 else text[:77] + "..."
