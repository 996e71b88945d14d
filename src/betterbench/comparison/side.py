"""Runs in a comparison (its sides), each with its diagnosis and its conventions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from betterbench.comparison.conventions import side_conventions
from betterbench.comparison.submission import Submission, read_submission
from betterbench.diagnosis import RunDiagnosis, diagnose_run
from betterbench.errors import InvalidInputError
from betterbench.records import RunFolder, require_each_once, run_names, told_apart
from betterbench.tasks import TrialId


@dataclass(frozen=True, slots=True)
class Side:
    """Run in a comparison of several runs.

    Attributes:
        name: Name that the policy declared. If two names are equal, the folder name is added.
        diagnosis: Diagnosis of the run.
        path: Folder of the run, or path of the submission file.
        unfinished: Keys of the planned trials that have not ended yet, except for trials that could not be run.
        conventions: Versions and other conventions in the plan and the records, by name.
    """

    name: str
    diagnosis: RunDiagnosis
    path: str = ""
    unfinished: frozenset[str] = frozenset()
    conventions: dict[str, str] = field(default_factory=dict)


def load_sides(
    paths: Sequence[Path],
    *,
    names: Sequence[str] = (),
    allow_mixed: bool = False,
    on_progress: Callable[[str, int, int], None] | None = None,
) -> tuple[Side, ...]:
    """Read and diagnose the runs of a comparison.

    Args:
        paths: Folders of runs, or submission files. The outcomes in a submission file are used as they are stored.
        names: Names for the runs. By default, these are the names that the policies declared.
        allow_mixed: Whether to accept runs that mix versions or engines.
        on_progress: Called with the name of a run, the number of processed trials and the total number of trials.

    Raises:
        InvalidInputError: If fewer than two runs are given, if a run is given twice, if the names do not match the
            runs, or if a submission is damaged.
        UnknownNameError: If a submission names a task or condition that this installation does not have.
        RecordError: If a run or a record cannot be read.
        RunConflictError: If a run mixes versions or engines and ``allow_mixed`` is False.
    """
    if len(paths) < 2:
        raise InvalidInputError(
            "runs", f"a comparison needs at least two runs, got {len(paths)}", "Pass at least two run folders"
        )
    require_each_once(paths)
    sources = [read_submission(path) if path.is_file() else RunFolder.open(path) for path in paths]
    called = run_names([_heading(s, path) for s, path in zip(sources, paths, strict=True)], names)
    return tuple(
        _of_submission(source, path, name)
        if isinstance(source, Submission)
        else _load(source, name, allow_mixed=allow_mixed, on_progress=on_progress)
        for source, path, name in zip(sources, paths, called, strict=True)
    )


def name_sides(sides: Sequence[Side]) -> tuple[Side, ...]:
    """Give each compared run a unique name. If two runs have the same policy, the folder name is added."""
    names = told_apart([s.diagnosis.policy for s in sides], [s.path for s in sides])
    return tuple(replace(s, name=name) for s, name in zip(sides, names, strict=True))


def _load(run: RunFolder, name: str, *, allow_mixed: bool, on_progress: Callable[[str, int, int], None] | None) -> Side:
    told = None if on_progress is None else partial(on_progress, name)
    diagnosis = diagnose_run(run, allow_mixed=allow_mixed, whole=True, on_progress=told)
    ended = {str(TrialId(e.task, e.variation or e.condition, e.seed)) for e in run.entries()}
    unfinished = frozenset(t.key for t in diagnosis.trials if t.record is None and t.key not in ended)
    return Side(name, diagnosis, str(run.path), unfinished, side_conventions(run.plan, diagnosis.versions))


def _heading(source: RunFolder | Submission, path: Path) -> RunFolder:
    """Return a run folder that contains the name of a compared run.

    For a submission, this is a stand-in that contains only the policy's address and name.
    """
    if isinstance(source, RunFolder):
        return source
    return RunFolder(path, {"policy": source.policy}, {"policy": {"name": source.name}})


def _of_submission(submission: Submission, path: Path, name: str) -> Side:
    return Side(name, submission.diagnosis(), str(path), submission.unfinished, submission.conventions)
