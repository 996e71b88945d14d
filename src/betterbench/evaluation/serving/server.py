"""Policy server with openpi's protocol, for the workers of a run and for other clients."""

from __future__ import annotations

import importlib.metadata
import logging
import platform
import threading
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from betterbench.errors import InvalidInputError
from betterbench.evaluation.serving.memory import return_memory
from betterbench.evaluation.serving.sessions import PolicySession
from betterbench.evaluation.trials.shared_policy import Deadline, SharedPolicy
from betterbench.interface import BatchPolicy, Execution, Policy
from betterbench.interface.actions import CONTROL_RATE_HZ, USUAL_ROBOT, ActionSpace, action_space
from betterbench.policies.batching import MAX_BATCH
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.handshake import PROTOCOL
from betterbench.policies.conventions.presets import NATIVE, own_preset
from betterbench.policies.kinds import kind_of, make_policy, needs_of
from betterbench.policies.process.policy_process import start_policy
from betterbench.policies.serving.server import DEFAULT_PORT, LOOPBACK, MAX_CLIENTS, PolicyServer
from betterbench.version import __version__

if TYPE_CHECKING:  # not imported at run time, so that the host process does not import the tasks
    from betterbench.tasks import TrialId

logger = logging.getLogger(__name__)

WHOLE_CHUNKS = Execution()
DEFAULT_CHUNK = 8
"""Number of actions in a reply of an expert. openpi's single-arm policies send 5 to 16, at 10 to 20 Hz."""
MAX_CHUNK = 256
MOST_CLIENTS = 10_000
KEPT_INSTANCES = 1
"""Number of unused policy instances that are kept for new clients."""
_CLOSE_S = 5.0
NEW_EPISODE = "a new episode is a new connection, another prompt, or better/step 0"
"""Rule for detecting the start of an episode, because openpi's protocol has no message for it."""


def open_server(
    policy: str,
    *,
    host: str = LOOPBACK,
    port: int = DEFAULT_PORT,
    chunk: int = DEFAULT_CHUNK,
    batch: int = MAX_BATCH,
    clients: int = MAX_CLIENTS,
    trial: TrialId | None = None,
    robot: str = USUAL_ROBOT,
    layout: str | None = None,
    api_key: str | None = None,
    made: Policy | None = None,
    deadline: Deadline | None = None,
) -> PolicyServer:
    """Create a policy server. It binds its port immediately, and accepts requests after ``start`` has been called.

    Args:
        policy: Address of the policy.
        host: Interface to listen on.
        port: Port to listen on. 0 selects any free port.
        chunk: Number of actions in a reply of an expert.
        batch: Maximum number of observations in one call of a policy that supports batches.
        clients: Maximum number of simultaneous clients. Workers of a run do not count as clients.
        trial: Trial for clients that do not name a trial. If None, the server of an expert determines the trial from
            the instruction.
        robot: Robot that the clients of an expert use.
        layout: Preset that describes the requests to an expert and the replies. If None, clients may use the native
            layout and openpi's LIBERO layout.
        api_key: Key that clients must send, or None.
        made: Policy instance to serve. The server closes it. If None, the server creates an instance.
        deadline: Deadline for replies if the clients are workers of a run, or else None.

    Raises:
        InvalidInputError: If an option is out of range, if the policy cannot be served, if a checkpoint is missing or
            damaged, or if the port is not available.
        UnknownNameError: If the policy, task, condition or preset does not exist.
    """
    if not 1 <= chunk <= MAX_CHUNK:
        raise InvalidInputError("--chunk", f"{chunk} is out of range", f"Use a number from 1 to {MAX_CHUNK}")
    if not 1 <= batch <= 1024:
        raise InvalidInputError("--batch", f"{batch} is out of range", "Use a number from 1 to 1024")
    if not 1 <= clients <= MOST_CLIENTS:
        raise InvalidInputError("--clients", f"{clients} is out of range", f"Use a number from 1 to {MOST_CLIENTS}")
    kind = kind_of(policy)
    needs = kind.needs_of(policy)
    if needs.trial:
        raise InvalidInputError(
            f"policy {policy}",
            "a replay policy belongs to one trial, so it cannot be served",
            "Evaluate it with better eval",
        )
    if trial is not None:
        from betterbench.tasks.interventions import resolve_condition  # noqa: PLC0415 - a run's host needs no tasks

        resolve_condition(trial.task, trial.condition)
    if layout is not None and not needs.state:
        raise InvalidInputError(
            "--layout",
            f"{policy} is not an expert, so it supports only the layouts native and openpi_libero",
            "Omit --layout",
        )
    kind.info_of(kind.parse(policy))  # report a missing checkpoint now instead of to the first client
    if needs.state:
        # Imported here because it imports MuJoCo, which only an expert needs.
        from betterbench.evaluation.serving.shadow import ShadowSimulations  # noqa: PLC0415
        from betterbench.evaluation.serving.shadow_sessions import ShadowSession, require_layout  # noqa: PLC0415

        shadows = ShadowSimulations(policy, robot=robot)
        adapter = None if layout in (None, NATIVE.name) else own_preset(str(layout))
        if adapter is not None:
            require_layout(adapter, robot, shadows.action_space)
        return PolicyServer(
            lambda: ShadowSession(shadows, chunk, trial, adapter),
            metadata=_shadow_metadata(policy, chunk, trial, adapter, shadows.action_space),
            host=host,
            port=port,
            api_key=api_key,
            clients=clients,
        )
    store = SessionStore(policy, made or make_policy(policy), batch=batch, trial=trial, deadline=deadline)
    try:
        return PolicyServer(
            store.session,
            metadata=store.metadata,
            host=host,
            port=port,
            api_key=api_key,
            clients=clients if deadline is None else None,
            on_stop=store.close,
        )
    except BaseException:
        store.close()
        raise


