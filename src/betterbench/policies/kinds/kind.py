"""Policy kinds and their registry."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from shlex import quote
from typing import TYPE_CHECKING, Protocol, TypeVar, cast

from betterbench.errors import (
    BetterError,
    InvalidInputError,
    Place,
    UnknownNameError,
    errors_explained,
    name_taken,
    registering_place,
    require_parameters,
)
from betterbench.interface.policy import PolicyInfo, require_policy
from betterbench.policies.address import AddressForm, PolicyAddress

if TYPE_CHECKING:
    from betterbench.interface import Policy
    from betterbench.interface.state import AnyPolicy, PrivilegedPolicy
    from betterbench.sim.scenes import Scene
    from betterbench.sim.worlds import TrialScene

ResultT = TypeVar("ResultT")


class PlannedTrial(Protocol):
    """Description of the trial for which a policy is created."""

    @property
    def task(self) -> str:
        """Task name."""

    @property
    def condition(self) -> str:
        """Condition name."""

    @property
    def base_condition(self) -> str | None:
        """Name of the training condition from which a variation is derived. None for a training condition."""

    @property
    def seed(self) -> int:
        """Trial seed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyNeeds:
    """Resources that a policy needs from the run.

    Attributes:
        state: Whether the policy needs the privileged state instead of observations. If so, it is created for the scene
            of each episode.
        trial: Whether the policy needs to know the trial. If so, it is created for each episode.
        thread: Whether the policy needs a thread that waits for answers while other trials are simulated. Built-in
            policies answer immediately, so they need no thread.
        process: Whether the policy needs a separate process. Policies written by users do, so that a crash affects at
            most one trial.
        server: Whether the policy needs a running server, which the user has started.
    """

    state: bool = False
    trial: bool = False
    thread: bool = False
    process: bool = False
    server: bool = False

    def __post_init__(self) -> None:
        """Check that the needs do not contradict each other."""
        if (self.process or self.server) and not self.thread:
            raise ValueError("a policy in a process or on a server needs a waiting thread: set thread=True")
        if (self.state or self.trial) and self.thread:
            raise ValueError(
                "a policy that is created for each episode runs in the worker without a thread: set thread=False"
            )


AT_ONCE = PolicyNeeds()
"""Needs of a built-in policy that uses observations and answers immediately."""

OWN_PROCESS = PolicyNeeds(thread=True, process=True)
"""Needs of a policy that runs code written by the user."""

SERVER = PolicyNeeds(thread=True, server=True)
"""Needs of a policy on a server."""

STATE = PolicyNeeds(state=True)
"""Needs of a policy that reads the privileged state."""


@dataclass(frozen=True, slots=True)
class PolicyEntry:
    """Row in the table of ``better list policies``.

    A privileged policy gets the simulator state instead of observations.
    """

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


