"""Worker on a Ray cluster, which runs as an actor. Importing this module does not import Ray."""

from __future__ import annotations

import os
import platform
import tempfile
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from betterbench.errors import BetterError, InvalidInputError
from betterbench.evaluation.trials.trial import WorkerSettings
from betterbench.evaluation.workers.worker import Worker
from betterbench.records import JournalEntry, RunFolder
from betterbench.sim.graphics import take_device
from betterbench.sim.scenes import engine_version
from betterbench.tasks import SUITE_VERSION
from betterbench.tasks.trial import Trial
from betterbench.tasks.user_files import load_sources
from betterbench.version import __version__

TURN_S = 2.0
"""Maximum time between two reports of a worker [s]. A worker sends a report even if no trial has ended."""


@dataclass(frozen=True, slots=True)
class Delivery:
    """Journal entry and record of a trial that has ended. The record is None if the trial ended with an error."""

    entry: JournalEntry
    record: bytes | None


@dataclass(frozen=True, slots=True)
class Turn:
    """Report of a worker on its work since the last report.

    Attributes:
        deliveries: Trials that have ended.
        scenes: Contents of the scene files that have not been delivered yet, by hash.
        problem: Error that must stop the run, or None.
        envs: Number of trials that the worker can run at the same time from now on, or 0 if this is not known.
        steps: Number of control steps since the last report.
    """

    deliveries: tuple[Delivery, ...] = ()
    scenes: Mapping[str, bytes] = field(default_factory=dict)
    problem: BetterError | None = None
    envs: int = 0
    steps: int = 0


def versions_here() -> dict[str, str]:
    """Return the software versions and the CPU architecture of this machine.

    They must be the same on all machines of a run, because the results are bit-identical only in this case.
    """
    return {
        "betterbench": __version__,
        "suite": SUITE_VERSION,
        "mujoco": engine_version(),
        "architecture": platform.machine(),
    }


class RemoteWorker:
    """Worker on another machine. It cannot access the run folder, and sends records as bytes instead.

    The worker runs trials in a temporary folder with a copy of ``run.json``, and deletes files after sending them.
    """

    def __init__(self, settings: WorkerSettings, description: bytes, known: Sequence[str]) -> None:
        """Store the settings, the content of ``run.json``, and the hashes of the scenes already in the run folder."""
        self._settings, self._description, self._known = settings, description, tuple(known)
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._worker: Worker | None = None
        self._waiting: deque[Trial] = deque()
        self._steps = 0  # number of control steps since the last report

    def prepare(self, secrets: Mapping[str, str]) -> dict[str, str]:
        """Prepare the worker, and return the software versions on this machine.

        The driver compares these versions with its own. ``secrets`` contains environment variables that the worker
        needs to connect to the policy. If the worker cannot be prepared, the result also contains the reason in the
        entry "problem".
        """
        os.environ.setdefault("LP_NUM_THREADS", "0")
        os.environ.update(secrets)
        take_device(self._settings.turn)
        load_sources(self._settings.task_files)
        versions = versions_here()
        self._folder = tempfile.TemporaryDirectory(prefix="betterbench-")
        path = Path(self._folder.name)
        (path / "run.json").write_bytes(self._description)
        run = RunFolder.open(path)
        for scene in self._known:
            run.scene_path(scene).parent.mkdir(exist_ok=True)
            run.scene_path(scene).touch()
        try:
            self._worker = Worker(replace(self._settings, run=str(path)), on_step=self._count)
        except BetterError as error:
            return {**versions, "problem": str(error)}
        return versions

    def turn(self, trials: Sequence[Trial]) -> Turn:
        """Queue trials, run for up to :data:`TURN_S`, and return a report. Trials wait until an environment is free."""
        if self._worker is None:
            raise InvalidInputError("worker", "the worker is not prepared", "Call prepare first")
        self._waiting.extend(trials)
        while self._waiting and self._worker.free:
            self._worker.start(self._waiting.popleft())
        try:
            ended = self._worker.finished(TURN_S)
        except BetterError as error:
            return Turn(problem=error)
        deliveries = tuple(Delivery(entry, self._record(entry)) for entry in ended)
        steps, self._steps = self._steps, 0
        return Turn(deliveries, self._scenes() if ended else {}, self._worker.problem, self._worker.envs, steps)

    def _count(self, _step: int) -> None:
        self._steps += 1

    def close(self) -> None:
        """Close the worker and delete its folder. The method may be called more than once."""
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.close()
        folder, self._folder = self._folder, None
        if folder is not None:
            folder.cleanup()

    def _run(self) -> RunFolder:
        if self._folder is None:
            raise InvalidInputError("worker", "the worker is closed", "Create a new worker")
        return RunFolder.open(Path(self._folder.name))

    def _record(self, entry: JournalEntry) -> bytes | None:
        if entry.status != "done":
            return None
        path = self._run().record_path(entry.task, entry.condition, entry.seed)
        data = path.read_bytes()
        path.unlink()
        return data

    def _scenes(self) -> dict[str, bytes]:
        """Return the scene files that have been written since the last call, and empty these files.

        The empty files are kept, because their names show which scenes have already been sent.
        """
        found = {}
        for path in sorted(self._run().path.glob("scenes/*.zip")):
            if path.stat().st_size:
                found[path.stem] = path.read_bytes()
                path.write_bytes(b"")
        return found
