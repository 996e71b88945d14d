"""The same run on a Ray cluster: workers and replicas of the policy are actors, the journal stays the only truth.

No file system is shared. Workers send finished records to the process that drives the run, which alone writes; a worker
that dies takes nothing along but the trials it was at, and others do them again.
"""

from __future__ import annotations

import importlib
import logging
import os
import secrets
import time
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from betterbench.errors import BetterError, InvalidInputError, PolicyUnavailableError, WorkerError
from betterbench.evaluation.cluster import Cluster, Outpost, Turn, versions_here
from betterbench.evaluation.host import address_within
from betterbench.evaluation.plan import Trial
from betterbench.evaluation.serving import open_server
from betterbench.evaluation.trial import Setting, on_disk
from betterbench.evaluation.worker import even_share
from betterbench.policies.server import PolicyServer
from betterbench.recording import JournalEntry, RunFolder, write_durably

logger = logging.getLogger(__name__)

PLACING_S = 300.0
"""How long is waited until the cluster has a place for the first worker [s]."""

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


def ray_entries(
    session: RaySession,
    run: RunFolder,
    setting: Setting,
    trials: Sequence[Trial],
    *,
    served: bool = False,
) -> Iterator[JournalEntry]:
    """Run trials on a Ray cluster and yield the line of each for the journal, after its record is written.

    Args:
        session: The cluster.
        run: The run; only this process writes to it.
        setting: What all trials of the run share.
        trials: The trials.
        served: Whether the policy is held by replicas, of which the workers are clients.

    Raises:
        InvalidInputError: If the cluster has no place, or has other versions.
        BetterError: What stops a run: a broken premise, a full disk, a policy that cannot be reached.
    """
    pool = _Pool(session, run, setting, trials)
    try:
        yield from pool.entries(served=served)
    finally:
        pool.close()


