"""Policies that see only observations: reference policies, and clients of real ones.

Each public name is imported from its module when it is first used: the process of a policy needs no more than its own.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from betterbench.policies.plugin import load_plugin, source_of
    from betterbench.policies.reference import Noop, Random
    from betterbench.policies.replay import Replay

__all__ = ["Noop", "Random", "Replay", "load_plugin", "source_of"]

_HOMES = {
    "load_plugin": "plugin",
    "source_of": "plugin",
    "Noop": "reference",
    "Random": "reference",
    "Replay": "replay",
}


def __getattr__(name: str) -> object:
    """Import the module of a name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
