"""Privileged policies: the expert, and the faulty policies that calibrate the diagnosis.

Each public name is imported from its module when it is first used: an address can be read without a simulator.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from betterbench.policies.experts.address import Address
    from betterbench.policies.experts.privileged import PrivilegedAgent, make_expert
    from betterbench.policies.experts.registry import EXPERTS, REPLAYS, expert_names, parse_address

__all__ = ["EXPERTS", "REPLAYS", "Address", "PrivilegedAgent", "expert_names", "make_expert", "parse_address"]

_MODULES = {
    "address": ("Address",),
    "privileged": ("PrivilegedAgent", "make_expert"),
    "registry": ("EXPERTS", "REPLAYS", "expert_names", "parse_address"),
}
_HOMES = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import the module of a name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
