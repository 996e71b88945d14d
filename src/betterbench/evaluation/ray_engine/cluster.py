"""Where a run on a Ray cluster is placed, and what a worker there does; Ray itself is not needed to read this."""

from __future__ import annotations

import importlib.util
import os
import platform
import socket
import tempfile
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import betterbench
from betterbench.errors import BetterError, InvalidInputError, MissingDependencyError
from betterbench.evaluation.planning.plan import Trial
from betterbench.evaluation.trials.trial import RunSettings
from betterbench.evaluation.workers.worker import Worker
from betterbench.recording import JournalEntry, RunFolder
from betterbench.scenes import engine_version
from betterbench.tasks import SUITE_VERSION
from betterbench.tasks.user_files import load_sources

_KNOCK_S = 10.0

TURN_S = 2.0
"""How long a worker goes on before it reports, whether a trial has ended or not [s]."""


@dataclass(frozen=True, slots=True)
class Cluster:
    """Where a run on Ray is placed.

    Attributes:
        address: Address of the cluster; None for RAY_ADDRESS or, if that is not set, one of this machine alone.
        replicas: Copies of a policy that is held by processes of the run (a checkpoint, a policy that takes batches).
        replica_gpus: Graphics cards that each of them gets; None for one if the cluster has any.
    """

    address: str | None = None
    replicas: int = 1
    replica_gpus: float | None = None

    @property
    def given(self) -> str | None:
        """Address of the cluster, or of the environment; None where there is none."""
        return self.address or os.environ.get("RAY_ADDRESS") or None

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidInputError: If one is out of range.
        """
        if not 1 <= self.replicas <= 256:
            raise InvalidInputError("--replicas", f"{self.replicas} is out of range", "Give a number from 1 to 256")
        if self.replica_gpus is not None and not 0.0 <= self.replica_gpus <= 64.0:
            raise InvalidInputError("--replica-gpus", f"{self.replica_gpus:g} is out of range", "Give 0 to 64")


def require_ray(cluster: Cluster) -> None:
    """Check that Ray is installed and that somebody listens at the address of the cluster, without loading Ray.

    Ray itself would try an address that nobody listens at for minutes.

    Args:
        cluster: Where the run is placed.

    Raises:
        MissingDependencyError: If Ray is not installed.
        InvalidInputError: If nobody listens at the address.
    """
    if importlib.util.find_spec("ray") is None:
        raise MissingDependencyError("--engine ray: Ray is not installed. Run: pip install 'betterbench[ray]'")
    address = cluster.given or "local"
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        return  # a word that Ray understands ("auto", "local")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_KNOCK_S).close()
    except (OSError, OverflowError) as error:
        told = getattr(error, "strerror", None) or str(error)
        raise InvalidInputError(
            "--ray-address", f"no Ray cluster at {address} ({told})", "Start one there with `ray start --head`"
        ) from None


ANYWHERE = Cluster()
"""The cluster of the environment, or this machine."""


@dataclass(frozen=True, slots=True)
class Delivery:
    """A trial that has ended, with its record.

    Attributes:
        entry: Its line for the journal.
        record: Content of its record; None for a trial that broke down.
    """

    entry: JournalEntry
    record: bytes | None


@dataclass(frozen=True, slots=True)
class Turn:
    """What a worker reports.

    Attributes:
        deliveries: The trials that have ended since it reported last.
        scenes: Scenes that are new to this worker, by their hash.
        problem: Why the run has to stop, or None.
    """

    deliveries: tuple[Delivery, ...] = ()
    scenes: Mapping[str, bytes] = field(default_factory=dict)
    problem: BetterError | None = None


def versions_here() -> dict[str, str]:
    """Return what has to be alike on all machines of a run, so that a trial has the same bits on each."""
    return {
        "betterbench": betterbench.__version__,
        "suite": SUITE_VERSION,
        "mujoco": engine_version(),
        "architecture": platform.machine(),
    }


class RemoteWorker:
    """A worker on another machine: it shares no folder with the run, and delivers records as bytes.

    The run's description is copied into a folder of its own, which the trials are run in; what they write is handed
    over and deleted.
    """

    def __init__(self, settings: RunSettings, description: bytes, known: Sequence[str]) -> None:
        """Note what to do; nothing is opened before :meth:`prepare`.

        Args:
            settings: What all trials of the run share; its folder is replaced.
            description: Content of ``run.json``.
            known: Hashes of the scenes that the run holds already.
        """
        self._setting, self._description, self._known = settings, description, tuple(known)
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._worker: Worker | None = None
        self._waiting: deque[Trial] = deque()

    def prepare(self, secrets: Mapping[str, str]) -> dict[str, str]:
        """Open the worker.

        Args:
            secrets: Variables to set in the environment (the key of a policy's replicas).

        Returns:
            The versions here, to be compared; with "problem" if the worker cannot work.
        """
        os.environ.setdefault("LP_NUM_THREADS", "0")
        os.environ.update(secrets)
        load_sources(self._setting.task_files)
        versions = versions_here()
        self._folder = tempfile.TemporaryDirectory(prefix="betterbench-")
        path = Path(self._folder.name)
        (path / "run.json").write_bytes(self._description)
        run = RunFolder.open(path)
        for scene in self._known:
            run.scene_path(scene).parent.mkdir(exist_ok=True)
            run.scene_path(scene).touch()
        try:
            self._worker = Worker(replace(self._setting, run=str(path)))
        except BetterError as error:
            return {**versions, "problem": str(error)}
        return versions

    def turn(self, trials: Sequence[Trial]) -> Turn:
        """Take trials, go on with all for a while, and report.

        Args:
            trials: More trials; those for which no environment is free wait here.
        """
        if self._worker is None:
            raise InvalidInputError("worker", "it is not prepared", "Call prepare first")
        self._waiting.extend(trials)
        while self._waiting and self._worker.free:
            self._worker.start(self._waiting.popleft())
        try:
            ended = self._worker.finished(TURN_S)
        except BetterError as error:
            return Turn(problem=error)
        return Turn(tuple(Delivery(entry, self._record(entry)) for entry in ended), self._scenes() if ended else {})

    def close(self) -> None:
        """Close the worker and delete its folder; harmless when closed."""
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.close()
        folder, self._folder = self._folder, None
        if folder is not None:
            folder.cleanup()

    def _run(self) -> RunFolder:
        if self._folder is None:
            raise InvalidInputError("worker", "it is closed", "Make another one")
        return RunFolder.open(Path(self._folder.name))

    def _record(self, entry: JournalEntry) -> bytes | None:
        if entry.status != "done":
            return None
        path = self._run().record_path(entry.task, entry.condition, entry.seed)
        data = path.read_bytes()
        path.unlink()
        return data

    def _scenes(self) -> dict[str, bytes]:
        """Return the scenes that were written since this was asked last; empty files stay, and say that they were."""
        found = {}
        for path in sorted(self._run().path.glob("scenes/*.zip")):
            if path.stat().st_size:
                found[path.stem] = path.read_bytes()
                path.write_bytes(b"")
        return found
