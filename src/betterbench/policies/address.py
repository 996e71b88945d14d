"""Parser for policy addresses such as ``expert`` and ``openpi://host:port?preset=openpi_libero``.

Each policy kind declares the format and the options of its addresses as an :class:`AddressForm`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeVar, get_args
from urllib.parse import parse_qsl, urlsplit

from betterbench.errors import InvalidInputError, UnknownNameError, one_line
from betterbench.interface.policy import Execution

Word = TypeVar("Word", bound=str)

Transport = Literal["websocket", "zeromq", "http"]
"""Transport protocol of a policy server. Only websocket and HTTP addresses may contain a path."""

_Reads = Literal["text", "number", "whole"]
_Target = Literal["none", "optional", "required"]

_BROKEN_ESCAPE = re.compile(r"%(?![0-9A-Fa-f]{2})")


def _listed(allowed: object) -> str:
    """Return the values of a Literal type as text, such as "'a', 'b' or 'c'"."""
    *first, last = map(repr, get_args(allowed))
    return f"{', '.join(first)} or {last}"


@dataclass(frozen=True, slots=True)
class Option:
    """Option of a policy address, written ``?name=value``.

    Attributes:
        name: Name of the option. If it ends with a period, the address must append a key, as in ``camera.KEY=value``.
        meaning: Description of the value and its unit for messages, such as "the time limit for one answer [s]".
        reads: Type of the value: text, number or whole number. Numbers must be finite and ≥ 0.
        most: Largest allowed number, or infinity for no limit.
    """

    name: str
    meaning: str
    reads: _Reads = "text"
    most: float = math.inf

    def __post_init__(self) -> None:
        """Check the fields. Raises ValueError or TypeError if a value is invalid."""
        name: object = self.name
        meaning: object = self.meaning
        if not isinstance(name, str) or not name:
            raise ValueError(f"the name of an option must be a non-empty text, got {name!r}")
        where = f"option {name!r}"
        if not isinstance(meaning, str) or not meaning:
            raise ValueError(f"{where}: the meaning must be a non-empty text, got {meaning!r}")
        if self.reads not in get_args(_Reads):
            raise ValueError(f"{where}: reads={self.reads!r} is unknown. Use {_listed(_Reads)}")
        if not isinstance(self.most, int | float):
            raise TypeError(f"{where}: most must be a number, got {self.most!r}")

    @property
    def takes_key(self) -> bool:
        """Whether a key must follow the name of the option, as in ``camera.KEY``."""
        return self.name.endswith(".")

    @property
    def shown(self) -> str:
        """Name of the option for messages. If the option takes a key, "KEY" is appended, as in ``camera.KEY``."""
        return f"{self.name}KEY" if self.takes_key else self.name

    def fits(self, name: str) -> bool:
        """Return whether a name in an address, such as "camera.image", refers to this option."""
        if self.takes_key:
            return name.startswith(self.name) and name != self.name
        return name == self.name


EXECUTION = (
    Option("horizon", "the number of actions of a chunk that are executed before the next chunk is requested", "whole"),
    Option("ahead", "the number of steps before the end of a chunk at which the next chunk is requested", "whole"),
    Option("ensemble", "the decay rate of the weights of older chunks in an average over chunks", "number"),
)
"""Options for the execution of action chunks (see :class:`betterbench.interface.Execution`)."""

CONNECTION = (
    Option("timeout", "the time limit for one answer [s]", "number"),
    Option("warmup", "the time limit for the first answer [s]", "number"),
    Option("retries", "the number of times that a failed request is sent again", "whole"),
    Option("patience", "the time to wait for an unreachable server [s]", "number"),
    Option("api_key_env", "the environment variable with the key"),
    Option("tls", "whether the connection is encrypted: true or false"),
)
"""Options for the connection to a server: deadlines, retries, API key and encryption."""

ADAPTER = (
    Option("preset", "the name of the preset, which describes the inputs and outputs of the policy"),
    Option("adapter", "the path of an adapter file"),
    Option("size", "the size of the images, such as 224x224 [px]"),
    Option("fit", "how an image is resized"),
    Option("keep", "the fraction of the image that a center crop keeps", "number"),
    Option("turn", "the rotation of the image [deg]"),
    Option("mirror", "whether the image is mirrored"),
    Option("ee_offset", "the offset of the end effector's position, as x,y,z [m]"),
    Option("action_space", "the action space of the answers"),
    Option("units", "the units of the answers"),
    Option("frame", "the frame of the answers: base or tool"),
    Option("rotation", "the rotation format of the answers"),
    Option("gripper", "the gripper convention of the answers"),
)
"""Options that select an adapter (``preset`` or ``adapter``), and options that override settings of this adapter."""

CAMERA = Option("camera.", "the name of the camera whose image is sent as KEY")
CONSTANT = Option("send.", "the constant that each request contains as KEY")


@dataclass(frozen=True, slots=True, kw_only=True)
class AddressForm:
    """Format of the addresses of one policy kind.

    Attributes:
        scheme: Prefix of the addresses, which is the name of the policy kind.
        example: Example of an address for messages, such as "gr00t://localhost:5555" or "learned:CHECKPOINT".
        target: Whether the scheme is followed by a colon and a target (a name, a file or a server).
        options: Options that the addresses may contain.
        transport: Transport protocol of the server, or None for a policy without a server.
        port: Default port of the server.
    """

    scheme: str
    example: str
    target: _Target = "required"
    options: tuple[Option, ...] = ()
    transport: Transport | None = None
    port: int = 0

    def __post_init__(self) -> None:
        """Check the fields. Raises ValueError or TypeError if a value is invalid."""
        where = f"policy kind {self.scheme}"
        if self.target not in get_args(_Target):
            raise ValueError(f"{where}: target={self.target!r} is unknown. Use {_listed(_Target)}")
        options: object = self.options
        if not isinstance(options, tuple) or not all(isinstance(option, Option) for option in options):
            raise ValueError(f"{where}: options must be a tuple of Option, such as (Option(...),)")
        names = [option.name for option in self.options]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"{where}: the option {twice!r} is declared twice")

    def has(self, text: str) -> bool:
        """Return whether an address has the scheme of this policy kind, and a colon if a target is required."""
        head = text.partition("?")[0]
        scheme, colon, _ = head.partition(":")
        needed = {"none": "", "required": ":"}.get(self.target, colon)
        return scheme == self.scheme and colon == needed

    def read(self, text: str, *, world: str = "") -> PolicyAddress:
        """Parse an address of this format.

        Args:
            text: Address to parse.
            world: Benchmark in which the policy is evaluated, such as "libero". Empty for betterbench's own scenes.

        Raises:
            UnknownNameError: If the policy kind does not have an option of the address.
            InvalidInputError: If the target is missing or is not a valid server, or if an option is malformed, empty or
                given twice.
        """
        head, _, query = text.partition("?")
        target = head.partition(":")[2]
        if self.transport is not None:
            target = target.removeprefix("//")
        if self.target == "required" and not target:
            raise InvalidInputError(
                f"policy {one_line(text)}", "the target after the colon is missing", f"Write {self.example}"
            )
        address = PolicyAddress(text, self, target, self._options(text, query), world)
        for name in address.options:
            address.check(name)
        if self.transport is not None:
            address.server()
        if set(EXECUTION) <= set(self.options):
            address.execution()
        return address

    def _options(self, text: str, query: str) -> dict[str, str]:
        where = f"policy {one_line(text)}"
        try:
            pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query), max_num_fields=100)
        except ValueError as error:
            raise InvalidInputError(
                where, f"the options cannot be read ({error})", "Write the options as ?key=value&key=value"
            ) from None
        if pairs and not self.options:
            raise InvalidInputError(where, f"{self.scheme} does not take options", f"Write {self.example}")
        options = dict(pairs)
        for name, value in pairs:
            option = next((option for option in self.options if option.fits(name)), None)
            if option is None:
                raise UnknownNameError(f"option of {self.scheme}", name, (option.shown for option in self.options))
            if not value:
                cure = f"Give {option.meaning} as {name}=VALUE, or omit {name}"
                raise InvalidInputError(where, f"{name} has no value", cure)
        if len(options) < len(pairs):
            raise InvalidInputError(where, "an option is given twice", "Use each option only once")
        return options


@dataclass(frozen=True, slots=True)
class PolicyAddress:
    """Parsed policy address, as returned by :meth:`AddressForm.read`.

    Attributes:
        text: Complete address, as the user wrote it.
        form: Format of the addresses of this policy kind.
        target: Target of the address, such as "localhost:8000".
        options: Options of the address, by name.
        world: Benchmark in which the policy is evaluated, such as "libero". Empty for betterbench's own scenes. Presets
            depend on the benchmark.
    """

    text: str
    form: AddressForm
    target: str
    options: Mapping[str, str] = field(default_factory=dict)
    world: str = ""

    @property
    def scheme(self) -> str:
        """Name of the policy kind."""
        return self.form.scheme

    @property
    def name(self) -> str:
        """Address without the options, such as "zoo:lexical"."""
        return self.text.partition("?")[0]

    def error(self, problem: str, cure: str) -> InvalidInputError:
        """Create an error whose message begins with this address.

        Args:
            problem: Description of the problem.
            cure: Sentence that tells the user how to correct the address.
        """
        return InvalidInputError(f"policy {one_line(self.text)}", problem, cure)

    def given(self, options: Sequence[Option]) -> list[str]:
        """Return the names of the options in ``options`` that this address sets."""
        return [option.name for option in options if option.name in self.options]

    @property
    def names_adapter(self) -> bool:
        """Whether the address selects an adapter with the option ``preset`` or ``adapter``."""
        return "preset" in self.options or "adapter" in self.options

    @property
    def server_name(self) -> str:
        """Name of the server for messages."""
        return f"policy server {self.scheme}://{self.target}"

    def server(self) -> tuple[str, int]:
        """Return the host and port of the server.

        Raises InvalidInputError if the target is not of the form "host", "host:port" or, for protocols that allow a
        path, "host:port/path".
        """
        host, port, path, place = None, None, "", ""
        try:
            parts = urlsplit(f"//{self.target}")
            if not (parts.username or parts.password or parts.fragment):
                host, port, path, place = parts.hostname, parts.port, parts.path, parts.netloc
        except ValueError:
            host = None
        strange = any(c.isspace() or not c.isprintable() for c in self.target)
        if not host or port == 0 or strange:
            cure = f"Write {self.form.example}"
            if self.target.count(":") > 1 and "[" not in self.target:
                cure += f", or {self.scheme}://[::1]:{self.form.port} with the IPv6 address in brackets"
            raise self.error(f"{self.target!r} is not a host with a port from 1 to 65535", cure)
        self._check_path(path, place)
        return host, self.form.port if port is None else port

    def _check_path(self, path: str, place: str) -> None:
        """Raise InvalidInputError if the path is malformed, or if the server's protocol does not allow paths."""
        if path and self.form.transport == "zeromq":
            raise self.error(
                f"the path {path!r} is not allowed, because {self.scheme} uses ZeroMQ",
                f"Write {self.scheme}://{place}",
            )
        outside = self.form.transport == "http" and not self.target.isascii()
        if not path.isascii() or _BROKEN_ESCAPE.search(path) or outside:
            raise self.error(
                f"{self.target!r} cannot be sent in a request",
                "Write letters outside ASCII, and a literal %, as %XX (percent-encoding)",
            )

    @property
    def path(self) -> str:
        """URL path of the server. If the address contains no path, it is "/act" for HTTP and "/" for websockets."""
        path = urlsplit(f"//{self.target}").path
        return path if path.strip("/") else "/act" if self.form.transport == "http" else "/"

    def execution(self, usual_horizon: int | None = None) -> Execution:
        """Return the settings for executing action chunks, read from the options of the address.

        ``usual_horizon`` is the default execution horizon of the adapter. It is used if the address sets neither
        ``horizon`` nor ``ensemble``. Raises InvalidInputError if the options contradict each other.
        """
        ahead, horizon = self.whole("ahead", 0), None
        if "horizon" in self.options:
            horizon = self.whole("horizon")
        elif "ensemble" not in self.options:
            horizon = usual_horizon
            if horizon is not None and ahead >= horizon:
                raise self.error(
                    f"ahead={ahead} must be less than the number of actions that the preset executes from each "
                    f"chunk ({horizon})",
                    "Set horizon=N with a larger N as well",
                )
        return Execution(
            horizon=horizon, ahead=ahead, ensemble=self.number("ensemble") if "ensemble" in self.options else None
        )

    def check(self, name: str) -> None:
        """Raise InvalidInputError if the value of an option is not a number of the declared type and range."""
        option = self._option(name)
        if option.reads == "whole":
            self.whole(name)
        elif option.reads == "number":
            self.number(name)

    def number(self, name: str, default: float = 0.0) -> float:
        """Return the value of an option as a number.

        Raises InvalidInputError if the value is not a finite number ≥ 0, or if it exceeds the limit of the option.
        """
        option, text = self._option(name), self.options.get(name)
        if text is None:
            return default
        value = _number(text)
        if math.isnan(value):
            such = "such as 2.5" if option.most == math.inf else f"from 0 to {option.most:g}"
            raise self.error(f"{name}: expected a number, got {text!r}", f"Set it to {option.meaning}, {such}")
        if option.most < math.inf and not 0.0 <= value <= option.most:
            raise self.error(f"{name}={text} is out of range", f"Set it to {option.meaning}, from 0 to {option.most:g}")
        if not 0.0 <= value < math.inf:
            such = "such as 8" if option.reads == "whole" else "a number such as 2.5"
            raise self.error(f"{name}={text} must be ≥ 0", f"Set it to {option.meaning}, {such}")
        return value

    def _option(self, name: str) -> Option:
        """Return the declaration of an option. Raises InvalidInputError if the policy kind does not declare it."""
        for option in self.form.options:
            if option.fits(name):
                return option
        unknown = UnknownNameError("option", name, (option.shown for option in self.form.options))
        raise InvalidInputError(
            f"policy kind {self.scheme}",
            f"its code reads the option {name!r}, which its form does not declare",
            str(unknown).partition(". ")[2].rstrip("."),
        )

    def whole(self, name: str, default: int = 0) -> int:
        """Return the value of an option as an integer ≥ 0. Raises InvalidInputError for any other value."""
        option, text = self._option(name), self.options.get(name)
        if text is None:
            return default
        if not _number(text).is_integer():
            raise self.error(f"{name}={text} must be a whole number", f"Set it to {option.meaning}, such as 8")
        return int(self.number(name))

    def choice(self, name: str, choices: tuple[Word, ...], default: Word) -> Word:
        """Return the value of an option that must be one of the given words.

        Raises UnknownNameError for any other value.
        """
        self._option(name)
        if name not in self.options:
            return default
        for word in choices:
            if word == self.options[name]:
                return word
        raise UnknownNameError(name, self.options[name], choices)

    def __str__(self) -> str:
        """Return the address as the user wrote it."""
        return self.text


def _number(text: str) -> float:
    """Convert text to a number. Return NaN if the text is not a number."""
    try:
        return float(text)
    except ValueError:
        return math.nan
