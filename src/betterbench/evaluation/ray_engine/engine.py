"""The same run on a Ray cluster: workers and replicas of the policy are actors, the journal stays the only truth.

No file system is shared. Workers send finished records to the process that drives the run, which alone writes; a worker
that dies takes nothing along but the trials it was at, and others do them again.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import secrets
import time
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from betterbench.errors import BetterError, InvalidInputError, PolicyUnavailableError, WorkerError
from betterbench.evaluation.planning.plan import Trial
from betterbench.evaluation.ray_engine.cluster import Cluster, RemoteWorker, Turn, versions_here
from betterbench.evaluation.serving.host import address_within, leave_hanging
from betterbench.evaluation.serving.server import open_server
from betterbench.evaluation.trials.shared_policy import Deadline
from betterbench.evaluation.trials.trial import RunSettings, on_disk
from betterbench.evaluation.workers.worker import even_share
from betterbench.policies.server import PolicyServer
from betterbench.recording import JournalEntry, RunFolder, write_durably
from betterbench.tasks import TrialId

logger = logging.getLogger(__name__)

PLACING_S = 300.0
"""How long is waited until the cluster has a place for a worker while there is none, or for the replicas [s]. What they
load there may take longer."""

MAX_DEATHS_OF_A_TRIAL = 3
"""How often workers may die at a trial before it is given up as broken."""

MAX_DEATHS_IN_A_ROW = 6
"""How many workers may die one after the other, without any trial having ended, before the run gives up."""

MAX_REVIVALS = 5
"""How many replicas of the policy are replaced before the run stops as if its server could not be reached."""

_FAREWELL_S = 3.0
_REPLICA_PATIENCE_S = 10.0
_KEY_NAME = "BETTERBENCH_REPLICA_KEY"
_CALLS = 2  # one under way and one behind it, so that a worker never waits for us
_OBJECT_STORE_BYTES = 128 * 1024 * 1024
_SCENE_ENDING = ".zip"
_AGAIN = "Look at Ray's logs, then run the same command again: it goes on where it stopped."


def ray_entries(
    session: RaySession,
    run: RunFolder,
    settings: RunSettings,
    trials: Sequence[Trial],
    *,
    served: bool = False,
) -> Iterator[JournalEntry]:
    """Run trials on a Ray cluster and yield the line of each for the journal, after its record is written.

    Args:
        session: The cluster.
        run: The run; only this process writes to it.
        settings: What all trials of the run share.
        trials: The trials.
        served: Whether the policy is held by replicas, of which the workers are clients.

    Raises:
        InvalidInputError: If the cluster has no place, or has other versions.
        WorkerError: If workers keep dying, cannot start, or the cluster itself is gone.
        BetterError: What stops a run: a broken premise, a full disk, a policy that cannot be reached.
    """
    pool = _Pool(session, run, settings, trials)
    try:
        yield from pool.entries(served=served)
    except _errors_of(session.ray) as error:
        raise _gone(error) from error
    finally:
        pool.close()


def _import_ray() -> Any:  # noqa: ANN401 -- a module without types
    """Return Ray, told to send nothing about its use."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    return importlib.import_module("ray")


def _errors_of(ray: Any) -> tuple[type[Exception], ...]:  # noqa: ANN401 -- a module without types
    """Return what Ray raises when something on the cluster is lost, or the cluster itself."""
    return ray.exceptions.RayError, ConnectionError


def _reason(error: Exception) -> str:
    """Return why something failed, in one line; what was raised on the cluster stands behind a traceback of Ray's."""
    cause = getattr(error, "cause", None)
    told = str(error) if cause is None else f"{type(cause).__name__}: {cause}"
    return (told.splitlines() or [type(error).__name__])[0][:200].rstrip(".: ")


def _gone(error: Exception) -> WorkerError:
    return WorkerError(f"The Ray cluster does not answer any more ({_reason(error)}). {_AGAIN}")


