"""Privileged policies: the expert, and the faulty policies that calibrate the diagnosis."""

from typing import TYPE_CHECKING

from betterbench.policies.experts.registry import EXPERTS, REPLAYS, Address, expert_names, parse_address

if TYPE_CHECKING:
    from betterbench.policies.experts.privileged import PrivilegedAgent, make_expert

__all__ = ["EXPERTS", "REPLAYS", "Address", "PrivilegedAgent", "expert_names", "make_expert", "parse_address"]


def __getattr__(name: str) -> object:
    """Import what needs a simulator when it is asked for; the list of policies needs none."""
    if name not in ("PrivilegedAgent", "make_expert"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from betterbench.policies.experts import privileged  # noqa: PLC0415

    return getattr(privileged, name)
