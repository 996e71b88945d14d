"""LIBERO-Plus as a world, with variants of LIBERO's tasks along seven axes.

- ``world``: plans with variants as trials, and the folder of assets published by the authors.
- ``simulator``, ``noise``: code of the simulator process, which runs in an environment without betterbench.
"""

from betterbench.sim.worlds.libero_plus.world import LiberoPlusWorld, VariantTask, plus_command
from betterbench.sim.worlds.registry import register_world

register_world(LiberoPlusWorld())

__all__ = ["LiberoPlusWorld", "VariantTask", "plus_command"]
