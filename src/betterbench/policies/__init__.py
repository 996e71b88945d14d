"""Policies: what they say they need and answer, the clients of policy servers, and built-in policies.

- ``address``: parsing of addresses such as ``openpi://host:port?preset=libero``.
- ``kinds``: the list of addresses, the factory that makes a policy from one, and reference policies.
- ``conventions``: translation of observations and actions, presets of known checkpoints, the handshake.
- ``protocols``, ``clients``, ``serving``: codecs, clients of policy servers, and the server side.
- ``process``: policies of users in a process of their own.
- ``experts``, ``faulty``, ``decisions``: privileged policies that plan; ``faulty`` has one file per fault.
- ``learned``: networks, checkpoints, and how a checkpoint acts (`learned:CHECKPOINT`).

Each public name is imported from its module when it is first used: the process of a policy needs no more than its own.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from betterbench.policies.kinds.reference import Noop, Random
    from betterbench.policies.kinds.replay import Replay
    from betterbench.policies.process.plugin import load_plugin, source_of

__all__ = ["Noop", "Random", "Replay", "load_plugin", "source_of"]

_HOMES = {
    "load_plugin": "process.plugin",
    "source_of": "process.plugin",
    "Noop": "kinds.reference",
    "Random": "kinds.reference",
    "Replay": "kinds.replay",
}


def __getattr__(name: str) -> object:
    """Import the module of a name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
