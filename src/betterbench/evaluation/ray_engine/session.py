"""Connection to a Ray cluster, and conversion of Ray's errors to one-line errors."""

from __future__ import annotations

import importlib
import logging
import os
from typing import Any, Self

from betterbench.errors import BetterError, InvalidInputError, WorkerError
from betterbench.evaluation.ray_engine.cluster import Cluster

TRY_AGAIN = "See Ray's logs, then run the same command again to resume the run."

_OBJECT_STORE_BYTES = 128 * 1024 * 1024


def import_ray() -> Any:  # noqa: ANN401 -- a module without types
    """Import Ray. Usage statistics are turned off."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    return importlib.import_module("ray")


def loss_errors(ray: Any) -> tuple[type[Exception], ...]:  # noqa: ANN401 -- a module without types
    """Return the exceptions that Ray raises if the connection to the cluster, or a part of the cluster, is lost."""
    return ray.exceptions.RayError, ConnectionError


def first_line(error: Exception) -> str:
    """Return the first line of one of Ray's error messages, without the traceback."""
    cause = getattr(error, "cause", None)
    text = str(error) if cause is None else f"{type(cause).__name__}: {cause}"
    return (text.splitlines() or [type(error).__name__])[0][:200].rstrip(".: ")


def cluster_lost(error: Exception) -> WorkerError:
    """Return the error for a cluster that no longer responds."""
    return WorkerError(f"The Ray cluster no longer answers ({first_line(error)}). {TRY_AGAIN}")


def as_better_error(error: Any, what: str) -> BetterError:  # noqa: ANN401 -- an error of Ray
    """Convert an exception from the cluster to an error of betterbench.

    An error of betterbench that was raised on the cluster is returned unchanged. Other exceptions are summarized in one
    line.
    """
    if isinstance(error.cause, BetterError):
        return error.cause
    return WorkerError(f"{what}: {first_line(error)}. {TRY_AGAIN}")


class RaySession:
    """Connection to a Ray cluster for the duration of a run. If no address is given, a local cluster is started.

    Use it as a context manager.
    """

    def __init__(self, cluster: Cluster, workers: int | None) -> None:
        """Store the settings. By default, the number of workers equals the number of CPU cores in the cluster."""
        self.cluster, self.ray = cluster, import_ray()
        self._workers = workers
        self._owned = False

    def __enter__(self) -> Self:
        """Connect to the cluster, or start one. Raises InvalidInputError if the cluster cannot be reached."""
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
            ray.shutdown()  # Ray may have started some processes before the error
            if not isinstance(error, Exception):
                raise  # Ctrl-C or an exit of the process
            where = address or "this machine"
            raise InvalidInputError(
                "--ray-address", f"no Ray cluster at {where} ({first_line(error)})", "Start a cluster with `ray start`"
            ) from error
        self._owned = True
        return self

    def __exit__(self, *_: object) -> None:
        if self._owned:
            self.ray.shutdown()

    @property
    def workers(self) -> int:
        """Number of workers: the requested number or, by default, the number of CPU cores in the cluster."""
        return self._workers or max(1, int(self._total("CPU")))

    def replica_gpus(self) -> float:
        """Return the number of GPUs that each replica of the policy gets."""
        asked = self.cluster.replica_gpus
        if asked is not None:
            return asked
        return 1.0 if self._total("GPU") >= self.cluster.replicas else 0.0

    def free_text(self) -> str:
        """Describe the free resources of the cluster, for use in messages."""
        free = self.ray.available_resources()
        return ", ".join(f"{name} {free[name]:g}" for name in ("CPU", "GPU") if name in free) or "nothing"

    def _total(self, resource: str) -> float:
        """Return the total amount of a resource in the cluster, including the part that is in use."""
        try:
            return float(self.ray.cluster_resources().get(resource, 0.0))
        except loss_errors(self.ray) as error:
            raise cluster_lost(error) from error


def kill(ray: Any, actors: Any) -> None:  # noqa: ANN401 -- a module without types and its handles
    """End actors. Actors that have already ended are skipped."""
    for actor in actors:
        try:
            ray.kill(actor)
        except loss_errors(ray):
            continue
