"""Policies: built-in policies, clients of policy servers, and the addresses by which users select a policy.

- ``address``: parser of policy addresses such as ``openpi://host:port?preset=libero``.
- ``kinds``: one file per policy kind, and the registry of kinds by address scheme.
- ``factory``, ``description``: creation of the policy instances of a worker, and the description of a policy as JSON.
- ``conventions``: translation of observations and actions, presets of known checkpoints, and the handshake.
- ``protocols``, ``clients``, ``serving``: message encodings, clients of policy servers, and the server that serves a
  policy.
- ``process``: policies written by the user, which run in a separate process.
- ``experts``, ``faulty``, ``decisions``: privileged policies, which plan with the simulator state. ``faulty`` has one
  file per fault.
- ``learned``: networks, their checkpoints, and the policy that runs a checkpoint (`learned:CHECKPOINT`).

Each public name is imported from its module at first use, so that a process that runs a policy imports only what that
policy needs.
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
