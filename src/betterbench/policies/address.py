"""Addresses of remote policies: ``openpi://host:port?preset=openpi_libero&horizon=5``."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeVar
from urllib.parse import parse_qsl, urlsplit

from betterbench.errors import InvalidInputError, UnknownNameError, one_line
from betterbench.interface.policy import Execution

Word = TypeVar("Word", bound=str)

DEFAULT_PORTS = {
    "openpi": 8000,
    "gr00t": 5555,
    "vla-eval": 8000,
    "being-h": 5555,
    "starvla": 10093,
    "http": 8000,
    "https": 443,
}
"""Schemes of servers, with the port that each listens on unless told otherwise."""

EXECUTION_OPTIONS = ("horizon", "ahead", "ensemble")
"""How chunks are played; see :class:`betterbench.interface.Execution`."""

CONNECTION_OPTIONS = ("timeout", "warmup", "retries", "patience", "api_key_env", "tls")
"""How a server is reached: deadline of one request and of the first one [s], how often a failed one is asked again, how
long an unreachable server is waited for [s], the environment variable that holds the key, and whether the connection is
encrypted."""

ADAPTER_OPTIONS = (
    "preset",
    "adapter",
    "size",
    "fit",
    "keep",
    "turn",
    "mirror",
    "ee_offset",
    "action_space",
    "units",
    "frame",
    "rotation",
    "gripper",
)
"""What the policy is shown and how its answers are read: a preset or a file, and what differs from it."""

CAMERA_OPTION = "camera."
"""``camera.KEY=NAME`` shows our camera NAME under the policy's image key KEY."""

CONSTANT_OPTION = "send."
"""``send.KEY=VALUE`` adds an entry to every request, such as ``send.unnorm_key=bridge_orig``."""

HTTP = ("http", "https")
"""Schemes of servers of ``POST``."""

WITH_PATH = ("openpi", "vla-eval", "starvla", *HTTP)
"""Schemes whose servers may be reached at a path; ZeroMQ has none."""

_BROKEN_ESCAPE = re.compile(r"%(?![0-9A-Fa-f]{2})")

OWN_OPTIONS: Mapping[str, tuple[str, ...]] = {
    "openpi": ("arrays", "delay"),
    "vla-eval": ("images",),
    "gr00t": ("layout", "api_token_env", "rtc_overlap_steps", "rtc_frozen_steps", "rtc_ramp_rate"),
    "being-h": ("delay",),
    "starvla": ("layout",),
    "http": ("arrays", "encoded"),
    "https": ("arrays", "encoded"),
    "lerobot": ("device", "state", "trust"),
}
"""Options that only one scheme knows."""

_WITH_CONSTANTS = ("openpi", "vla-eval", "being-h", "starvla", *HTTP)


