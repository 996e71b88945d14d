"""Address and resources of a run on a Ray cluster. Importing this module does not import Ray."""

from __future__ import annotations

import importlib.util
import os
import socket
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.installation import missing_extra

PLACING_S = 300.0
"""Maximum time to wait until the cluster has free resources for the first worker or for the replicas [s].

The time for loading the policy is not included.
"""

_CONNECT_S = 10.0


@dataclass(frozen=True, slots=True)
class Cluster:
    """Address of a Ray cluster, and the number of policy replicas with their GPUs.

    Attributes:
        address: Address of the cluster. If None, the environment variable RAY_ADDRESS is used. If this variable is not
            set, a new cluster is started on this machine.
        replicas: Number of copies of the policy. Only policies with large weights or with support for batches have
            replicas.
        replica_gpus: Number of GPUs per replica. If None, it is 1 if the cluster has GPUs, and 0 otherwise.
    """

    address: str | None = None
    replicas: int = 1
    replica_gpus: float | None = None

    @property
    def given(self) -> str | None:
        """Address of the cluster from the settings, else from the environment variable RAY_ADDRESS, else None."""
        return self.address or os.environ.get("RAY_ADDRESS") or None

    def __post_init__(self) -> None:
        """Raise InvalidInputError if a number is out of range."""
        if not 1 <= self.replicas <= 256:
            raise InvalidInputError("--replicas", f"{self.replicas} is out of range", "Use a number from 1 to 256")
        if self.replica_gpus is not None and not 0.0 <= self.replica_gpus <= 64.0:
            raise InvalidInputError(
                "--replica-gpus", f"{self.replica_gpus:g} is out of range", "Use a number from 0 to 64"
            )


def require_ray(cluster: Cluster) -> None:
    """Check that Ray is installed and that the cluster's address accepts connections, without importing Ray.

    If no cluster is running at the address, this check fails at once. Ray itself would try to connect for minutes.
    """
    if importlib.util.find_spec("ray") is None:
        raise missing_extra("--engine ray: Ray is not installed", "ray")
    address = cluster.given or "local"
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        return  # Ray resolves names such as "auto" and "local"
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_S).close()
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InvalidInputError(
            "--ray-address", f"no Ray cluster at {address} ({reason})", "Start a cluster there with `ray start --head`"
        ) from None


ANYWHERE = Cluster()
"""Default cluster: the cluster at RAY_ADDRESS or, if this variable is not set, a new cluster on this machine."""
