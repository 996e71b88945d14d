"""LIBERO-Plus as a world, with variants of LIBERO's tasks on seven axes.

- ``world``: variants as trials, and the authors' assets folder.
- ``simulator``, ``noise``: the process, which runs in an environment without betterbench.
"""

from betterbench.sim.worlds.libero_plus.world import LiberoPlusWorld, VariantTask, plus_command
from betterbench.sim.worlds.registry import register_world

register_world(LiberoPlusWorld())

__all__ = ["LiberoPlusWorld", "VariantTask", "plus_command"]
