"""Kinds of policies as values, and the registry of all kinds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, cast

from betterbench.errors import UnknownNameError
from betterbench.policies.address import AddressForm, PolicyAddress

if TYPE_CHECKING:
    from betterbench.interface import Policy, PolicyInfo
    from betterbench.interface.state import AnyPolicy, PrivilegedPolicy
    from betterbench.sim.scenes import Scene
    from betterbench.sim.worlds import TrialScene


class PlannedTrial(Protocol):
    """The trial for which a policy is made."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyNeeds:
    """Resources that a policy needs from its run.

    Attributes:
        state: The privileged state, instead of observations. A policy is made for each episode, in its scene.
        trial: The trial. A policy is made for each episode.
        thread: A thread that waits for its answers while the simulation of other trials continues. A policy without a
            thread is built in and answers at once.
        process: A separate process, for users' code: a crash there costs at most its own trial.
        server: A server that the user has started.
    """

    state: bool = False
    trial: bool = False
    thread: bool = False
    process: bool = False
    server: bool = False

    def __post_init__(self) -> None:
        """Check that the needs go together."""
        if (self.process or self.server) and not self.thread:
            raise ValueError("a process or a server needs a thread that waits for it: set thread=True")
        if (self.state or self.trial) and self.thread:
            raise ValueError("a policy of one episode is made in the worker and answers at once: set thread=False")


AT_ONCE = PolicyNeeds()
"""Needs of a built-in policy that sees observations."""

OWN_PROCESS = PolicyNeeds(thread=True, process=True)
"""Needs of a policy with users' code."""

SERVER = PolicyNeeds(thread=True, server=True)
"""Needs of a policy behind a server."""

STATE = PolicyNeeds(state=True)
"""Needs of a policy that sees the privileged state."""


@dataclass(frozen=True, slots=True)
class PolicyEntry:
    """Entry of ``better list policies``; a privileged policy sees the state instead of observations."""

    address: str
    summary: str
    privileged: bool


def _declares_nothing(address: PolicyAddress) -> PolicyInfo | None:
    del address
    return None


def _acts_in_each(address: PolicyAddress, world: str) -> None:
    del address, world


def _leaves_open(address: PolicyAddress) -> str | None:
    del address
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyKind:
    """Kind of policies: the form of their addresses, their needs, and their constructor.

    The functions get an address that :attr:`read` has checked, and raise a BetterError on failure.

    Attributes:
        form: Form of its addresses, with their options.
        shown: Address in ``better list policies``, with words for its parts ("openpi://HOST:PORT").
        summary: One sentence about its policies.
        needs: Needs of its policies; a function if they depend on the address.
        make: Makes a policy that gets observations and runs one episode after the other.
        make_for: Makes a policy for one episode in a scene; the trial is None outside a run.
        named: Its policies by address with a sentence each, where their number is fixed; else None.
        read: Reads an address for a world ("libero"), or for ours (""); the form does it unless told otherwise.
        describe: Returns what a policy says about itself, or None where one has to be made to be asked.
        compares: Whether its policies have a ``check`` that compares their conventions with those of the run.
        source_of: Returns name and fingerprint of the user's file behind a policy. A resumed run compares them.
        risk: Risk of evaluating such an address, which the owner of the machine has to allow, with ``{target}``.
        require_world: Raises InvalidInputError if a policy cannot act in a world that is not ours ("LIBERO").
        space_in_world: Returns the action space in which a policy answers in the world of its address; None if open.
    """

    form: AddressForm
    shown: str
    summary: str
    needs: PolicyNeeds | Callable[[PolicyAddress], PolicyNeeds]
    make: Callable[[PolicyAddress], Policy] | None = None
    make_for: Callable[[PolicyAddress, TrialScene, PlannedTrial | None], AnyPolicy] | None = None
    named: Callable[[], Mapping[str, str]] | None = None
    read: Callable[[str, str], PolicyAddress] | None = None
    describe: Callable[[PolicyAddress], PolicyInfo | None] = _declares_nothing
    compares: bool = False
    source_of: Callable[[PolicyAddress], str] | None = None
    risk: str = ""
    require_world: Callable[[PolicyAddress, str], None] = _acts_in_each
    space_in_world: Callable[[PolicyAddress], str | None] = _leaves_open

    @property
    def name(self) -> str:
        """Name of the kind, the prefix of its addresses."""
        return self.form.scheme

    def parse(self, text: str, *, world: str = "") -> PolicyAddress:
        """Read one of its addresses, in the conventions of a world if one is named.

        Raises:
            UnknownNameError: If the policy or an option does not exist.
            InvalidInputError: If the target or an option is malformed.
        """
        return self.form.read(text, world=world) if self.read is None else self.read(text, world)

    def needs_of(self, text: str) -> PolicyNeeds:
        """Return the needs of an address's policy; raises the errors of :meth:`parse` if the address must be read."""
        return self.needs if isinstance(self.needs, PolicyNeeds) else self.needs(self.parse(text))

    def entries(self) -> tuple[PolicyEntry, ...]:
        """Return its rows in ``better list policies``; empty without a summary, because its addresses are refused."""
        privileged = not isinstance(self.needs, PolicyNeeds) or self.needs.state
        rows = {self.shown: self.summary} if self.named is None else self.named()
        return tuple(PolicyEntry(address, text, privileged) for address, text in rows.items() if text)


