"""From the address of a policy to the instances that a worker asks."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Protocol, Self

from betterbench.errors import HandshakeError, InvalidInputError, UnknownNameError
from betterbench.interface import BatchPolicy, Policy, PolicyInfo, observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import AnyPolicy, PrivilegedPolicy
from betterbench.policies import Noop, Random, Replay, load_plugin, source_of
from betterbench.policies.address import PolicyAddress
from betterbench.policies.clients.connection import ConnectionLimits
from betterbench.policies.conventions.handshake import space_cure
from betterbench.policies.conventions.in_calvin import CONTROL_RATE_HZ as CALVIN_RATE_HZ
from betterbench.policies.experts import make_expert, parse_address
from betterbench.policies.experts.libero import LiberoAgent
from betterbench.policies.kinds.description import describe_policy
from betterbench.policies.kinds.independent import is_independent, make_independent
from betterbench.policies.kinds.known_policies import CONNECTED, PLAIN, REFUSED, known_policies
from betterbench.policies.learned import is_learned, is_seeing, learned_info, make_learned, make_seeing
from betterbench.policies.process.policy_process import LOAD_S, PolicyProcess, start_policy
from betterbench.records import RunFolder, first_difference
from betterbench.sim.scenes import CONTROL_RATE_HZ, Scene
from betterbench.sim.worlds import ForeignScene

SOURCE = "source file"
"""Key in the metadata of a Python policy under which its file and the file's SHA-256 stand."""


class PlannedTrial(Protocol):
    """What a policy may need to know of the trial that it is made for."""

    @property
    def task(self) -> str:
        """Name of the task."""

    @property
    def condition(self) -> str:
        """Name of the condition."""

    @property
    def base_condition(self) -> str | None:
        """Name of the training condition that a variation changes."""

    @property
    def seed(self) -> int:
        """Seed of the trial."""


def check_policy(address: str, *, action_space: str | None = None, observation: str | None = None) -> PolicyInfo:
    """Return what a policy says about itself, and check it against a run, if one is named; a server is asked.

    Raises:
        UnknownNameError: If no policy has such an address.
        InvalidInputError: If a plugin cannot be loaded, or the policy answers in another action space.
        RecordError: If the run to replay does not exist.
        PolicyUnavailableError: If a server cannot be reached.
        HandshakeError: If a server declares other conventions.
    """
    with PolicyFactory(address) as policies:
        return policies.check(action_space, observation)


def make_policy(address: str, *, world: str = "") -> Policy:
    """Return a policy that sees observations, for a foreign world if one is named.

    Raises what :func:`check_policy` raises.
    """
    if address == "noop":
        return Noop()
    if address == "random":
        return Random()
    if address.startswith("python:"):
        return load_plugin(address.removeprefix("python:"))
    if is_seeing(address):
        return make_seeing(address)
    if is_remote(address) or is_in_process_model(address):
        # Imported here: a run of the expert needs no network library.
        from betterbench.policies.clients.connect import connect  # noqa: PLC0415

        return connect(address, world=world)
    raise UnknownNameError("policy", address, (e.address for e in known_policies()))


def is_privileged(address: str) -> bool:
    """Return whether a policy sees the privileged state instead of observations."""
    if is_learned(address):
        return not is_seeing(address)
    return parse_address(address) is not None or is_independent(address)


def make_privileged(address: str, scene: Scene) -> PrivilegedPolicy:
    """Return a policy that sees the privileged state, for one episode in a scene.

    Raises:
        UnknownNameError: If there is no such policy.
        InvalidInputError: If an option is unknown or out of range, or a checkpoint is missing or damaged.
        MissingDependencyError: If a checkpoint needs an extra that is not installed.
    """
    if is_independent(address):
        return make_independent(address, scene)
    if is_learned(address):
        return make_learned(address, scene.condition.instruction.text, scene.seed)
    return make_expert(address, scene)


def is_remote(address: str) -> bool:
    """Return whether a policy answers from a server."""
    scheme, separator, _ = address.partition("://")
    return bool(separator) and scheme in (*CONNECTED, *REFUSED)


def is_in_process_model(address: str) -> bool:
    """Return whether a policy loads the weights of a checkpoint into the process that asks for it."""
    return address.startswith("lerobot:")


def runs_apart(address: str) -> bool:
    """Return whether a run asks a policy in a process of its own: it is not ours, and no server holds it already."""
    return address.startswith("python:") or is_in_process_model(address)


def needs_no_thread(address: str) -> bool:
    """Return whether a policy is built in and answers at once, so that the simulation waits for it."""
    return is_privileged(address) or is_learned(address) or address in PLAIN or address.startswith("replay:")


def answer_limit_s(address: str, policy_timeout_s: float) -> float:
    """Return the deadline of one answer [s]: that of the address of a server, else that of the run."""
    return ConnectionLimits.of(PolicyAddress.parse(address)).timeout_s if is_remote(address) else policy_timeout_s