@dataclass(frozen=True, slots=True)
class PolicyAddress:
    """Where a policy is ("openpi", "localhost:8000") and how it is used; :meth:`parse` has checked the options.

    ``world`` is the foreign world in which the policy acts ("libero"), empty for our own scenes: a preset is what the
    clients of that world do.
    """

    text: str
    scheme: str
    target: str
    options: Mapping[str, str] = field(default_factory=dict)
    world: str = ""

    @classmethod
    def parse(cls, text: str, *, world: str = "") -> PolicyAddress:
        """Read an address.

        Args:
            text: "scheme://host:port?key=value&..." or "lerobot:CHECKPOINT?key=value&...".
            world: The foreign world in which the policy acts.

        Raises:
            UnknownNameError: If the scheme or an option does not exist.
            InvalidInputError: If the address names no target, or gives an option twice or without a value.
        """
        scheme, separator, rest = text.partition(":")
        where = f"policy {one_line(text)}"
        if scheme in ("grpc", "lerobot") and rest.startswith("//"):
            raise InvalidInputError(where, _LEROBOT_PICKLES, _LEROBOT_CURE)
        if not separator or scheme not in OWN_OPTIONS:
            raise UnknownNameError("kind of remote policy", scheme, OWN_OPTIONS)
        target, _, query = rest.removeprefix("//").partition("?")
        if not target:
            raise InvalidInputError(where, "nothing follows the colon", f"Write {_example(scheme)}")
        try:
            pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query), max_num_fields=100)
        except ValueError as error:
            raise InvalidInputError(
                where, f"its options cannot be read ({error})", "Write ?key=value&key=value"
            ) from None
        options = dict(pairs)
        known = (*EXECUTION_OPTIONS, *CONNECTION_OPTIONS, *ADAPTER_OPTIONS, *OWN_OPTIONS[scheme])
        prefixes = (CAMERA_OPTION, CONSTANT_OPTION) if scheme in _WITH_CONSTANTS else (CAMERA_OPTION,)
        for name, value in pairs:
            if name not in known and not any(name.startswith(prefix) and name != prefix for prefix in prefixes):
                raise UnknownNameError(f"option of {scheme}", name, (*known, *(f"{prefix}KEY" for prefix in prefixes)))
            if not value:
                raise InvalidInputError(where, f"{name} has no value", f"Write {name}=VALUE or leave it out")
        if len(options) < len(pairs):
            raise InvalidInputError(where, "it gives an option twice", "Give each option once")
        address = cls(text, scheme, target, options, world)
        if scheme in DEFAULT_PORTS:
            address.server()
        address.execution()
        return address

    def error(self, problem: str, cure: str) -> InvalidInputError:
        """Return the error about this address."""
        return InvalidInputError(f"policy {one_line(self.text)}", problem, cure)

    @property
    def names_adapter(self) -> bool:
        """Whether it says how the policy is spoken to, by a preset or a file."""
        return "preset" in self.options or "adapter" in self.options

    @property
    def server_name(self) -> str:
        """What messages call the server."""
        return f"policy server {self.scheme}://{self.target}"

    def server(self) -> tuple[str, int]:
        """Return host and port of the server.

        Raises InvalidInputError if the target is not "host:port", with a path for the schemes that have paths.
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
            raise self.error(
                f"{self.target!r} is not a host with a port from 1 to 65535", f"Write {_example(self.scheme)}"
            )
        self._check_path(path, place)
        return host, DEFAULT_PORTS.get(self.scheme, 8000) if port is None else port

    def _check_path(self, path: str, place: str) -> None:
        """Raise InvalidInputError if the server cannot have this path."""
        if path and self.scheme not in WITH_PATH:
            raise self.error(
                f"the path {path!r} has no meaning, because {self.scheme} speaks ZeroMQ",
                f"Write {self.scheme}://{place}",
            )
        if not path.isascii() or _BROKEN_ESCAPE.search(path) or (self.scheme in HTTP and not self.target.isascii()):
            raise self.error(
                f"{self.target!r} cannot stand in a request",
                "Write letters outside ASCII, and a literal %, as %XX (percent-encoding)",
            )

    @property
    def path(self) -> str:
        """The path of the server as it is sent: ``/act`` for ``POST`` unless the address names one, else "/"."""
        path = urlsplit(f"//{self.target}").path
        return path if path.strip("/") else "/act" if self.scheme in HTTP else "/"

    def execution(self, usual_horizon: int | None = None) -> Execution:
        """Return how the chunks of the policy are played; raise InvalidInputError if the options allow no such way.

        ``usual_horizon`` is that of the adapter, for an address which sets neither a horizon nor an ensemble.
        """
        ahead, horizon = self.whole("ahead", 0), None
        if "horizon" in self.options:
            horizon = self.whole("horizon")
        elif "ensemble" not in self.options:
            horizon = usual_horizon
            if horizon is not None and ahead >= horizon:
                raise self.error(
                    f"ahead={ahead} is not less than the {horizon} actions of a chunk that its preset executes",
                    "Give horizon=N too",
                )
        return Execution(
            horizon=horizon, ahead=ahead, ensemble=self.number("ensemble") if "ensemble" in self.options else None
        )

    def number(self, name: str, default: float = 0.0) -> float:
        """Return a finite number ≥ 0; raise InvalidInputError if it is something else."""
        text = self.options.get(name)
        if text is None:
            return default
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 <= value < math.inf:
            raise self.error(f"{name}={text} must be ≥ 0", "Give a number such as 2.5")
        return value

    def whole(self, name: str, default: int = 0) -> int:
        """Return a whole number ≥ 0; raise InvalidInputError if it is something else."""
        value = self.number(name, float(default))
        if value != int(value):
            text = self.options[name]
            raise self.error(f"{name}={text} must be a whole number", "Give one such as 8")
        return int(value)

    def choice(self, name: str, choices: tuple[Word, ...], default: Word) -> Word:
        """Return one of several words; raise UnknownNameError if it is another word."""
        if name not in self.options:
            return default
        for word in choices:
            if word == self.options[name]:
                return word
        raise UnknownNameError(name, self.options[name], choices)

    def __str__(self) -> str:
        """Return the address as it was given."""
        return self.text


def _example(scheme: str) -> str:
    """Return an address of that scheme as it should look."""
    port = DEFAULT_PORTS.get(scheme)
    if port is None:
        return f"{scheme}:CHECKPOINT"
    return f"{scheme}://localhost:{port}{'/act' if scheme in HTTP else ''}"


_LEROBOT_PICKLES = (
    "LeRobot's policy server (lerobot.async_inference, gRPC) pickles observations and actions, and unpickling a "
    "stranger's answer runs the stranger's code, so it is not spoken to, on purpose"
)
_LEROBOT_CURE = (
    "Write lerobot:CHECKPOINT, which loads the same checkpoint in process, or run better serve lerobot:CHECKPOINT "
    "where the server runs, and connect with openpi://"
)
