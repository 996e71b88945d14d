"""Comparison of a modality folder with its run, to find missing, damaged, misplaced and unrelated files."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from betterbench.errors import RecordError, one_line
from betterbench.jobs import OnCount
from betterbench.records import JournalEntry, RunFolder
from betterbench.records.modalities.file import ModalityFile, fault_text
from betterbench.records.modalities.header import ViewHeader
from betterbench.sim.modalities.expected import ExpectedFile
from betterbench.sim.modalities.folder import Wanted, files_in, read_settings, trial_folder
from betterbench.sim.modalities.run import recorded_trials, seen_quality
from betterbench.tasks import TrialId


@dataclass(frozen=True, slots=True)
class FileProblem:
    """Problem with one file in a modality folder.

    Attributes:
        path: Path of the file, or the path at which it is expected.
        text: Description of the problem. It continues a sentence that begins with the name of the file.
        kind: "missing", "damaged", "other" (the file belongs elsewhere), or "extra" (no file is expected at this path).
    """

    path: Path
    text: str
    kind: Literal["missing", "damaged", "other", "extra"]


@dataclass(slots=True)
class FolderCheck:
    """Result of checking a modality folder.

    Attributes:
        wanted: Settings of the folder.
        files: Number of files that were checked.
        rows: Number of rows in the intact files.
        of_run: Number of files that were rendered from records of the run, including files with problems.
        strangers: Trials that readable files name but the run does not contain, each with its policy.
        problems: Problems that were found.
    """

    wanted: Wanted
    files: int = 0
    rows: int = 0
    of_run: int = 0
    strangers: list[str] = field(default_factory=list)
    problems: list[FileProblem] = field(default_factory=list)

    @property
    def is_of_another_run(self) -> bool:
        """Whether the files come from a different run.

        This is the case if some files are readable, but none of them matches a record of this run.
        """
        return bool(self.strangers) and not self.of_run


def check_folder(
    run: RunFolder,
    place: Path,
    *,
    trials: Sequence[TrialId] = (),
    on_progress: OnCount | None = None,
) -> FolderCheck:
    """Read all files in a modality folder and compare them with the run's records, without writing anything.

    For each recorded trial (or each of ``trials``), one file is expected for each view in the folder's settings. Its
    header must match, and its checksums must be correct. If ``trials`` are given, files of other trials are ignored.
    ``on_progress`` is called with the number of checked files and the number of known files.

    Raises RecordError if the folder has no settings, or if one of ``trials`` is not recorded.
    """
    found = FolderCheck(read_settings(place))
    digests: set[str] = set()
    wanted: dict[Path, ExpectedFile] = {}
    there: list[Path] = [] if trials else files_in(place)
    entries = {entry.key: entry for entry in run.entries()}
    for trial in recorded_trials(run, trials):
        folder = trial_folder(place, trial)
        there += sorted(folder.glob("*.parquet")) if trials else ()
        for expected in _expected(run, entries[trial], found.wanted):
            digests.add(expected.record_sha256)
            wanted[folder / f"{expected.view.name}.parquet"] = expected
    paths = list(dict.fromkeys((*wanted, *there)))
    for number, path in enumerate(paths, start=1):
        problem = _check_file(path, wanted.get(path), digests, found)
        if problem is not None:
            found.problems.append(problem)
        if on_progress is not None:
            on_progress(number, len(paths))
    return found


def _expected(run: RunFolder, entry: JournalEntry, wanted: Wanted) -> Iterator[ExpectedFile]:
    """Yield the expected properties of the file for each view of a recorded trial."""
    quality = wanted.quality
    if quality is None:
        with contextlib.suppress(RecordError):  # the modality files may be intact even if the record is damaged
            quality = seen_quality(run, run.read_record(entry.task, entry.condition, entry.seed))
    digest = run.record_digest(entry)
    for view in wanted.views:
        yield ExpectedFile(entry.key, view, wanted.modalities, digest, quality, wanted.renderer)


def _check_file(path: Path, expected: ExpectedFile | None, digests: set[str], found: FolderCheck) -> FileProblem | None:
    """Check a file by reading it completely. Return the problem that was found, or None."""
    if not path.exists():
        return FileProblem(path, "is missing", "missing")
    found.files += 1
    try:
        with ModalityFile(path) as file:
            if file.header.record_sha256 in digests:
                found.of_run += 1
            else:
                found.strangers.append(_origin(file.header))
            if expected is None:
                text = f"belongs to {_origin(file.header)}, but the trial is not recorded or the view is unknown"
                return FileProblem(path, text, "extra")
            difference = expected.difference(file.header)
            if difference is not None:
                return FileProblem(path, difference, "other")
            found.rows += file.check()
    except RecordError as problem:
        return FileProblem(path, fault_text(path, problem), "damaged" if expected is not None else "extra")
    return None


def _origin(header: ViewHeader) -> str:
    return one_line(f"{header.task}/{header.condition}/{header.seed} by {header.policy}", most=200)
