"""Policies: what they say they need and answer, the clients of policy servers, and built-in policies.

- ``address``: parsing of addresses such as ``openpi://host:port?preset=libero``.
- ``kinds``: one file per kind of policies, and the register that knows what an address begins with.
- ``factory``, ``description``: the instances that a worker asks, and what a policy declares, as JSON.
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
    from betterbench.policies.kinds.noop import Noop
    from betterbench.policies.kinds.python import load_plugin, source_of
    from betterbench.policies.kinds.random_walk import Random
    from betterbench.policies.kinds.replay import Replay

__all__ = ["Noop", "Random", "Replay", "load_plugin", "source_of"]

_HOMES = {
    "load_plugin": "kinds.python",
    "source_of": "kinds.python",
    "Noop": "kinds.noop",
    "Random": "kinds.random_walk",
    "Replay": "kinds.replay",
}


def __getattr__(name: str) -> object:
    """Import the module of a name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