def _shadow_metadata(
    policy: str, chunk: int, trial: TrialId | None, layout: Adapter | None, own_space: str
) -> dict[str, Any]:
    more = {
        "chunk": chunk,
        "trial": str(trial) if trial else "the first training condition whose instruction equals the prompt",
        "step": "without better/step, the executed part of a chunk is inferred from observation/state, otherwise the "
        "whole chunk",
        "episode": NEW_EPISODE,
    }
    space = action_space(own_space if layout is None else layout.answer.space)
    told = declare(policy, space, needs_images=False, batch=1, more=more, expert=True)
    if layout is not None:
        told["betterbench"] |= {"preset": layout.name, "layouts": [layout.name]}
    return told


class SessionStore:
    """Store of policy instances. If the policy supports batches, all connections share one instance.

    Otherwise, each connection has its own instance. When a connection ends, its instance is kept for the next
    connection, so that the weights need not be loaded again when a client reconnects. At most :data:`KEPT_INSTANCES`
    unused instances are kept. A new connection always begins with a reset of the policy.
    """

    def __init__(
        self, address: str, first: Policy, *, batch: int, trial: TrialId | None, deadline: Deadline | None = None
    ) -> None:
        """Store the first instance of the policy. ``deadline`` is given only if the clients are workers of a run."""
        self._address, self._trial, self._deadline = address, trial, deadline
        self._shares = isinstance(first, BatchPolicy)
        self._batch = batch if self._shares else 1
        self._unused = [self._guarded(first)]
        self._lock, self._closed = threading.Lock(), False
        info = first.info
        if info.heavy and not self._shares:
            logger.warning("%s does not support batches: every client gets an instance with its own weights", address)
        self.metadata = declare(
            address,
            action_space(info.action_space),
            needs_images=info.needs_images,
            batch=self._batch,
            execution=info.execution,
            cameras=info.cameras,
            more={**info.metadata, "episode": NEW_EPISODE, "within": deadline is not None},
        )

    def session(self) -> PolicySession:
        """Return a session for a new connection."""
        within = self._deadline is not None
        if self._shares:
            return PolicySession(self._unused[0].seat(), self._trial, within=within)
        with self._lock:
            policy = self._unused.pop() if self._unused else None
        if policy is None:
            apart = self._deadline is not None and needs_of(self._address).process
            policy = self._guarded(start_policy(self._address) if apart else make_policy(self._address))
        return PolicySession(policy.seat(), self._trial, within=within, on_close=lambda: self._take_back(policy))

    def _guarded(self, policy: Policy) -> SharedPolicy:
        return SharedPolicy(policy, self._batch, deadline=self._deadline)

    def _take_back(self, policy: SharedPolicy) -> None:
        with self._lock:
            if not self._closed and len(self._unused) < KEPT_INSTANCES:
                self._unused.append(policy)
                return
        policy.close(timeout_s=_CLOSE_S)
        return_memory()

    def close(self) -> None:
        """Close the unused instances. The other instances are closed when their sessions end."""
        with self._lock:
            self._closed, unused = True, list(self._unused)
            self._unused = unused if self._shares else []
        for policy in unused:
            policy.close(timeout_s=_CLOSE_S)


def declare(
    policy: str,
    space: ActionSpace,
    *,
    needs_images: bool,
    batch: int,
    more: Mapping[str, object],
    execution: Execution = WHOLE_CHUNKS,
    cameras: tuple[str, ...] | None = None,
    expert: bool = False,
) -> dict[str, Any]:
    """Return the metadata that the server sends to each client when it connects.

    Args:
        policy: Address of the policy.
        space: Action space of the policy.
        needs_images: Whether the policy uses images.
        batch: Maximum number of observations in one call of the policy.
        more: Further facts for clients.
        execution: Execution settings for action chunks.
        cameras: Cameras that the policy uses, or None for all cameras.
        expert: Whether the policy is an expert. For an expert, the server simulates the client's trial, and
            betterbench's own clients name the trial in their requests.
    """
    return {
        "betterbench": {
            **more,  # these facts come first, so that they cannot override conventions
            "protocol": PROTOCOL,
            "preset": "native",
            "layouts": ["native", "openpi_libero"],
            "policy": policy,
            "expert": expert,
            "action_space": space.to_json(),
            "needs_images": needs_images,
            "cameras": {},
            **({} if cameras is None else {"looks_at": list(cameras)}),
            "control_rate_hz": CONTROL_RATE_HZ,
            "batch": batch,
            "execution": asdict(execution),
            "version": __version__,
            "engine": f"mujoco {importlib.metadata.version('mujoco')}",  # takes 2 ms; importing MuJoCo takes 200 ms
            "machine": platform.machine(),
        }
    }
