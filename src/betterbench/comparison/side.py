"""Sides of a comparison: the runs, each with its diagnosis and its conventions."""

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
    """One run in a comparison.

    Attributes:
        name: Name that the policy declared. The folder name is added if two names are equal.
        unfinished: Keys of planned trials that have neither ended nor failed to run.
        conventions: Versions and conventions by name, from the plan and the records.
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
    """Read and diagnose the runs of a comparison; ``names`` overrides the policy names.

    A path is the folder of a run, or a submission file, whose outcomes are used as stored. ``on_progress`` is called
    with the name of a run, the number of processed trials, and the total number of trials.

    Raises:
        InvalidInputError: If fewer than two runs are given, a run is given twice, the names do not match the runs, or a
            submission is damaged.
        UnknownNameError: If a submission names a task or condition that does not exist here.
        RecordError: If a run or a record cannot be read.
        RunConflictError: If a run mixes versions or engines and mixing is not allowed.
    """
    if len(paths) < 2:
        raise InvalidInputError(
            "runs", f"a comparison needs at least two runs, got {len(paths)}", "Give at least two run folders"
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
    """Return the sides with unique names. The folder name is added if two runs have the same policy."""
    names = told_apart([s.diagnosis.policy for s in sides], [s.path for s in sides])
    return tuple(replace(s, name=name) for s, name in zip(sides, names, strict=True))


def _load(run: RunFolder, name: str, *, allow_mixed: bool, on_progress: Callable[[str, int, int], None] | None) -> Side:
    told = None if on_progress is None else partial(on_progress, name)
    diagnosis = diagnose_run(run, allow_mixed=allow_mixed, whole=True, on_progress=told)
    ended = {str(TrialId(e.task, e.variation or e.condition, e.seed)) for e in run.entries()}
    unfinished = frozenset(t.key for t in diagnosis.trials if t.record is None and t.key not in ended)
    return Side(name, diagnosis, str(run.path), unfinished, side_conventions(run.plan, diagnosis.versions))


def _heading(source: RunFolder | Submission, path: Path) -> RunFolder:
    """Return the run of a source. For a submission, it contains only the policy address and name."""
    if isinstance(source, RunFolder):
        return source
    return RunFolder(path, {"policy": source.policy}, {"policy": {"name": source.name}})


def _of_submission(submission: Submission, path: Path, name: str) -> Side:
    return Side(name, submission.diagnosis(), str(path), submission.unfinished, submission.conventions)
