"""Measurement of the demonstrations of several tasks, using worker processes and a journal."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from betterbench.certification.certificate import CertificateVersions
from betterbench.certification.demonstrations import Demonstration, demonstrate, planned_demonstrations, summed_up
from betterbench.certification.journal import CURE, DEMONSTRATIONS_NAME, VersionedJournal
from betterbench.certification.runner import versions_in_use
from betterbench.errors import InvalidInputError, RecordError
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.jobs import JobProgress, in_processes, run_items, write_durably
from betterbench.jobs.outputs import OutputFile
from betterbench.json_form import read_form, strict_form
from betterbench.tasks import Task, TrialId, get_task
from betterbench.tasks.demonstrated import PACKAGED, Demonstrated, updated_text
from betterbench.tasks.user_files import companion_of


@strict_form
@dataclass(frozen=True, slots=True)
class _Line:
    demonstration: Demonstration
    task_version: int


_LINE = TypeAdapter(_Line)


class DemonstrationJournal(VersionedJournal):
    """Journal of measured demonstrations, to which one process at a time can append.

    Demonstrations that were measured with another version of their task are measured again. Raises the errors of
    :class:`VersionedJournal`.
    """

    form = "betterbench demonstrations journal"

    def __init__(self, folder: Path, versions: CertificateVersions) -> None:
        self.found: dict[TrialId, Demonstration] = {}
        super().__init__(folder / DEMONSTRATIONS_NAME, versions)

    def append(self, found: Demonstration) -> None:
        """Append a demonstration that has been measured, and flush the file to the disk."""
        self._append_form(asdict(_Line(found, self._versions.tasks[found.task])))
        self.found[found.key] = found

    def _take_in_line(self, form: dict[str, Any], where: str) -> None:
        line = read_form(_LINE, form, where=where, cure=CURE, raises=RecordError)
        if self._versions.tasks.get(line.demonstration.task, line.task_version) == line.task_version:
            self.found[line.demonstration.key] = line.demonstration


def measure(
    tasks: Sequence[str],
    out: Path,
    *,
    number: int,
    workers: int = 1,
    robot: str = USUAL_ROBOT,
    on_progress: Callable[[JobProgress[Demonstration]], None] | None = None,
) -> dict[str, Demonstrated]:
    """Measure the demonstrations of the given tasks.

    Demonstrations that the journal in the folder already contains are not repeated.

    Args:
        tasks: Names of the tasks.
        out: Folder of the journal.
        number: Number of demonstrations per task. They use the training conditions in turn.
        workers: Number of worker processes.
        robot: Name of the robot.
        on_progress: Function that is called at the start of each pass and after every demonstration.

    Raises:
        InvalidInputError: If there are fewer demonstrations than training conditions, or if the number of workers is
            out of range.
        WorkerError: If worker processes keep dying.
        RunConflictError: If another process writes to the folder, or if the journal was started with other versions.
        RecordError: If the journal is corrupt.
    """
    chosen = [get_task(name) for name in dict.fromkeys(tasks)]
    for task in chosen:
        if number < len(task.training):
            problem = f"{number} demonstrations do not cover the {len(task.training)} training conditions of {task.id}"
            raise InvalidInputError("--demonstrations", problem, "Use a larger number")
    if not 1 <= workers <= 256:
        raise InvalidInputError("--workers", f"{workers} is out of range", "Use a number from 1 to 256")
    plans = {task.id: planned_demonstrations(task, number) for task in chosen}
    planned = [trial for plan in plans.values() for trials in plan for trial in trials]
    with DemonstrationJournal(out, versions_in_use([t.id for t in chosen], robot=robot)) as journal:
        for turn in (0, 1):
            so_far = {task.id: _summed_up(task, plans[task.id][:turn], journal) for task in chosen} if turn else {}
            due = {trial for plan in plans.values() for trial in plan[turn]}
            work, is_done = functools.partial(_of_turn, due, so_far, workers, robot), journal.found.__contains__
            run_items(planned, is_done=is_done, work=work, keep=journal.append, on_progress=on_progress)
        return {task.id: _summed_up(task, plans[task.id], journal) for task in chosen}


def _summed_up(task: Task, plan: Iterable[Sequence[TrialId]], journal: DemonstrationJournal) -> Demonstrated:
    return summed_up(task, [journal.found[trial] for trials in plan for trial in trials])


def _of_turn(
    due: Collection[TrialId], so_far: Mapping[str, Demonstrated], workers: int, robot: str, waiting: Iterable[TrialId]
) -> Iterator[Demonstration]:
    trials = [trial for trial in waiting if trial in due]
    return in_processes(trials, functools.partial(_demonstrate, so_far, robot), workers=workers)


def _demonstrate(so_far: Mapping[str, Demonstrated], robot: str, trial: TrialId) -> Demonstration:
    return demonstrate(trial, so_far.get(trial.task), robot=robot)


def destination(task: str) -> Path | None:
    """Return the path of the file for the measurements of a task, which is next to the user file that defines the task.

    Return None for a task of a packaged suite.
    """
    own = companion_of(task)
    return None if own is None else own.path


def write_demonstrations(found: Mapping[str, Demonstrated]) -> tuple[Path, ...]:
    """Write the measurements into the package or, for tasks defined in user files, next to these files.

    Return the paths of the written files.
    """
    files: dict[Path | None, dict[str, Demonstrated]] = {}
    for task, measured in found.items():
        files.setdefault(destination(task), {})[task] = measured
    written = []
    for path, tasks in files.items():
        if path is not None:
            with OutputFile(path, "certify", is_ours=lambda _: True):  # already checked when the file was loaded
                write_durably(path, updated_text(path, tasks).encode())
            written.append(path)
            continue
        with resources.as_file(resources.files("betterbench.tasks").joinpath("data")) as folder:
            folder.mkdir(exist_ok=True)
            write_durably(folder / PACKAGED, updated_text(folder / PACKAGED, tasks).encode())
            written.append(folder / PACKAGED)
    return tuple(written)
