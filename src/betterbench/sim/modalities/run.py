"""Rendering of a run's records as modality files in a folder.

It can be interrupted and resumed.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from betterbench.errors import RecordError
from betterbench.interface import observation_spec
from betterbench.jobs import OnCount, counts, in_threads, job_folder, run_items
from betterbench.jobs.ahead import ahead
from betterbench.json_form import file_digest
from betterbench.records import Record, RunFolder
from betterbench.records.modalities.file import ModalityFile, fault_text
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.modalities.expected import ExpectedFile
from betterbench.sim.modalities.folder import ModalityFolder, Wanted, require_free_place
from betterbench.sim.modalities.trial_files import TrialFiles, TrialOrigin
from betterbench.sim.scenes.limited import LimitedView
from betterbench.tasks import TrialId

logger = logging.getLogger(__name__)

_AHEAD_BYTES = 64 << 20
_POLL_S = 1.0


@dataclass(frozen=True, slots=True)
class Materialized:
    """Result of one ``better materialize`` command.

    Attributes:
        trials: Number of trials whose files are complete now.
        files: Number of files that this command has written.
        kept: Number of files that were already intact.
        rows: Number of rows in the written files.
        bytes: Size of the written files [byte].
        seconds: Duration of the command [s].
    """

    trials: int
    files: int
    kept: int
    rows: int
    bytes: int
    seconds: float


@dataclass(slots=True)
class _Tally:
    trials: int = 0
    files: int = 0
    kept: int = 0
    rows: int = 0
    bytes: int = 0
    problems: list[str] = field(default_factory=list)


def default_views(run: RunFolder) -> tuple[ViewSpec, ...]:
    """Return the views that the policy of a run uses. If it uses no images, return the views of the default preset."""
    told = run.plan.get("observation")
    name = told.get("name") if isinstance(told, dict) else told
    preset = observation_spec(name if isinstance(name, str) else "default")
    cameras = preset.cameras or observation_spec("default").cameras
    return tuple(ViewSpec(c.name, c.width, c.height) for c in cameras)


def materialize_run(
    run: RunFolder,
    out: Path,
    wanted: Wanted,
    *,
    trials: Sequence[TrialId] = (),
    workers: int = 1,
    follow: bool = False,
    on_progress: OnCount | None = None,
) -> Materialized:
    """Write the missing or damaged modality files of a run's recorded trials. Intact files are kept.

    The bytes of the files depend neither on the number of workers nor on interruptions. If ``follow`` is True, the
    function waits for further recorded trials until the run ends. ``on_progress`` is called with the number of finished
    trials and the number of known trials.

    Raises:
        RunConflictError: If the folder contains unrelated files, was rendered with a different OpenGL, or is in use.
        RecordError: If records or scenes are missing or damaged. The other trials are finished first.
        StorageError: If the disk is full, or if the folder was removed or moved in the meantime.
        MissingDependencyError: If off-screen OpenGL does not work on this machine.
    """
    began, tally = time.monotonic(), _Tally()
    finished: set[TrialId] = set()
    list(recorded_trials(run, trials))  # raise for missing trials before creating a folder
    require_free_place(out)
    with job_folder(out.absolute()):
        writer = _Writer(run, ModalityFolder(out, wanted), tally)

        def work(fresh: Iterable[TrialId]) -> Iterator[TrialId]:
            return in_threads(fresh, writer.write, workers=workers, open_resource=lambda: _Views(run))

        while True:
            running = follow and run.is_running  # before reading the journal, because the run may end in between
            known = list(recorded_trials(run, trials))
            fresh = run_items(
                known, is_done=finished.__contains__, work=work, keep=finished.add, on_progress=counts(on_progress)
            )
            if not running:
                break
            if not fresh:
                time.sleep(_POLL_S)
    if tally.problems:
        more = len(tally.problems) - 1
        raise RecordError(tally.problems[0] + (f" {more} more trials could not be read either." if more else ""))
    seconds = time.monotonic() - began
    return Materialized(tally.trials, tally.files, tally.kept, tally.rows, tally.bytes, round(seconds, 3))


def recorded_trials(run: RunFolder, trials: Sequence[TrialId]) -> Iterator[TrialId]:
    """Yield the recorded trials, or only the requested trials, in the order of the journal.

    Raises RecordError if a requested trial is not recorded.
    """
    done = [entry.key for entry in run.entries() if entry.status == "done"]
    missing = [trial for trial in trials if trial not in done]
    if missing:
        raise RecordError(
            f"{run.path}: the trial {missing[0]} is not recorded. Name a recorded trial as TASK/CONDITION/SEED."
        )
    yield from (trial for trial in done if not trials or trial in trials)


class _Views:
    """Rendering processes of one thread: one process per render preset. They end when the context manager exits."""

    def __init__(self, run: RunFolder) -> None:
        self._run = run
        self._views: dict[str, LimitedView] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for view in self._views.values():
            view.close()

    def stop(self) -> None:
        """End the processes. This method may be called from another thread.

        If a thread is rendering, RecordError is raised in that thread.
        """
        for view in list(self._views.values()):
            view.stop()

    def opened(self, record: Record, quality: str) -> LimitedView:
        """Return a rendering process that has opened the scene of a record."""
        view = self._views.get(quality)
        if view is None or view.is_closed:
            view = self._views[quality] = LimitedView(quality=quality)
        view.open_of(self._run, record)
        return view


class _Writer:
    """Writer of the modality files of trials. It is shared by several threads."""

    def __init__(self, run: RunFolder, folder: ModalityFolder, tally: _Tally) -> None:
        self._run, self._folder, self._tally, self._lock = run, folder, tally, threading.Lock()

    def write(self, views: _Views, trial: TrialId) -> TrialId:
        """Write the missing files of a trial and return the trial.

        If its record cannot be read, remember the problem.
        """
        try:
            self._write(views, trial)
        except RecordError as problem:
            with self._lock:
                self._tally.problems.append(str(problem))
        return trial

    def _write(self, views: _Views, trial: TrialId) -> None:
        record = self._run.read_record(trial.task, trial.condition, trial.seed)
        digest = file_digest(self._run.record_path(trial.task, trial.condition, trial.seed))
        quality = self._folder.wanted.quality or seen_quality(self._run, record)
        place = self._folder.trial(trial)
        missing = [v for v in self._folder.wanted.views if not self._is_there(trial, v, digest, quality)]
        with self._lock:
            self._tally.kept += len(self._folder.wanted.views) - len(missing)
        paths = self._draw(views.opened(record, quality), record, (digest, quality), place, missing) if missing else []
        with self._lock:
            self._tally.trials += 1
            self._tally.files += len(paths)
            self._tally.rows += len(paths) * len(record)
            self._tally.bytes += sum(path.stat().st_size for path in paths)

    def _is_there(self, trial: TrialId, view: ViewSpec, digest: str, quality: str) -> bool:
        """Return whether the file for a view of a trial exists, belongs to this record, and is intact.

        The whole file is read, because an intact header does not mean that the rows are intact. This takes about 2 % of
        the time that rendering takes.
        """
        path, wanted = self._folder.trial(trial) / f"{view.name}.parquet", self._folder.wanted
        if not path.exists():
            return False
        expected = ExpectedFile(trial, view, wanted.modalities, digest, quality, wanted.renderer)
        try:
            with ModalityFile(path) as file:
                fault = expected.difference(file.header)
                if fault is None:
                    file.check()
                    return True
        except RecordError as problem:
            fault = fault_text(path, problem)
        logger.warning("%s %s. It is rendered again.", path, fault)
        return False

    def _draw(
        self, limited: LimitedView, record: Record, told: tuple[str, str], place: Path, views: Sequence[ViewSpec]
    ) -> list[Path]:
        """Render views of a record and return their files.

        ``told`` contains the record's digest and the render preset.
        """
        meta, modalities = record.metadata, self._folder.wanted.modalities
        facts, renderer = limited.prepare(views, modalities)
        with self._lock:
            self._folder.claim(renderer)
        origin = TrialOrigin(meta, *told, renderer)
        with TrialFiles(place, views, modalities, facts=facts, objects=meta.scene.objects) as files:
            times = record.time.tolist()
            rows = limited.sights(record.qpos, jitter=meta.view_jitter)
            try:
                with ahead(rows, max(2, min(64, _AHEAD_BYTES // limited.row_bytes))) as taken:
                    for sights, time_s in zip(taken, times, strict=True):
                        files.add(sights, time_s)
            except BaseException:
                limited.close()  # the process may still be sending rows, so it cannot be reused
                raise
            return files.finish(origin)


def seen_quality(run: RunFolder, record: Record) -> str:
    """Return the render preset of the images that a record's policy got.

    If the policy used no images, return the preset of the run.
    """
    planned = run.plan.get("quality")
    name = planned.get("name") if isinstance(planned, dict) else None
    return record.metadata.render_quality or (name if isinstance(name, str) else "standard")