def _meaning(error: Any, what: str) -> BetterError:  # noqa: ANN401 -- an error of Ray
    """Return what stops a run, of an error that was raised on the cluster; one of ours speaks for itself."""
    if isinstance(error.cause, BetterError):
        return error.cause
    return WorkerError(f"{what}: {_reason(error)}. {_AGAIN}")


class RaySession:
    """A connection to a cluster, or a cluster of this machine alone, for as long as a run takes.

    Attributes:
        cluster: Where actors are placed.
        ray: The module.
    """

    def __init__(self, cluster: Cluster, workers: int | None) -> None:
        """Prepare.

        Args:
            cluster: Where actors are placed.
            workers: Worker actors, one processor each; None for as many as the cluster has processors.
        """
        self.cluster, self.ray = cluster, _import_ray()
        self._workers = workers
        self._mine = False

    def __enter__(self) -> Self:
        """Connect, or start a cluster.

        Raises:
            InvalidInputError: If the cluster cannot be reached.
        """
        ray = self.ray
        if ray.is_initialized():
            return self
        address = self.cluster.given
        quiet = {"include_dashboard": False, "log_to_driver": False, "logging_level": logging.WARNING}
        try:
            if address is None or address == "local":
                processors = max(self._workers or 1, os.cpu_count() or 1)
                ray.init("local", num_cpus=processors, object_store_memory=_OBJECT_STORE_BYTES, **quiet)
            else:
                ray.init(address, log_to_driver=False, logging_level=logging.WARNING)
        except BaseException as error:
            ray.shutdown()  # Ray raises all sorts of errors, and may have started half of its processes
            if not isinstance(error, Exception):
                raise  # Ctrl-C
            where = address or "this machine"
            raise InvalidInputError(
                "--ray-address", f"no Ray cluster at {where} ({_reason(error)})", "Start one with `ray start`"
            ) from error
        self._mine = True
        return self

    def __exit__(self, *_: object) -> None:
        """Disconnect, and end the cluster if it was started here."""
        if self._mine:
            self.ray.shutdown()

    @property
    def workers(self) -> int:
        """Number of workers: what was asked for, or what the cluster has processors for."""
        return self._workers or max(1, int(self._all_of("CPU")))

    def replica_gpus(self) -> float:
        """Graphics cards of each replica of the policy."""
        asked = self.cluster.replica_gpus
        if asked is not None:
            return asked
        return 1.0 if self._all_of("GPU") >= self.cluster.replicas else 0.0

    def _all_of(self, resource: str) -> float:
        """Return how much of a resource the cluster has, free or not.

        Raises:
            WorkerError: If the cluster is gone.
        """
        try:
            return float(self.ray.cluster_resources().get(resource, 0.0))
        except _errors_of(self.ray) as error:
            raise _gone(error) from error


@dataclass(slots=True, eq=False)
class _WorkerPlace:
    """A worker as the driver sees it.

    Attributes:
        actor: Handle of the actor.
        calls: Calls under way, the oldest first.
        trials: Trials that it was given and that have not ended.
        placed: Whether it has a place on the cluster.
        ready: Whether it has been prepared.
        alone: Whether its one trial was with a worker that died.
        replica: Number of the replica of the policy that it asks, or None.
        broken: Trials of its that have broken down.
    """

    actor: Any
    calls: deque[Any]
    trials: list[Trial] = field(default_factory=list)
    placed: bool = False
    ready: bool = False
    alone: bool = False
    replica: int | None = None
    broken: list[Trial] = field(default_factory=list)