_FUNCTIONS = {
    "make": "address",
    "make_for": "address, scene, trial",
    "named": "",
    "read": "text, world",
    "source_of": "address",
    "describe": "address",
    "require_world": "address, world",
    "space_in_world": "address",
}
"""Required parameters of each function of a policy kind."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyKind:
    """Kind of policies, with the format of their addresses, their needs, and the functions that create them.

    The functions are called with an address that :attr:`read` has checked. If they fail, they raise a BetterError.

    Attributes:
        form: Format of the addresses, including the options.
        shown: Address shown by ``better list policies``, with placeholders ("openpi://HOST:PORT").
        summary: Description of the policies in one sentence.
        needs: Resources that the policies need, or a function that returns them for an address.
        make: Function that creates a policy. The policy uses observations and runs one episode after the other.
        make_for: Function that creates a policy for one episode in a scene. Its argument for the trial is None outside
            a run.
        named: Function that returns a description of each policy, by address. None unless the kind has a fixed list of
            policies.
        read: Function that parses an address for use in a benchmark ("libero", or empty for betterbench's own scenes).
            By default, ``form`` parses the address.
        describe: Function that returns the description of a policy. It returns None if the policy must be created to
            know its description.
        compares: Whether the policies have a method ``check`` that compares their conventions with those of the run.
        source_of: Function that returns the name and SHA-256 of the user's file that contains a policy. Both are
            compared when a run is resumed.
        risk: Description of the risk of evaluating a policy of this kind, in which ``{target}`` stands for the target
            of the address. The user must accept the risk with ``--trust``.
        require_world: Function that raises InvalidInputError if a policy does not support a benchmark ("LIBERO").
        space_in_world: Function that returns the action space that a policy uses in the benchmark for which its address
            was parsed. It returns None if the action space is not fixed.
        spaces: Action spaces from which the run can choose, because the policies support all of them. Empty if each
            policy has a fixed action space.
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
    spaces: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Raise TypeError, ValueError or InvalidInputError if a field is not allowed."""
        if not isinstance(self.form, AddressForm):
            raise TypeError(f"form must be an AddressForm, got {self.form!r}")
        where = f"policy kind {self.name}"
        for name in ("shown", "summary", "risk"):
            if not isinstance(getattr(self, name), str):
                raise TypeError(f"{where}: {name} must be a text, got {getattr(self, name)!r}")
        needs: object = self.needs
        if not isinstance(needs, PolicyNeeds) and not callable(needs):
            known = "AT_ONCE, OWN_PROCESS, SERVER, STATE, PolicyNeeds(...) or a function of the address"
            raise TypeError(f"{where}: needs={needs!r} is not a PolicyNeeds. Use {known}")
        if callable(needs):
            require_parameters(where, "needs", needs, "address")
        for name, parameters in _FUNCTIONS.items():
            value = getattr(self, name)
            if value is None and name in ("make", "make_for", "named", "read", "source_of"):
                continue
            if not callable(value):
                raise TypeError(f"{where}: {name} must be a function, got a {type(value).__name__}")
            if parameters:
                require_parameters(where, name, value, parameters)

    @property
    def name(self) -> str:
        """Name of the kind, which is the prefix of its addresses."""
        return self.form.scheme

    def parse(self, text: str, *, world: str = "") -> PolicyAddress:
        """Parse an address of this kind.

        ``world`` names the benchmark whose conventions apply, such as "libero". It is empty for betterbench's own
        scenes.

        Raises:
            UnknownNameError: If the policy or an option does not exist.
            InvalidInputError: If the target or an option is malformed.
        """
        if self.read is None:
            return self.form.read(text, world=world)
        return self._returned("read", self.read(text, world), PolicyAddress)

    def needs_of(self, address: str | PolicyAddress) -> PolicyNeeds:
        """Return the resources that the policy at an address needs.

        Raises the errors of :meth:`parse` if the needs depend on the address and the address is a text.
        """
        if isinstance(self.needs, PolicyNeeds):
            return self.needs
        parsed = self.parse(address) if isinstance(address, str) else address
        return self._returned("needs", self.needs(parsed), PolicyNeeds)

    def info_of(self, address: PolicyAddress) -> PolicyInfo | None:
        """Return the description of a policy. Return None if the policy must be created to know it."""
        found = self.describe(address)
        return None if found is None else self._returned("describe", found, PolicyInfo, "a PolicyInfo or None")

    def file_of(self, address: PolicyAddress) -> str:
        """Return the name and SHA-256 of the user's file that contains a policy, or an empty string."""
        if self.source_of is None:
            return ""
        return self._returned("source_of", self.source_of(address), str, "a text such as 'my_policy.py, sha256 0a1b'")

    def space_of(self, address: PolicyAddress) -> str | None:
        """Return the action space of a policy in another benchmark. Return None if it is not fixed."""
        found = self.space_in_world(address)
        return (
            None if found is None else self._returned("space_in_world", found, str, "a text such as 'ee_delta' or None")
        )

    def _returned(self, name: str, value: object, expected: type[ResultT], words: str = "") -> ResultT:
        """Return the result of a function of this kind.

        Raises InvalidInputError, with the function's file and line, if the result is not of the expected type.
        """
        if isinstance(value, expected):
            return value
        code = getattr(getattr(self, name), "__code__", None)
        where, its = f"policy kind {self.name}", ""
        if code is not None:
            where, its = f"{code.co_filename}, line {code.co_firstlineno}", f" of the policy kind {self.name}"
        words = words or f"a {expected.__name__}"
        problem = f"{name}{its} must return {words}, got {reprlib.repr(value)}"
        raise InvalidInputError(where, problem, "Correct its return value")

    def entries(self) -> tuple[PolicyEntry, ...]:
        """Return the rows for ``better list policies``.

        A kind without a summary has no rows, because it exists only to explain why its addresses are rejected.
        """
        privileged = not isinstance(self.needs, PolicyNeeds) or self.needs.state
        rows = {self.shown: self.summary} if self.named is None else self.named()
        return tuple(PolicyEntry(address, text, privileged) for address, text in rows.items() if text)


KINDS: dict[str, PolicyKind] = {}
"""All registered policy kinds, by name."""

_REGISTERED_AT: dict[str, Place] = {}


def register(kind: PolicyKind, here: Place | None = None) -> PolicyKind:
    """Add a policy kind to the registry, and return the kind.

    Args:
        kind: The policy kind.
        here: Place that registers the kind. By default, this is the place that calls this function.

    Raises:
        InvalidInputError: If another kind has the same name. The message names both places.
        ValueError: If the scheme is not one word, if the example is not an address of the kind, or if the function that
            makes the policies is missing.
    """
    here = here or registering_place()
    if kind.name in KINDS:
        raise name_taken(f"policy kind {kind.name!r}", _REGISTERED_AT[kind.name], here)
    if not re.fullmatch(r"\w[\w.+-]*", kind.name):
        raise ValueError(f"scheme {kind.name!r} must be one word, such as sway")
    if kind.summary:  # without a summary, a kind only explains why its addresses are rejected
        _require_complete(kind)
    KINDS[kind.name] = kind
    _REGISTERED_AT[kind.name] = here
    return kind


def places_of_kinds() -> Collection[Place]:
    """Return the places at which policy kinds have been registered."""
    return _REGISTERED_AT.values()


def _require_complete(kind: PolicyKind) -> None:
    """Raise ValueError if the example is wrong or the function that makes the policies is missing."""
    where, form = f"policy kind {kind.name}", kind.form
    if not form.has(form.example):
        begin = form.scheme if form.target == "none" else f"{form.scheme}:"
        raise ValueError(f"{where}: the example {form.example!r} is not an address of this kind. Begin it with {begin}")
    if not isinstance(kind.needs, PolicyNeeds):
        if kind.make is None and kind.make_for is None:
            raise ValueError(f"{where}: make and make_for are missing. Pass the functions that return a policy")
    elif kind.needs.state or kind.needs.trial:
        if kind.make_for is None:
            raise ValueError(f"{where}: make_for is missing. Pass the function that returns a policy for one episode")
    elif kind.make is None:
        raise ValueError(f"{where}: make is missing. Pass the function that returns a policy for an address")


def find_kind(address: str) -> PolicyKind | None:
    """Return the policy kind to which an address belongs, or None if there is none."""
    return next((kind for kind in KINDS.values() if kind.form.has(address)), None)


def defining_file(address: str) -> str:
    """Return the path of the file that registers the policy kind of an address, or "" if there is no such kind."""
    kind = find_kind(address)
    return "" if kind is None else _REGISTERED_AT[kind.name].file


def kind_of(address: str) -> PolicyKind:
    """Return the policy kind to which an address belongs.

    Raises:
        UnknownNameError: If no kind has addresses like this one. The message names the closest kinds.
        InvalidInputError: If the address is a Python file without the prefix ``python:``.
    """
    kind = find_kind(address)
    if kind is None:
        raise unknown_policy(address)
    return kind


def unknown_policy(address: str) -> InvalidInputError | UnknownNameError:
    """Create the error for an address that belongs to no policy.

    The error suggests the prefix for a Python file, or the closest names.
    """
    scheme, colon, _ = address.partition("?")[0].partition(":")
    if scheme.endswith(".py"):
        full = f"python:{address}" if colon else f"python:{scheme}:CLASS"
        return InvalidInputError(f"policy {address}", "the prefix python: is missing", f"Write {quote(full)}.")
    if colon and scheme not in KINDS:
        return UnknownNameError("policy kind", scheme, (kind.name for kind in KINDS.values() if kind.summary))
    return UnknownNameError("policy", address, (entry.address for entry in known_policies()))


def known_policies() -> tuple[PolicyEntry, ...]:
    """Return all policies that can be evaluated. Privileged policies come first, policies on servers last."""
    entries = [(kind, entry) for kind in KINDS.values() for entry in kind.entries()]
    return tuple(entry for _, entry in sorted(entries, key=lambda pair: _place(*pair)))


def _place(kind: PolicyKind, entry: PolicyEntry) -> tuple[bool, bool, bool]:
    needs = kind.needs if isinstance(kind.needs, PolicyNeeds) else AT_ONCE
    return (not entry.privileged, needs.thread, needs.server)


def needs_of(address: str) -> PolicyNeeds:
    """Return the resources that the policy at an address needs.

    Raises:
        UnknownNameError: If no kind has addresses like this one.
        InvalidInputError: If the needs depend on the address and the address is malformed.
    """
    return kind_of(address).needs_of(address)


def read_address(address: str, *, world: str = "") -> PolicyAddress:
    """Parse a policy address.

    ``world`` names the benchmark whose conventions apply, such as "libero". It is empty for betterbench's own scenes.

    Raises:
        UnknownNameError: If the policy or an option does not exist.
        InvalidInputError: If the target or an option is malformed.
    """
    return kind_of(address).parse(address, world=world)


def make_policy(address: str, *, world: str = "") -> Policy:
    """Create a policy that uses observations.

    ``world`` names the benchmark whose conventions apply, such as "libero". It is empty for betterbench's own scenes.

    Raises:
        UnknownNameError: If the policy or an option does not exist.
        InvalidInputError: If an option is malformed, or if the policy cannot be loaded or does not use observations.
        PolicyUnavailableError: If the policy's server cannot be reached.
        HandshakeError: If the policy's server declares different conventions than the client.
        MissingDependencyError: If a package that the policy needs is not installed.
    """
    kind = kind_of(address)
    read = kind.parse(address, world=world)
    if kind.make is None:
        raise read.error("this policy can only be created for the scene of one episode", "Evaluate it with better eval")
    # A policy's own process describes errors of the user's code.
    keep = Exception if kind.needs_of(read).process else BetterError
    with errors_explained(_REGISTERED_AT[kind.name].file, keep=(keep, OSError)):
        made = kind.make(read)
    _require_present(made, read)
    require_policy(made, f"policy {read}")
    return made


def make_for(address: str, scene: TrialScene, trial: PlannedTrial | None = None) -> AnyPolicy:
    """Create a policy for one episode in a scene. ``trial`` is None outside a run.

    Raises:
        UnknownNameError: If the policy or an option does not exist.
        InvalidInputError: If an option is out of range, if a checkpoint or a record is missing, or if the policy does
            not work in the benchmark to which the scene belongs.
        MissingDependencyError: If a package that the policy needs is not installed.
    """
    kind = kind_of(address)
    read = kind.parse(address)
    if kind.make_for is None:
        raise read.error(
            "this policy is created once for many episodes, not for each episode",
            "Create it with make_policy, and pass it observations",
        )
    made = kind.make_for(read, scene, trial)
    _require_present(made, read)
    if not hasattr(made, "act_on_state"):
        require_policy(made, f"policy {read}")
    return made


def _require_present(made: object, address: PolicyAddress) -> None:
    """Raise InvalidInputError if a kind has returned None instead of a policy."""
    if made is None:
        raise address.error("its kind returned None instead of a policy", "Return the policy")


def make_privileged(address: str, scene: Scene) -> PrivilegedPolicy:
    """Create a policy that uses the privileged state, for one episode. Raises the errors of :func:`make_for`."""
    made = make_for(address, scene)
    if not needs_of(address).state:
        raise read_address(address).error(
            "this policy uses observations, not the privileged state", "Pass it observations"
        )
    return cast("PrivilegedPolicy", made)