def _import_ray() -> Any:  # noqa: ANN401 -- a module without types
    """Return Ray, told to send nothing about its use."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    return importlib.import_module("ray")


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
        except Exception as error:
            ray.shutdown()  # Ray raises all sorts of errors, and may have started half of its processes
            told = (str(error).splitlines() or [type(error).__name__])[0][:200].rstrip(".")
            raise InvalidInputError(
                "--ray-address", f"no Ray cluster at {address or 'this machine'} ({told})", "Start one with `ray start`"
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
        return self._workers or max(1, int(self.ray.cluster_resources().get("CPU", 1)))

    def replica_gpus(self) -> float:
        """Graphics cards of each replica of the policy."""
        asked = self.cluster.replica_gpus
        if asked is not None:
            return asked
        return 1.0 if self.ray.cluster_resources().get("GPU", 0.0) >= self.cluster.replicas else 0.0


@dataclass(slots=True, eq=False)
class _Post:
    """A worker as the driver sees it.

    Attributes:
        actor: Handle of the actor.
        calls: Calls under way, the oldest first.
        trials: Trials that it was given and that have not ended.
        ready: Whether it has been prepared.
        alone: Whether its one trial was with a worker that died.
        replica: Number of the replica of the policy that it asks, or None.
        broken: Trials of its that have broken down.
    """

    actor: Any
    calls: deque[Any]
    trials: list[Trial] = field(default_factory=list)
    ready: bool = False
    alone: bool = False
    replica: int | None = None
    broken: list[Trial] = field(default_factory=list)


class _Pool:
    """The workers of a run, and what is left to do."""

    def __init__(self, session: RaySession, run: RunFolder, setting: Setting, trials: Sequence[Trial]) -> None:
        self._ray, self._session, self._run = session.ray, session, run
        self._setting, self._cluster = setting, session.cluster
        self._waiting = deque(trials)
        self._suspects: deque[Trial] = deque()
        self._posts: list[_Post] = []
        self._replicas: list[Any] = []
        self._addresses: list[str] = []
        self._secrets: dict[str, str] = {}
        self._deaths: Counter[Trial] = Counter()
        self._deaths_in_a_row = 0
        self._made = 0
        self._revivals = 0

    def entries(self, *, served: bool) -> Iterator[JournalEntry]:
        """Yield the lines of all trials as they end."""
        if served:
            self._start_replicas()
        for _ in range(min(self._session.workers, len(self._waiting))):
            self._add_post()
        began = time.monotonic()
        while self._left:
            for post in self._posts:
                self._feed(post)
            calls = {call: post for post in self._posts for call in post.calls}
            done, _ = self._ray.wait(list(calls), num_returns=1, timeout=5.0)
            for call in done:
                yield from self._take(calls[call], call)
            if not any(post.ready for post in self._posts) and time.monotonic() - began > PLACING_S:
                raise InvalidInputError(
                    "--engine ray",
                    f"the cluster has no place for a worker of one processor (free: {self._free()})",
                    "Wait until other work is done, or add machines",
                )

    def close(self) -> None:
        """End all actors; what they were at is done again by the same command."""
        farewells = [post.actor.close.remote() for post in self._posts if post.ready]
        if farewells:
            self._ray.wait(farewells, num_returns=len(farewells), timeout=_FAREWELL_S)
        for post in self._posts:
            self._ray.kill(post.actor)
        for replica in self._replicas:
            self._ray.kill(replica)
        self._posts, self._replicas = [], []

    @property
    def _left(self) -> bool:
        """Whether anything is left to do."""
        return bool(self._waiting or self._suspects or any(post.trials for post in self._posts))

    def _add_post(self, replica: int | None = None) -> None:
        """Add a worker; where the policy has replicas it asks the one of that number, or the next in turn."""
        setting = self._setting
        if self._addresses:
            replica = self._made % len(self._addresses) if replica is None else replica
            setting = replace(setting, served_at=self._addresses[replica])
        self._made += 1
        known = [path.stem for path in sorted((self._run.path / "scenes").glob(f"*{_SCENE_ENDING}"))]
        description = (self._run.path / "run.json").read_bytes()
        # An actor whose process has died is replaced by us: only we know what it was at.
        remote = self._ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(Outpost)
        actor = remote.remote(setting, description, known)
        self._posts.append(_Post(actor, deque([actor.prepare.remote(self._secrets)]), replica=replica))

    def _feed(self, post: _Post) -> None:
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

    def _take(self, post: _Post, call: Any) -> Iterator[JournalEntry]:  # noqa: ANN401 -- a reference of Ray
        """Write what a call has brought, and yield its lines."""
        if call not in post.calls:
            return  # of a worker that has died in the meantime
        errors = self._ray.exceptions
        try:
            found = self._ray.get(call)
        except (
            errors.RayActorError,
            errors.WorkerCrashedError,
            errors.OutOfMemoryError,
            errors.NodeDiedError,
        ) as error:
            yield from self._bury(post, error)
            return
        post.calls.remove(call)
        if isinstance(found, Turn):
            for scene, data in found.scenes.items():
                self._write(self._run.scene_path(scene), data, keep=True)
            for delivery in found.deliveries:
                entry = delivery.entry
                if delivery.record is not None:
                    place = self._run.record_path(entry.task, entry.condition, entry.seed)
                    self._write(place, delivery.record, keep=False)
                ended = [t for t in post.trials if (t.task, t.condition, t.seed) == entry.key]
                post.trials = [t for t in post.trials if t not in ended]
                post.broken += ended if entry.status == "error" else []
                self._deaths_in_a_row = 0
                yield entry
            if isinstance(found.problem, PolicyUnavailableError) and self._revive():
                return
            if found.problem is not None:
                raise found.problem
        else:
            self._welcome(post, found)

    def _write(self, place: Path, data: bytes, *, keep: bool) -> None:
        if keep and place.exists():
            return
        with on_disk(self._run.path):
            write_durably(place, data)

    def _welcome(self, post: _Post, versions: Mapping[str, str]) -> None:
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

    def _bury(self, post: _Post, error: Exception) -> Iterator[JournalEntry]:
        """Replace a worker that has died; its trials are done again, each alone, to find the one that is to blame."""
        logger.warning("a worker of the cluster died; %d trials go to others", len(post.trials))
        self._posts.remove(post)
        self._ray.kill(post.actor)
        self._deaths_in_a_row += 1
        told = (str(error).splitlines() or [type(error).__name__])[0][:200]
        for trial in post.trials:
            self._deaths[trial] += 1
            if self._deaths[trial] >= MAX_DEATHS_OF_A_TRIAL:
                yield _broken(trial, f"its worker died {MAX_DEATHS_OF_A_TRIAL} times ({told})")
            else:
                self._suspects.append(trial)
        if self._deaths_in_a_row >= MAX_DEATHS_IN_A_ROW:
            raise WorkerError(
                f"{self._deaths_in_a_row} workers of the cluster died one after the other ({told}). "
                "Look at Ray's logs, then run the same command again: it goes on where it stopped."
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
            BetterError: If the policy cannot be made there.
        """
        gpus = self._session.replica_gpus()
        remote = self._ray.remote(num_cpus=0, num_gpus=gpus, max_restarts=0, max_concurrency=2)(_Replica)
        replicas = [remote.remote(self._setting.policy) for _ in range(count)]
        started = [r.start.remote(self._secrets[_KEY_NAME]) for r in replicas]
        _, late = self._ray.wait(started, num_returns=count, timeout=PLACING_S)
        if late:
            for replica in replicas:
                self._ray.kill(replica)
            raise InvalidInputError(
                "--replicas",
                f"{len(late)} of {count} replicas with {gpus:g} graphics cards each have no place "
                f"(free: {self._free()})",
                "Ask for fewer, or for a part of a card with --replica-gpus",
            )
        addresses = []
        for address, problem in self._ray.get(started):
            if problem is not None:
                raise problem
            limit = self._setting.policy_timeout_s
            asked = address_within(address, timeout_s=limit, patience_s=_REPLICA_PATIENCE_S)
            addresses.append(f"{asked}&api_key_env={_KEY_NAME}")
        return replicas, addresses

    def _revive(self) -> bool:
        """Replace the replicas that have died, with the workers that asked them; False if none has."""
        dead = [number for number, replica in enumerate(self._replicas) if not self._answers(replica)]
        self._revivals += len(dead)
        if not dead or self._revivals > MAX_REVIVALS:
            return False
        logger.warning("replicas of the policy died and are replaced: %d", len(dead))
        for number in dead:
            self._ray.kill(self._replicas[number])
        for number, replica, address in zip(dead, *self._new_replicas(len(dead)), strict=True):
            self._replicas[number], self._addresses[number] = replica, address
        for post in [p for p in self._posts if p.replica in dead]:
            self._posts.remove(post)
            self._ray.kill(post.actor)
            self._waiting.extendleft([*post.trials, *post.broken])
            self._add_post(post.replica)
        return True

    def _answers(self, replica: Any) -> bool:  # noqa: ANN401 -- a handle of Ray
        """Tell whether a replica is alive."""
        errors = self._ray.exceptions
        try:
            return bool(self._ray.get(replica.is_up.remote(), timeout=_FAREWELL_S))
        except (errors.RayActorError, errors.WorkerCrashedError, errors.GetTimeoutError):
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

    def start(self, key: str) -> tuple[str, BetterError | None]:
        """Serve, and return the address, or what prevents it."""
        node: str = importlib.import_module("ray").util.get_node_ip_address()
        try:
            self._server = open_server(self._policy, host=node, port=0, api_key=key)
        except BetterError as error:
            return "", error
        self._server.start()
        return self._server.address, None


def _broken(trial: Trial, reason: str) -> JournalEntry:
    message = f"{reason}; run the same command again, with fewer workers on a machine or fewer --envs"
    return JournalEntry(trial.task, trial.condition, trial.variation, trial.seed, "error", message)
