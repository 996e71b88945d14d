"""LIBERO and LIBERO-PRO as a world.

- ``world``: plans, command and images. Trials use the scene of :mod:`betterbench.sim.worlds.scene`.
- ``simulator``, ``relations``: the process, which runs in an environment without betterbench.
"""

from betterbench.sim.worlds.libero.world import LiberoWorld
from betterbench.sim.worlds.registry import register_world

register_world(LiberoWorld())

__all__ = ["LiberoWorld"]
