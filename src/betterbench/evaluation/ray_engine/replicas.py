"""Replicas: actors on a Ray cluster, each of which serves a copy of the policy to the workers of a run."""

from __future__ import annotations

import importlib
import logging
import secrets
from collections.abc import Mapping, Sequence
from typing import Any

from betterbench.errors import BetterError, InvalidInputError, WorkerError
from betterbench.evaluation.ray_engine.cluster import PLACING_S
from betterbench.evaluation.ray_engine.session import (
    TRY_AGAIN,
    RaySession,
    as_better_error,
    first_line,
    kill,
    loss_errors,
)
from betterbench.evaluation.serving.host import exit_hung, run_address
from betterbench.evaluation.serving.server import open_server
from betterbench.evaluation.trials.shared_policy import Deadline
from betterbench.evaluation.trials.trial import WorkerSettings
from betterbench.policies.serving.server import PolicyServer

logger = logging.getLogger(__name__)

MAX_REPLACEMENTS = 5
"""Maximum number of replicas that are replaced in a run. After that, the death of a replica stops the run."""

_CHECK_S = 3.0
_PATIENCE_S = 10.0
_KEY_NAME = "BETTERBENCH_REPLICA_KEY"


class Replicas:
    """Replicas of the policy of a run.

    Attributes:
        addresses: Policy addresses of the replicas.
        environment: Environment variables that a worker needs to connect to the replicas.
    """

    def __init__(self, session: RaySession, settings: WorkerSettings) -> None:
        """Store the settings. The replicas are started by :meth:`start`."""
        self._session, self._settings = session, settings
        self._actors: list[Any] = []
        self._replaced = 0
        self.addresses: list[str] = []
        self.environment: Mapping[str, str] = {}

    def start(self) -> None:
        """Start all replicas and wait until they answer."""
        self.environment = {_KEY_NAME: secrets.token_hex(24)}
        self._actors, self.addresses = self._started(self._session.cluster.replicas)

    def replace_dead(self) -> list[int]:
        """Replace the replicas that have died, and return their indices.

        The list is empty if all replicas are alive, or if too many have died.
        """
        dead = [number for number, actor in enumerate(self._actors) if not self._answers(actor)]
        self._replaced += len(dead)
        if not dead or self._replaced > MAX_REPLACEMENTS:
            return []
        logger.warning("replicas of the policy died and are replaced: %d", len(dead))
        kill(self._session.ray, [self._actors[number] for number in dead])
        for number, actor, address in zip(dead, *self._started(len(dead)), strict=True):
            self._actors[number], self.addresses[number] = actor, address
        return dead

    def close(self) -> None:
        """End all replicas."""
        actors, self._actors = self._actors, []
        kill(self._session.ray, actors)

    def _started(self, count: int) -> tuple[list[Any], list[str]]:
        """Start the given number of replicas. Return the replicas and their addresses."""
        ray, gpus = self._session.ray, self._session.replica_gpus()
        remote = ray.remote(num_cpus=0, num_gpus=gpus, max_restarts=0, max_concurrency=2)(_Replica)
        actors = [remote.remote(self._settings.policy) for _ in range(count)]
        try:
            placed = [actor.__ray_ready__.remote() for actor in actors]
            key = self.environment[_KEY_NAME]
            starting = [actor.start.remote(key, self._settings.policy_timeout_s) for actor in actors]
            self._wait_for_places(placed, gpus)
            return actors, [self._address(call) for call in starting]
        except BaseException:
            kill(ray, actors)
            raise

    def _wait_for_places(self, placed: Sequence[Any], gpus: float) -> None:
        """Wait until the cluster has allocated resources to all replicas. The replicas load the policy after that."""
        _, late = self._session.ray.wait(placed, num_returns=len(placed), timeout=PLACING_S)
        if late:
            raise InvalidInputError(
                "--replicas",
                f"no free resources for {len(late)} of {len(placed)} replicas with {gpus:g} GPUs each "
                f"(free: {self._session.free_text()})",
                "Reduce --replicas, or give each replica only a fraction of a GPU with --replica-gpus",
            )

    def _address(self, starting: Any) -> str:  # noqa: ANN401 -- a reference of Ray
        """Wait until a replica has loaded the policy, without a time limit. Return the replica's address."""
        ray, policy = self._session.ray, self._settings.policy
        try:
            address, problem = ray.get(starting)
        except ray.exceptions.RayTaskError as error:
            raise as_better_error(error, f"A replica cannot load {policy}") from error
        except ray.exceptions.RayError as error:
            raise WorkerError(f"A replica died while it loaded {policy} ({first_line(error)}). {TRY_AGAIN}") from error
        if problem is not None:
            raise problem
        asked = run_address(address, timeout_s=self._settings.policy_timeout_s, patience_s=_PATIENCE_S)
        return f"{asked}&api_key_env={_KEY_NAME}"

    def _answers(self, actor: Any) -> bool:  # noqa: ANN401 -- a handle of Ray
        try:
            return bool(self._session.ray.get(actor.is_up.remote(), timeout=_CHECK_S))
        except loss_errors(self._session.ray):
            return False


class _Replica:
    """Copy of the policy on a Ray cluster. It is served with openpi's protocol on the network address of its machine.

    Clients must send the API key.
    """

    def __init__(self, policy: str) -> None:
        self._policy = policy
        self._server: PolicyServer | None = None

    def is_up(self) -> bool:
        """Return whether the replica serves the policy."""
        return self._server is not None

    def start(self, key: str, limit_s: float) -> tuple[str, BetterError | None]:
        """Serve the policy. Return the address, or an error if serving fails.

        ``limit_s`` is the maximum time for a reply [s].
        """
        node: str = importlib.import_module("ray").util.get_node_ip_address()
        try:
            self._server = open_server(
                self._policy, host=node, port=0, api_key=key, deadline=Deadline(limit_s, exit_hung)
            )
        except BetterError as error:
            return "", error
        self._server.start()
        return self._server.address, None
