"""LIBERO and LIBERO-PRO as a world.

- ``world``: plans of runs, the simulator's command, and images of recorded states. The scene of a trial is defined in
  :mod:`betterbench.sim.worlds.scene`.
- ``simulator``, ``relations``: code of the simulator process, which runs in an environment without betterbench.
"""

from betterbench.sim.worlds.libero.world import LiberoWorld
from betterbench.sim.worlds.registry import register_world

register_world(LiberoWorld())

__all__ = ["LiberoWorld"]
