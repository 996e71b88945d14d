"""Privileged experts and the calibration zoo: skills that see the truth, minds that are right or wrong on purpose."""

from betterbench.experts.privileged import PrivilegedAgent
from betterbench.experts.registry import EXPERTS, expert_names, make_expert
from betterbench.experts.zoo import true_label

__all__ = ["EXPERTS", "PrivilegedAgent", "expert_names", "make_expert", "true_label"]
