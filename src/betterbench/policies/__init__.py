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

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from betterbench.policies.kinds.noop import Noop
    from betterbench.policies.kinds.python import load_plugin, source_of
    from betterbench.policies.kinds.random_walk import Random
    from betterbench.policies.kinds.replay import Replay

__all__ = ["Noop", "Random", "Replay", "load_plugin", "source_of"]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(
        __name__,
        {
            "kinds.noop": ("Noop",),
            "kinds.python": ("load_plugin", "source_of"),
            "kinds.random_walk": ("Random",),
            "kinds.replay": ("Replay",),
        },
    )
