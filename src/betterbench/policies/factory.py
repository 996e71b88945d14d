"""Creation of a worker's policy instances from a policy address."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Self

from betterbench.errors import HandshakeError, InvalidInputError
from betterbench.interface import BatchPolicy, Policy, PolicyInfo, observation_spec
from betterbench.interface.actions import CONTROL_RATE_HZ
from betterbench.interface.state import AnyPolicy
from betterbench.jobs.conflict import first_difference
from betterbench.policies.clients.connection import ConnectionLimits
from betterbench.policies.conventions.handshake import space_cure
from betterbench.policies.description import describe_policy
from betterbench.policies.kinds import find_kind, kind_of, make_for, make_policy
from betterbench.policies.kinds.kind import PlannedTrial, PolicyKind
from betterbench.policies.process.policy_process import LOAD_S, PolicyProcess, start_policy

if TYPE_CHECKING:  # so that the process of a policy does not import a simulator
    from betterbench.sim.worlds import TrialScene

SOURCE = "source file"
"""Metadata key for the name and the SHA-256 of the file that contains a Python policy."""


def check_policy(address: str, *, action_space: str | None = None, observation: str | None = None) -> PolicyInfo:
    """Return the description of a policy. This may contact a policy server.

    If the action space and the observation preset of a run are given, check that the policy supports them.

    Raises:
        UnknownNameError: If no policy has this address.
        InvalidInputError: If a plugin cannot be loaded, or if the policy uses a different action space than the run.
        RecordError: If the run whose actions are replayed does not exist.
        PolicyUnavailableError: If the server cannot be reached.
        HandshakeError: If the server declares different conventions than the client.
    """
    with PolicyFactory(address) as policies:
        return policies.check(action_space, observation)


def answer_limit_s(address: str, policy_timeout_s: float) -> float:
    """Return the maximum time that a policy may take for one answer [s].

    The address of a policy server determines this time. For all other policies, it is the time limit of the run,
    ``policy_timeout_s``. If the caller passed a policy object to the run, ``address`` is the name of the object.
    """
    kind = find_kind(address)
    if kind is None or not kind.needs_of(address).server:
        return policy_timeout_s
    return ConnectionLimits.of(kind.parse(address)).timeout_s


class PolicyFactory:
    """Factory for the policies of one worker.

    At the end of a ``with`` block, it closes an instance that was created but not taken.
    """

    def __init__(
        self,
        address: str,
        *,
        apart: bool = False,
        known: PolicyInfo | None = None,
        timeout_s: float | None = None,
        world: str = "",
        kind: PolicyKind | None = None,
    ) -> None:
        """Store the settings. Nothing is loaded and no server is contacted yet.

        Args:
            address: Address of the policy.
            apart: Whether a policy written by the user is loaded in a separate process.
            known: Description of the policy at the start of the run, which a policy server must still provide. By
                default, all instances must have the description of the first one.
            timeout_s: Maximum time for one answer [s]. Loading the policy may take ten times as long.
            world: Benchmark whose conventions apply, such as "libero" (``World.dialect``), or empty.
            kind: Policy kind. By default, the address determines it.

        Raises:
            UnknownNameError: If no policy has this address.
        """
        self.address = address
        self._kind = kind or kind_of(address)
        self.needs = self._kind.needs_of(address)
        self._world = world
        self._load_s = LOAD_S if timeout_s is None else 10.0 * timeout_s
        self._apart = apart and self.needs.process
        self._known = known
        self._made: Policy | None = None
        self._info: PolicyInfo | None = None
        self._takes_batches = False
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def info(self) -> PolicyInfo:
        """Description of the policy.

        If the policy must be created to know the description, it is created when this property is first read.

        Raises the errors of :func:`check_policy`.
        """
        if self._info is None:
            self._info = self._kind.info_of(self._kind.parse(self.address, world=self._world))
        if self._info is None:
            self._made = self._make()
            self._info, self._takes_batches = self._made.info, isinstance(self._made, BatchPolicy)
            source = self._source()
            if source:  # part of the description, to detect a changed file when a run is resumed
                self._info = replace(self._info, metadata={**self._info.metadata, SOURCE: source})
        return self._info

    @property
    def takes_batches(self) -> bool:
        """Whether one instance can answer the observations of many environments in one call.

        Reading this property creates the policy.
        """
        return bool(self.info) and self._takes_batches

    def check(
        self, action_space: str | None = None, observation: str | None = None, *, rate_hz: float = CONTROL_RATE_HZ
    ) -> PolicyInfo:
        """Check that the policy fits a run, as :func:`check_policy` does, and return :attr:`info`.

        For a replay policy, the action space in the result is empty.

        ``rate_hz`` is the control rate of the run [Hz].
        """
        info = check_action_space(self.address, self.info, action_space)
        agree = getattr(self._made, "check", None) if self._kind.compares else None
        if callable(agree) and action_space is not None and observation is not None:
            agree(space=action_space, observation=observation_spec(observation), rate_hz=rate_hz)
        return info

    def policy(self, scene: TrialScene, trial: PlannedTrial) -> AnyPolicy:
        """Return the policy for one episode. It is called directly, without a separate thread.

        Raises InvalidInputError if the policy works only in betterbench's own scenes.
        """
        if self.needs.state or self.needs.trial:
            return make_for(self.address, scene, trial)
        if self._made is None:
            self._made = self._make()
        return self._made

    def take(self) -> Policy:
        """Return a policy instance. The caller is responsible for closing it."""
        with self._lock:
            made, self._made = self._made, None
        return self._make() if made is None else made

    def _make(self) -> Policy:
        """Create a policy instance.

        Raises HandshakeError if a server now provides a different policy than it did for the first instance.
        """
        made: Policy
        if self._apart:
            made = start_policy(self.address, world=self._world, load_s=self._load_s)
        else:
            made = make_policy(self.address, world=self._world)
        if self.needs.server:
            known, self._known = self._known or made.info, self._known or made.info
            there, here = (describe_policy(self.address, info) for info in (known, made.info))
            found = first_difference(there, here, "policy")
            if found is not None:
                close_policy(made)
                raise HandshakeError(
                    f"{self.address}: the policy has changed since the run began: {found[0]} was {found[1]} "
                    f"and is now {found[2]}. Start the server with the first policy and run the same command "
                    "again, or use --allow-changed-policy to continue with both policies in one run."
                )
        return made

    def close(self) -> None:
        """Close an instance that was created but not taken. This method may be called more than once."""
        made, self._made = self._made, None
        if made is not None:
            close_policy(made)

    def _source(self) -> str:
        """Return the name and SHA-256 of the user's file that contains the policy.

        Return an empty string if there is none.
        """
        if isinstance(self._made, PolicyProcess):
            return self._made.source
        return self._kind.file_of(self._kind.parse(self.address))


def check_action_space(address: str, info: PolicyInfo, action_space: str | None) -> PolicyInfo:
    """Return the description of a policy with the action space of a run.

    Raises InvalidInputError if the policy returns actions in a different action space.
    """
    kind = find_kind(address)  # None for a policy object that the caller passed to the run
    if kind is not None and action_space in kind.spaces:
        return replace(info, action_space=str(action_space))
    if info.action_space and action_space not in (None, info.action_space):
        raise InvalidInputError(
            "action space",
            f"the policy {address} returns actions in {info.action_space!r}, but the run uses {action_space!r}",
            space_cure(info.action_space),
        )
    return info


def close_policy(policy: object) -> None:
    """Call the policy's method ``close`` if it has one."""
    close = getattr(policy, "close", None)
    if callable(close):
        close()
