"""LIBERO and LIBERO-PRO as a world.

- ``world``: its plans, its command and its photos; the scene of a trial is that of :mod:`betterbench.sim.worlds.scene`.
- ``simulator``, ``relations``: its process, which runs where betterbench is not installed.
"""

from betterbench.sim.worlds.libero.world import LiberoWorld
from betterbench.sim.worlds.registry import register_world

register_world(LiberoWorld())

__all__ = ["LiberoWorld"]
