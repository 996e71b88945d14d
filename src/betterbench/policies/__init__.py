"""Policies that see only observations: reference policies, and clients of real ones."""

from betterbench.policies.plugin import load_plugin, source_of
from betterbench.policies.reference import Noop, Random
from betterbench.policies.replay import Replay

__all__ = ["Noop", "Random", "Replay", "load_plugin", "source_of"]
