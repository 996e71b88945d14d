"""Kinds of policies, one file each, and the register that knows what an address begins with.

A new file in this folder is found by itself. ``kind`` is the register; ``privileged`` and ``remote`` hold what several
kinds have in common: built-in policies that see the state, and servers. A file imports no simulator and no library of
a server before a policy is made: each process that asks for a policy imports all kinds.
"""

import importlib
import pkgutil

from betterbench.policies.kinds.kind import (
    KINDS,
    PolicyEntry,
    PolicyKind,
    PolicyNeeds,
    find_kind,
    kind_of,
    known_policies,
    make_for,
    make_policy,
    make_privileged,
    needs_of,
    read_address,
    register,
)

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

__all__ = [
    "KINDS",
    "PolicyEntry",
    "PolicyKind",
    "PolicyNeeds",
    "find_kind",
    "kind_of",
    "known_policies",
    "make_for",
    "make_policy",
    "make_privileged",
    "needs_of",
    "read_address",
    "register",
]
