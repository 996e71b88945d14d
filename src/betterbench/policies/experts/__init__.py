"""Privileged policies, which read the simulator state: the expert, and faulty policies that calibrate the diagnosis.

Each public name is imported when it is first used, so that addresses can be parsed without loading a simulator.
"""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from betterbench.policies.experts.address import Address
    from betterbench.policies.experts.privileged import PrivilegedAgent, make_expert
    from betterbench.policies.experts.registry import EXPERTS, REPLAYS, expert_names, parse_address

__all__ = ["EXPERTS", "REPLAYS", "Address", "PrivilegedAgent", "expert_names", "make_expert", "parse_address"]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(
        __name__,
        {
            "address": ("Address",),
            "privileged": ("PrivilegedAgent", "make_expert"),
            "registry": ("EXPERTS", "REPLAYS", "expert_names", "parse_address"),
        },
    )
