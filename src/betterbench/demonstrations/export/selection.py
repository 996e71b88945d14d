"""Select the recorded episodes to export as demonstrations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.records import JournalEntry, RunFolder
from betterbench.tasks import TrialId


@dataclass(frozen=True, slots=True)
class ChosenTrial:
    """Record to export.

    Attributes:
        trial: Trial of the record.
        run: Index of the run that contains the record, in the list of runs.
        digest: SHA-256 of the record file.
        scene_hash: Hash that identifies the stored scene. The images are rendered from this scene.
    """

    trial: TrialId
    run: int
    digest: str
    scene_hash: str


@dataclass(frozen=True, slots=True)
class Selection:
    """Demonstrations selected for export, in order, and the number of omitted trials by reason."""

    demonstrations: tuple[ChosenTrial, ...]
    left_out: Mapping[str, int]


def select_demonstrations(
    runs: Sequence[RunFolder], *, tasks: Collection[str] = (), variations: bool = False
) -> Selection:
    """Return the successful trials of the given runs, sorted by task, condition, seed and run.

    Args:
        runs: Runs with the records.
        tasks: Tasks to export; empty for all tasks.
        variations: Whether to export test variations too. By default they are left out, because a policy that was
            trained on them must not be evaluated on them.

    Raises:
        RecordError: If a record is missing, is damaged, or differs from the record in the journal.
        UnknownNameError: If no run has a requested task.
        InvalidInputError: If no trial is left, a record occurs twice, or the records of a task were made with different
            versions of the suite or the task.
    """
    found: list[ChosenTrial] = []
    left_out: Counter[str] = Counter()
    present: set[str] = set()
    versions: dict[str, tuple[str, JournalEntry]] = {}
    for number, run in enumerate(runs):
        for entry in run.entries():
            present.add(entry.task)
            reason = _left_out(entry, tasks, variations=variations)
            if not reason:
                brief = run.read_brief(entry.key, entry=entry)
                if brief.outcome.success:
                    told = brief.metadata
                    _require_one_version(versions, entry, told.task_version, told.suite_version)
                    found.append(ChosenTrial(entry.key, number, run.record_digest(entry), brief.metadata.scene_hash))
                    continue
                reason = "not successful"
            left_out[reason] += 1
    for task in tasks:
        if task not in present:
            raise UnknownNameError("task of the run", task, present)
    if not found:
        listed = ", ".join(f"{count} {reason}" for reason, count in sorted(left_out.items())) or "it is empty"
        where = ", ".join(str(run.path) for run in runs)
        raise InvalidInputError(
            where,
            f"no requested demonstration was found ({listed})",
            "Use a run with successful trials of training conditions, or include trials of test variations "
            "(--variations of `better export`, or variations: true in a recipe of `better train`)",
        )
    _require_once(found, runs)
    return Selection(tuple(sorted(found, key=lambda d: (d.trial, d.run))), dict(sorted(left_out.items())))


def _require_one_version(
    versions: dict[str, tuple[str, JournalEntry]], entry: JournalEntry, of_task: int, of_suite: str
) -> None:
    """Raise InvalidInputError if a task was demonstrated with different versions of the task or the suite."""
    version = f"version {of_task} of the task and {of_suite} of the suite"
    before, first = versions.setdefault(entry.task, (version, entry))
    if version != before:
        problem = f"it was recorded with {version}, but {first.key} with {before}"
        raise InvalidInputError(f"record of {entry.key}", problem, "Export each version separately")


def _require_once(found: Sequence[ChosenTrial], runs: Sequence[RunFolder]) -> None:
    first: dict[str, ChosenTrial] = {}
    for one in found:
        other = first.setdefault(one.digest, one)
        if other is not one:
            where = f"{runs[one.run].path}: record of {one.trial}"
            raise InvalidInputError(
                where, f"the same record is also in {runs[other.run].path}", "Pass each run only once"
            )


def _left_out(entry: JournalEntry, tasks: Collection[str], *, variations: bool) -> str:
    """Return the reason why a trial is not exported. Return "" if it is exported."""
    if entry.status != "done":
        return "not finished"
    if tasks and entry.task not in tasks:
        return "of other tasks"
    if entry.variation is not None and not variations:
        return "of test variations"
    return ""
