"""Policy kinds, one file each, and the registry of kinds by address scheme.

A file that is added to this folder is found automatically. ``kind`` contains the registry. ``privileged`` contains the
code shared by built-in policies that read the simulator state, and ``remote`` the code shared by policies on servers. A
file imports simulators and server libraries only when a policy is created, because each process that uses a policy
imports the files of all kinds.
"""

from betterbench.errors import import_registering
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
    places_of_kinds,
    read_address,
    register,
)

import_registering(
    __name__,
    __path__[0],
    places_of_kinds,
    "Pass the policy kind to register",
    shared=("authoring", "kind", "privileged", "remote"),
)

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