KINDS: dict[str, PolicyKind] = {}
"""All kinds by name."""


def register(kind: PolicyKind) -> PolicyKind:
    """Add a kind to the registry, and return it.

    Raises:
        ValueError: If another kind has its name.
    """
    if KINDS.setdefault(kind.name, kind) is not kind:
        raise ValueError(f"another kind of policies has the name {kind.name!r}; choose another scheme")
    return kind


def find_kind(address: str) -> PolicyKind | None:
    """Return the kind of an address, or None if no kind has such addresses."""
    return next((kind for kind in KINDS.values() if kind.form.has(address)), None)


def kind_of(address: str) -> PolicyKind:
    """Return the kind of an address.

    Raises:
        UnknownNameError: If no kind has such addresses; the message names the closest ones.
    """
    kind = find_kind(address)
    if kind is None:
        raise unknown_policy(address)
    return kind


def unknown_policy(address: str) -> UnknownNameError:
    """Return the error about an unknown address, with the closest kinds or the closest addresses."""
    scheme, colon, _ = address.partition("?")[0].partition(":")
    if colon and scheme not in KINDS:
        return UnknownNameError("kind of policy", scheme, (kind.name for kind in KINDS.values() if kind.summary))
    return UnknownNameError("policy", address, (entry.address for entry in known_policies()))


def known_policies() -> tuple[PolicyEntry, ...]:
    """Return all policies that can be evaluated: privileged policies first, and servers last."""
    entries = [(kind, entry) for kind in KINDS.values() for entry in kind.entries()]
    return tuple(entry for _, entry in sorted(entries, key=lambda pair: _place(*pair)))


def _place(kind: PolicyKind, entry: PolicyEntry) -> tuple[bool, bool, bool]:
    needs = kind.needs if isinstance(kind.needs, PolicyNeeds) else AT_ONCE
    return (not entry.privileged, needs.thread, needs.server)


def needs_of(address: str) -> PolicyNeeds:
    """Return the resources that the policy of an address needs from its run.

    Raises:
        UnknownNameError: If no kind has such addresses.
        InvalidInputError: If the address must be read and is malformed.
    """
    return kind_of(address).needs_of(address)


def read_address(address: str, *, world: str = "") -> PolicyAddress:
    """Read an address, in the conventions of a world if one is named.

    Raises:
        UnknownNameError: If the policy or an option does not exist.
        InvalidInputError: If the target or an option is malformed.
    """
    return kind_of(address).parse(address, world=world)


def make_policy(address: str, *, world: str = "") -> Policy:
    """Return a policy that sees observations, in the conventions of a world if one is named.

    Raises:
        UnknownNameError: If the policy or an option does not exist.
        InvalidInputError: If an option is malformed, the policy cannot be loaded, or it does not use observations.
        PolicyUnavailableError: If its server cannot be reached.
        HandshakeError: If its server declares other conventions.
        MissingDependencyError: If an extra is not installed.
    """
    kind = kind_of(address)
    read = kind.parse(address, world=world)
    if kind.make is None:
        raise read.error("it is made for one episode, in its scene", "Evaluate it directly")
    return kind.make(read)


def make_for(address: str, scene: TrialScene, trial: PlannedTrial | None = None) -> AnyPolicy:
    """Return a policy for one episode in a scene; the trial is None outside a run.

    Raises:
        UnknownNameError: If the policy or an option does not exist.
        InvalidInputError: If an option is out of range, a checkpoint or a record is missing, or the policy does not
            support the world of the scene.
        MissingDependencyError: If an extra or a distribution is not installed.
    """
    kind = kind_of(address)
    read = kind.parse(address)
    if kind.make_for is None:
        raise read.error("it is not made for one episode", "Give it observations")
    return kind.make_for(read, scene, trial)


def make_privileged(address: str, scene: Scene) -> PrivilegedPolicy:
    """Return a policy that sees the privileged state, for one episode in a scene; raises as :func:`make_for`."""
    made = make_for(address, scene)
    if not needs_of(address).state:
        raise read_address(address).error("it uses observations and not the state", "Give it observations")
    return cast("PrivilegedPolicy", made)
