"""Policy kinds, one file each, and the registry of kinds by address scheme.

A new file in this folder is found automatically. ``kind`` is the registry. ``privileged`` contains the common code of
built-in policies with access to the state, ``remote`` that of policies behind servers. A file imports simulators and
server libraries only when a policy is made, because each process that uses a policy imports all kinds.
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
