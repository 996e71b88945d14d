"""Modalities declared by a GR00T server, with entries and required time steps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from betterbench.errors import HandshakeError, one_line
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.protocols.wire import ModalityConfig

SEEN = ("video", "state")
"""Modalities of an observation with a time axis."""


_MOST_SHOWN = 20
"""Maximum number of names in one message."""


@dataclass(frozen=True, slots=True)
class Modalities:
    """Modalities of a server, each with entries and time steps.

    Attributes:
        video: Names of the required images, or None if not declared. The same applies to the other modalities.
        steps: Control steps of each sample relative to now, by modality in ``SEEN``. The last step is 0.
        prefixed: Whether names have their modality as a prefix ("video.front"), as in N1.5.
    """

    video: tuple[str, ...] | None = None
    state: tuple[str, ...] | None = None
    language: tuple[str, ...] | None = None
    action: tuple[str, ...] | None = None
    steps: Mapping[str, tuple[int, ...]] = field(default_factory=lambda: dict.fromkeys(SEEN, (0,)))
    horizon: int | None = None
    prefixed: bool = False

    @classmethod
    def read(cls, reply: object, where: str) -> Modalities:
        """Read the answer to ``get_modality_config``. A plain map, as from starVLA's server, declares nothing.

        Raises HandshakeError if the answer is malformed, or requires inputs that no client has.
        """
        marked = [isinstance(value, ModalityConfig) for value in reply.values()] if isinstance(reply, Mapping) else []
        if isinstance(reply, Mapping) and not any(marked):
            return cls()
        if not isinstance(reply, Mapping) or not all(marked):
            raise HandshakeError(f"{where}: its reply to get_modality_config contains no modality configs.")
        names = {
            kind: tuple(_bare(key, kind) for key in reply[kind].modality_keys)
            for kind in (*SEEN, "language", "action")
            if kind in reply
        }
        steps = {kind: reply[kind].delta_indices if kind in reply else (0,) for kind in SEEN}
        for kind, wanted in steps.items():
            if names.get(kind) and (not wanted or wanted[-1] != 0 or list(wanted) != sorted(set(wanted))):
                raise HandshakeError(
                    f"{where} needs {kind} at the steps {one_line(list(wanted), most=100)} relative to now. "
                    "This client supports increasing steps that end with 0, such as [-1, 0]."
                )
        prefixed = any(key.startswith(f"{kind}.") for kind, config in reply.items() for key in config.modality_keys)
        horizon = len(reply["action"].delta_indices) if "action" in reply else None
        return cls(**names, steps={k: v or (0,) for k, v in steps.items()}, horizon=horizon or None, prefixed=prefixed)

    @property
    def remembers(self) -> bool:
        """Whether the policy needs observations from earlier time steps."""
        return any(len(steps) > 1 for steps in self.steps.values())

    def check(self, adapter: Adapter, where: str) -> None:
        """Raise HandshakeError, with both declarations of each modality, if the adapter differs.

        The key of the instruction is not compared, because the server's key is used.
        """
        given = {
            "video": [name_of(rule.key) for rule in adapter.views],
            "state": [name_of(rule.key) for rule in adapter.states],
            "action": [name_of(key) for key in adapter.answer.columns],
        }
        differences = []
        for kind, ours in given.items():
            theirs = getattr(self, kind)
            if theirs is not None and set(theirs) != set(ours):
                side = "the adapter reads" if kind == "action" else "the adapter sends"
                verb = "answers" if kind == "action" else "wants"
                differences.append(f"{kind}: the server {verb} {_listed(theirs)}, {side} {_listed(ours)}")
        if self.language is not None and len(self.language) != 1:
            differences.append(
                f"language: the server needs {_listed(self.language)}, the adapter sends one instruction"
            )
        if differences:
            raise HandshakeError(
                f"{where} and the adapter {adapter.name!r} declare different modalities. {'; '.join(differences)}. "
                "Give adapter=FILE with the names in the modality.json used for fine-tuning."
            )

    def to_json(self) -> dict[str, Any]:
        """Return the JSON-serializable dict stored with the run."""
        return {
            **{kind: getattr(self, kind) for kind in (*SEEN, "language", "action")},
            "steps": {kind: list(steps) for kind, steps in self.steps.items()},
            "horizon": self.horizon,
        }


def name_of(key: tuple[str, ...]) -> str:
    """Return an adapter key's name without prefix: ("video", "front") and ("video.front",) are both "front"."""
    if len(key) > 1:
        return "/".join(key[1:])
    kind, dot, rest = key[0].partition(".")
    return rest if dot and kind in (*SEEN, "action") else key[0]


def _bare(key: str, kind: str) -> str:
    """Return a server's name without the modality prefix of N1.5."""
    return key.removeprefix(f"{kind}.") if kind != "language" else key


def _listed(names: Iterable[str]) -> str:
    """Return names for a message, shortened if there are many."""
    known = sorted(names)
    more = f" and {len(known) - _MOST_SHOWN} more" if len(known) > _MOST_SHOWN else ""
    return ", ".join(one_line(name, most=60) for name in known[:_MOST_SHOWN]) + more or "nothing"