class PolicyFactory:
    """Makes the policies of one worker. A context manager, which closes an instance that was made and not taken."""

    def __init__(
        self,
        address: str,
        *,
        apart: bool = False,
        known: PolicyInfo | None = None,
        timeout_s: float | None = None,
        world: str = "",
    ) -> None:
        """Prepare; nothing is loaded and no server is asked yet.

        ``world`` is the foreign world of the run, in whose conventions a server is spoken to.

        With ``apart``, a policy that is not ours is loaded in a process of its own (:func:`runs_apart`), within ten
        times the ``timeout_s`` of an answer [s]. ``known`` is what the server of the policy said when the run began, or
        None: its clients compare themselves.
        """
        self.address = address
        self._world = world
        self._load_s = LOAD_S if timeout_s is None else 10.0 * timeout_s
        self._apart = apart and runs_apart(address)
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
        """What the policy says about itself; it is made once to ask it, and raises what :func:`check_policy` raises."""
        if self._info is None:
            if is_learned(self.address) and not is_seeing(self.address):
                self._info = learned_info(self.address)
            elif is_privileged(self.address):
                self._info = PolicyInfo(self.address, action_space=EE_DELTA.name, needs_images=False)
            elif self.address.startswith("replay:"):
                RunFolder.open(Path(self.address.removeprefix("replay:")))
                self._info = PolicyInfo(self.address, action_space="", needs_images=False)
            else:
                self._made = self._make()
                self._info, self._takes_batches = self._made.info, isinstance(self._made, BatchPolicy)
                source = self._source()
                if source:  # a resumed run compares it
                    self._info = replace(self._info, metadata={**self._info.metadata, SOURCE: source})
        return self._info

    @property
    def takes_batches(self) -> bool:
        """Whether one instance answers the observations of many environments; the policy is made to ask it."""
        return bool(self.info) and self._takes_batches

    def check(self, action_space: str | None = None, observation: str | None = None) -> PolicyInfo:
        """Return :attr:`info`, and check it as :func:`check_policy` does; the action space of a replay is empty."""
        info = self.info
        check_action_space(self.address, info, action_space)
        adapts = is_remote(self.address) or is_in_process_model(self.address) or is_seeing(self.address)
        agree = getattr(self._made, "check", None) if adapts else None
        if callable(agree) and action_space is not None and observation is not None:
            agree(space=action_space, observation=observation_spec(observation), rate_hz=self._rate_hz)
        return info

    @property
    def _rate_hz(self) -> float:
        """Control rate of the run [Hz]."""
        return CALVIN_RATE_HZ if self._world == "calvin" else CONTROL_RATE_HZ

    def policy(self, scene: Scene | ForeignScene, trial: PlannedTrial) -> AnyPolicy:
        """Return the policy of one episode, where it needs no thread; InvalidInputError if it knows only our world."""
        if is_privileged(self.address) and isinstance(scene, ForeignScene):
            return LiberoAgent(self.address, scene)
        if isinstance(scene, Scene) and is_privileged(self.address):
            return make_privileged(self.address, scene)
        if self.address.startswith("replay:"):
            return Replay(
                self.address.removeprefix("replay:"),
                task=trial.task,
                condition=trial.condition,
                base=trial.base_condition or trial.condition,
                seed=trial.seed,
            )
        if self._made is None:
            self._made = self._make()
        return self._made

    def take(self) -> Policy:
        """Return an instance for the caller alone, who closes it."""
        with self._lock:
            made, self._made = self._made, None
        return self._make() if made is None else made

    def _make(self) -> Policy:
        """Return a new instance; HandshakeError if a server has become another one since the first one was made."""
        made: Policy
        if self._apart:
            made = start_policy(self.address, world=self._world, load_s=self._load_s)
        else:
            made = make_policy(self.address, world=self._world)
        if is_remote(self.address):
            known, self._known = self._known or made.info, self._known or made.info
            there, here = (describe_policy(self.address, info) for info in (known, made.info))
            found = first_difference(there, here, "policy")
            if found is not None:
                close_policy(made)
                raise HandshakeError(
                    f"{self.address}: another policy answers there than when the run began: {found[0]} was {found[1]} "
                    f"and is {found[2]}. Start the first one and run the same command again, or give "
                    "--allow-changed-policy to go on with both in one run."
                )
        return made

    def close(self) -> None:
        """Close an instance that was made and not taken; harmless when closed."""
        made, self._made = self._made, None
        if made is not None:
            close_policy(made)

    def _source(self) -> str:
        """Return name and fingerprint of the file of a Python policy, or an empty text."""
        if isinstance(self._made, PolicyProcess):
            return self._made.source
        return source_of(self.address.removeprefix("python:")) if self.address.startswith("python:") else ""


def check_action_space(address: str, info: PolicyInfo, action_space: str | None) -> None:
    """Raise InvalidInputError if a policy answers in another action space than the run, where there is a run yet."""
    if info.action_space and action_space not in (None, info.action_space):
        raise InvalidInputError(
            "action space",
            f"the policy {address} answers in {info.action_space!r}, the run asks for {action_space!r}",
            space_cure(info.action_space),
        )


def close_policy(policy: object) -> None:
    """Call a policy's ``close``, if it has one."""
    close = getattr(policy, "close", None)
    if callable(close):
        close()
