"""Modalities of a GR00T server: its declared inputs and outputs, and the time steps that each input covers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from betterbench.errors import HandshakeError, one_line
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.protocols.wire import ModalityConfig

SEEN = ("video", "state")
"""Modalities of an observation that have a time axis."""


_MOST_SHOWN = 20
"""Maximum number of names listed in one message."""


@dataclass(frozen=True, slots=True)
class Modalities:
    """Inputs and outputs that a GR00T server declares.

    Attributes:
        video: Names of the required images, or None if the server does not declare them.
        state: Names of the required states, or None.
        language: Names of the required instructions, or None.
        action: Names of the actions, or None.
        steps: Control steps of the required observations, for each modality in ``SEEN``. They are relative to the
            current step and end with 0, for example (-1, 0).
        horizon: Number of actions in a chunk, or None if the server does not declare it.
        prefixed: Whether the server's names begin with the modality ("video.front"), as in N1.5.
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
        """Parse the answer to ``get_modality_config``.

        Some servers, such as starVLA's, return a map without modality configs. They are treated as servers that declare
        nothing. Raises HandshakeError if the answer is malformed, or if the policy needs observations from time steps
        that the client does not support.
        """
        marked = [isinstance(value, ModalityConfig) for value in reply.values()] if isinstance(reply, Mapping) else []
        if isinstance(reply, Mapping) and not any(marked):
            return cls()
        if not isinstance(reply, Mapping) or not all(marked):
            raise HandshakeError(f"{where}: the reply to get_modality_config contains no modality configs.")
        names = {
            kind: tuple(_bare(key, kind) for key in reply[kind].modality_keys)
            for kind in (*SEEN, "language", "action")
            if kind in reply
        }
        steps = {kind: reply[kind].delta_indices if kind in reply else (0,) for kind in SEEN}
        for kind, wanted in steps.items():
            if names.get(kind) and (not wanted or wanted[-1] != 0 or list(wanted) != sorted(set(wanted))):
                raise HandshakeError(
                    f"{where} needs {kind} at the steps {one_line(list(wanted), most=100)} relative to the "
                    "current step. This client supports increasing steps that end with 0, such as [-1, 0]."
                )
        prefixed = any(key.startswith(f"{kind}.") for kind, config in reply.items() for key in config.modality_keys)
        horizon = len(reply["action"].delta_indices) if "action" in reply else None
        return cls(**names, steps={k: v or (0,) for k, v in steps.items()}, horizon=horizon or None, prefixed=prefixed)

    @property
    def remembers(self) -> bool:
        """Whether the policy needs observations from earlier time steps."""
        return any(len(steps) > 1 for steps in self.steps.values())

    def check(self, adapter: Adapter, where: str) -> None:
        """Raise HandshakeError if an adapter and the server have different modalities. The message lists both.

        The key of the instruction is not compared, because the client uses the server's key in its requests.
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
                "Add adapter=FILE with an adapter that uses the names in the modality.json of the fine-tuning."
            )

    def to_json(self) -> dict[str, Any]:
        """Return the modalities as a JSON-serializable dict, which is stored with the run."""
        return {
            **{kind: getattr(self, kind) for kind in (*SEEN, "language", "action")},
            "steps": {kind: list(steps) for kind, steps in self.steps.items()},
            "horizon": self.horizon,
        }


def name_of(key: tuple[str, ...]) -> str:
    """Return the name in an adapter key, without the modality.

    For example, the result is "front" for ("video", "front") and for ("video.front",).
    """
    if len(key) > 1:
        return "/".join(key[1:])
    kind, dot, rest = key[0].partition(".")
    return rest if dot and kind in (*SEEN, "action") else key[0]


def _bare(key: str, kind: str) -> str:
    """Remove the modality prefix, which N1.5 adds, from a declared name. Names of instructions keep their prefix."""
    return key.removeprefix(f"{kind}.") if kind != "language" else key


def _listed(names: Iterable[str]) -> str:
    """Join names for a message. If there are too many names, append the number of omitted names."""
    known = sorted(names)
    more = f" and {len(known) - _MOST_SHOWN} more" if len(known) > _MOST_SHOWN else ""
    return ", ".join(one_line(name, most=60) for name in known[:_MOST_SHOWN]) + more or "nothing"
