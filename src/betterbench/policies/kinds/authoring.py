"""Public names for a file that adds a policy kind (see docs/adding-a-policy-kind.md)."""

from betterbench.policies.address import AddressForm, Option, PolicyAddress
from betterbench.policies.kinds.kind import (
    AT_ONCE,
    OWN_PROCESS,
    SERVER,
    STATE,
    PolicyKind,
    PolicyNeeds,
    kind_of,
    make_policy,
    register,
)

__all__ = [
    "AT_ONCE",
    "OWN_PROCESS",
    "SERVER",
    "STATE",
    "AddressForm",
    "Option",
    "PolicyAddress",
    "PolicyKind",
    "PolicyNeeds",
    "kind_of",
    "make_policy",
    "register",
]