class _Pool:
    """The workers of a run, and what is left to do."""

    def __init__(self, session: RaySession, run: RunFolder, settings: RunSettings, trials: Sequence[Trial]) -> None:
        self._ray, self._session, self._run = session.ray, session, run
        self._setting, self._cluster = settings, session.cluster
        self._waiting = deque(trials)
        self._suspects: deque[Trial] = deque()
        self._posts: list[_WorkerPlace] = []
        self._replicas: list[Any] = []
        self._addresses: list[str] = []
        self._secrets: dict[str, str] = {}
        self._deaths: Counter[Trial] = Counter()
        self._deaths_in_a_row = 0
        self._made = 0
        self._asked_at = 0.0
        self._revivals = 0

    def entries(self, *, served: bool) -> Iterator[JournalEntry]:
        """Yield the lines of all trials as they end."""
        if served:
            self._start_replicas()
        for _ in range(min(self._session.workers, len(self._waiting))):
            self._add_post()
        while self._left:
            for post in self._posts:
                self._feed(post)
            calls = {call: post for post in self._posts for call in post.calls}
            done, _ = self._ray.wait(list(calls), num_returns=1, timeout=5.0)
            for call in done:
                yield from self._take(calls[call], call)
            placed = any(post.placed for post in self._posts)
            if not placed and time.monotonic() - self._asked_at > PLACING_S:
                raise InvalidInputError(
                    "--engine ray",
                    f"the cluster has no place for a worker of one processor (free: {self._free()})",
                    "Wait until other work is done, or add machines",
                )

    def close(self) -> None:
        """End all actors; what they were at is done again by the same command."""
        with contextlib.suppress(*_errors_of(self._ray)):
            farewells = [post.actor.close.remote() for post in self._posts if post.ready]
            if farewells:
                self._ray.wait(farewells, num_returns=len(farewells), timeout=_FAREWELL_S)
        self._kill(post.actor for post in self._posts)
        self._kill(self._replicas)
        self._posts, self._replicas = [], []

    def _kill(self, actors: Iterable[Any]) -> None:
        """End actors; one that is gone already, with its cluster or without, is no matter."""
        for actor in actors:
            with contextlib.suppress(*_errors_of(self._ray)):
                self._ray.kill(actor)

    @property
    def _left(self) -> bool:
        """Whether anything is left to do."""
        return bool(self._waiting or self._suspects or any(post.trials for post in self._posts))

    def _add_post(self, replica: int | None = None) -> None:
        """Add a worker; where the policy has replicas it asks the one of that number, or the next in turn."""
        settings = self._setting
        if self._addresses:
            replica = self._made % len(self._addresses) if replica is None else replica
            settings = replace(settings, served_at=self._addresses[replica])
        self._made += 1
        known = [path.stem for path in sorted((self._run.path / "scenes").glob(f"*{_SCENE_ENDING}"))]
        description = (self._run.path / "run.json").read_bytes()
        # An actor whose process has died is replaced by us: only we know what it was at.
        remote = self._ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(RemoteWorker)
        actor = remote.remote(settings, description, known)
        calls = deque([actor.__ray_ready__.remote(), actor.prepare.remote(self._secrets)])
        self._posts.append(_WorkerPlace(actor, calls, replica=replica))
        self._asked_at = time.monotonic()

    def _feed(self, post: _WorkerPlace) -> None:
        """Give a worker as much as it can begin, and one more while there is plenty, so that it never waits for us."""
        if not post.ready:
            return
        if len(post.calls) >= _CALLS or (post.alone and post.trials):
            new: list[Trial] = []
        elif self._suspects and not post.trials:
            new, post.alone = [self._suspects.popleft()], True
        else:
            plenty = len(self._waiting) > self._setting.envs * len(self._posts)
            left = len(self._waiting) + sum(len(p.trials) for p in self._posts)
            share = even_share(left, len(self._posts), self._setting.envs)
            room = max(0, share + plenty - len(post.trials))
            new, post.alone = [self._waiting.popleft() for _ in range(min(room, len(self._waiting)))], False
        post.trials += new
        while post.trials and len(post.calls) < _CALLS:
            post.calls.append(post.actor.turn.remote(tuple(new)))
            new = []

    def _take(self, post: _WorkerPlace, call: Any) -> Iterator[JournalEntry]:  # noqa: ANN401 -- a reference of Ray
        """Write what a call has brought, and yield its lines.

        Raises:
            WorkerError: If the worker cannot start.
            BetterError: If it says that the run has to stop.
        """
        if call not in post.calls:
            return  # of a worker that has died in the meantime
        errors = self._ray.exceptions
        try:
            found = self._ray.get(call)
        except errors.RayTaskError as error:  # it lives, and raised what it should not
            if not post.ready or isinstance(error.cause, BetterError):
                raise _meaning(error, "A worker on the cluster cannot start") from error
            yield from self._handle_exit(post, error)
            return
        except errors.RayError as error:  # it died, or what it answered was lost with its machine
            yield from self._handle_exit(post, error)
            return
        post.calls.remove(call)
        post.placed = True
        if isinstance(found, Turn):
            for scene, data in found.scenes.items():
                self._write(self._run.scene_path(scene), data, keep=True)
            for delivery in found.deliveries:
                entry = delivery.entry
                if delivery.record is not None:
                    place = self._run.record_path(entry.task, entry.condition, entry.seed)
                    self._write(place, delivery.record, keep=False)
                ended = [t for t in post.trials if TrialId(t.task, t.condition, t.seed) == entry.key]
                post.trials = [t for t in post.trials if t not in ended]
                post.broken += ended if entry.status == "error" else []
                self._deaths_in_a_row = 0
                yield entry
            if isinstance(found.problem, PolicyUnavailableError) and self._revive():
                return
            if found.problem is not None:
                raise found.problem
        elif isinstance(found, Mapping):
            self._accept(post, found)

    def _write(self, place: Path, data: bytes, *, keep: bool) -> None:
        if keep and place.exists():
            return
        with on_disk(self._run.path):
            write_durably(place, data)

    def _accept(self, post: _WorkerPlace, versions: Mapping[str, str]) -> None:
        """Compare the versions of a worker that is ready.

        Raises:
            InvalidInputError: If they differ from ours.
            BetterError: If it cannot work.
        """
        here = versions_here()
        other = {name: value for name, value in versions.items() if here.get(name, value) != value}
        if other:
            there = ", ".join(f"{name} {value} (here {here[name]})" for name, value in sorted(other.items()))
            raise InvalidInputError(
                "--engine ray", f"a machine of the cluster has {there}", "Install the same versions everywhere"
            )
        if "problem" in versions:
            raise WorkerError(f"A worker on the cluster cannot start: {versions['problem']}")
        post.ready = True

    def _handle_exit(self, post: _WorkerPlace, error: Exception) -> Iterator[JournalEntry]:
        """Replace a worker that is lost; its trials are done again, each alone, to find the one that is to blame."""
        logger.warning("a worker of the cluster died; %d trials go to others", len(post.trials))
        self._posts.remove(post)
        self._kill([post.actor])
        self._deaths_in_a_row += 1
        told = _reason(error)
        for trial in post.trials:
            self._deaths[trial] += 1
            if self._deaths[trial] >= MAX_DEATHS_OF_A_TRIAL:
                yield _broken(trial, f"its worker died {MAX_DEATHS_OF_A_TRIAL} times ({told})")
            else:
                self._suspects.append(trial)
        if self._deaths_in_a_row >= MAX_DEATHS_IN_A_ROW:
            raise WorkerError(
                f"{self._deaths_in_a_row} workers of the cluster died one after the other ({told}). {_AGAIN}"
            )
        if self._left:
            self._add_post(post.replica)

    def _start_replicas(self) -> None:
        """Start the replicas of the policy, and wait until they answer."""
        self._secrets = {_KEY_NAME: secrets.token_hex(24)}
        self._replicas, self._addresses = self._new_replicas(self._cluster.replicas)

    def _new_replicas(self, count: int) -> tuple[list[Any], list[str]]:
        """Start some replicas of the policy, and return them with their addresses.

        Raises:
            InvalidInputError: If the cluster has no place for them.
            WorkerError: If one dies while it loads the policy, or cannot load it.
            BetterError: If the policy cannot be made there.
        """
        gpus = self._session.replica_gpus()
        remote = self._ray.remote(num_cpus=0, num_gpus=gpus, max_restarts=0, max_concurrency=2)(_Replica)
        replicas = [remote.remote(self._setting.policy) for _ in range(count)]
        try:
            placed = [r.__ray_ready__.remote() for r in replicas]
            started = [r.start.remote(self._secrets[_KEY_NAME], self._setting.policy_timeout_s) for r in replicas]
            self._wait_for_places(placed, gpus)
            return replicas, [self._address(call) for call in started]
        except BaseException:
            self._kill(replicas)
            raise

    def _wait_for_places(self, placed: Sequence[Any], gpus: float) -> None:
        """Wait until replicas have a place on the cluster; what they load there is waited for elsewhere.

        Raises:
            InvalidInputError: If the cluster has no place for them.
        """
        _, late = self._ray.wait(placed, num_returns=len(placed), timeout=PLACING_S)
        if late:
            raise InvalidInputError(
                "--replicas",
                f"{len(late)} of {len(placed)} replicas with {gpus:g} graphics cards each have no place "
                f"(free: {self._free()})",
                "Ask for fewer, or for a part of a card with --replica-gpus",
            )

    def _address(self, started: Any) -> str:  # noqa: ANN401 -- a reference of Ray
        """Wait until a replica has loaded the policy, however long that takes, and return where workers ask it."""
        errors = self._ray.exceptions
        try:
            address, problem = self._ray.get(started)
        except errors.RayTaskError as error:
            raise _meaning(error, f"A replica cannot load {self._setting.policy}") from error
        except errors.RayError as error:
            raise WorkerError(
                f"A replica died while it loaded {self._setting.policy} ({_reason(error)}). {_AGAIN}"
            ) from error
        if problem is not None:
            raise problem
        limit = self._setting.policy_timeout_s
        asked = address_within(address, timeout_s=limit, patience_s=_REPLICA_PATIENCE_S)
        return f"{asked}&api_key_env={_KEY_NAME}"

    def _revive(self) -> bool:
        """Replace the replicas that have died, with the workers that asked them; False if none has."""
        dead = [number for number, replica in enumerate(self._replicas) if not self._answers(replica)]
        self._revivals += len(dead)
        if not dead or self._revivals > MAX_REVIVALS:
            return False
        logger.warning("replicas of the policy died and are replaced: %d", len(dead))
        self._kill(self._replicas[number] for number in dead)
        for number, replica, address in zip(dead, *self._new_replicas(len(dead)), strict=True):
            self._replicas[number], self._addresses[number] = replica, address
        for post in [p for p in self._posts if p.replica in dead]:
            self._posts.remove(post)
            self._kill([post.actor])
            self._waiting.extendleft([*post.trials, *post.broken])
            self._add_post(post.replica)
        return True

    def _answers(self, replica: Any) -> bool:  # noqa: ANN401 -- a handle of Ray
        """Tell whether a replica is alive."""
        try:
            return bool(self._ray.get(replica.is_up.remote(), timeout=_FAREWELL_S))
        except _errors_of(self._ray):
            return False

    def _free(self) -> str:
        free = self._ray.available_resources()
        return ", ".join(f"{name} {free[name]:g}" for name in ("CPU", "GPU") if name in free) or "nothing"


class _Replica:
    """One copy of the policy behind the openpi protocol, on the address of its machine; callers need the key."""

    def __init__(self, policy: str) -> None:
        self._policy = policy
        self._server: PolicyServer | None = None

    def is_up(self) -> bool:
        """Tell whether it serves."""
        return self._server is not None

    def start(self, key: str, limit_s: float) -> tuple[str, BetterError | None]:
        """Serve, and return the address, or what prevents it; an answer may take limit_s [s]."""
        node: str = importlib.import_module("ray").util.get_node_ip_address()
        try:
            self._server = open_server(
                self._policy, host=node, port=0, api_key=key, deadline=Deadline(limit_s, leave_hanging)
            )
        except BetterError as error:
            return "", error
        self._server.start()
        return self._server.address, None


def _broken(trial: Trial, reason: str) -> JournalEntry:
    message = f"{reason}; run the same command again, with fewer workers on a machine or fewer --envs"
    return JournalEntry(trial.task, trial.condition, trial.variation, trial.seed, "error", message)
