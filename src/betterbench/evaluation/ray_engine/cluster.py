"""Address and resources of a run on a Ray cluster. Importing this module does not import Ray."""

from __future__ import annotations

import importlib.util
import os
import socket
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.installation import missing_extra

PLACING_S = 300.0
"""Maximum time to wait for free cluster resources for the first worker or the replicas [s], without loading."""

_CONNECT_S = 10.0


@dataclass(frozen=True, slots=True)
class Cluster:
    """Address of a Ray cluster, with the number of policy replicas and their GPUs.

    Attributes:
        address: Address of the cluster. If None, RAY_ADDRESS is used, or a new cluster on this machine if it is not
            set.
        replicas: Number of copies of a policy that runs in a process (a checkpoint, or a policy that supports batches).
        replica_gpus: GPUs per replica. If None, it is 1 if the cluster has GPUs, otherwise 0.
    """

    address: str | None = None
    replicas: int = 1
    replica_gpus: float | None = None

    @property
    def given(self) -> str | None:
        """Address of the cluster, by default from the environment, or None if there is none."""
        return self.address or os.environ.get("RAY_ADDRESS") or None

    def __post_init__(self) -> None:
        """Raise InvalidInputError if a number is out of range."""
        if not 1 <= self.replicas <= 256:
            raise InvalidInputError("--replicas", f"{self.replicas} is out of range", "Give a number from 1 to 256")
        if self.replica_gpus is not None and not 0.0 <= self.replica_gpus <= 64.0:
            raise InvalidInputError(
                "--replica-gpus", f"{self.replica_gpus:g} is out of range", "Give a number from 0 to 64"
            )


def require_ray(cluster: Cluster) -> None:
    """Check, without importing Ray, that Ray is installed and that the cluster address accepts connections.

    Ray itself would try to connect to an unused address for minutes.
    """
    if importlib.util.find_spec("ray") is None:
        raise missing_extra("--engine ray: Ray is not installed", "ray")
    address = cluster.given or "local"
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        return  # names such as "auto" and "local" are resolved by Ray
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_S).close()
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InvalidInputError(
            "--ray-address", f"no Ray cluster at {address} ({reason})", "Start a cluster there with `ray start --head`"
        ) from None


ANYWHERE = Cluster()
"""Default cluster: RAY_ADDRESS, or a new cluster on this machine."""
