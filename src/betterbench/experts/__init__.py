"""Privileged experts and the calibration zoo: skills that see the truth, minds that are right or wrong on purpose."""

from betterbench.experts.privileged import PrivilegedAgent
from betterbench.experts.registry import EXPERTS, REPLAYS, Address, expert_names, make_expert, parse_address

__all__ = ["EXPERTS", "REPLAYS", "Address", "PrivilegedAgent", "expert_names", "make_expert", "parse_address"]
