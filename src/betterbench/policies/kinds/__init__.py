"""Policy kinds, one file each, and the registry of kinds by address scheme.

A file that is added to this folder is found automatically. ``kind`` contains the registry. ``privileged`` contains the
code shared by built-in policies that read the simulator state, and ``remote`` the code shared by policies on servers. A
file imports simulators and server libraries only when a policy is created, because each process that uses a policy
imports the files of all kinds.
"""

import importlib
import pkgutil
from pathlib import Path

from betterbench.errors import errors_explained
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
    with errors_explained(str(Path(__path__[0]) / f"{_module.name}.py")):
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
