"""Privileged policies: the expert, and the faulty policies that calibrate the diagnosis."""

from betterbench.experts.privileged import PrivilegedAgent
from betterbench.experts.registry import EXPERTS, REPLAYS, Address, expert_names, make_expert, parse_address

__all__ = ["EXPERTS", "REPLAYS", "Address", "PrivilegedAgent", "expert_names", "make_expert", "parse_address"]
