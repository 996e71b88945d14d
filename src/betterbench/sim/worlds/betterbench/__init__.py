"""Betterbench's own scenes as a world: the tasks of better60 and user-defined tasks, simulated in MuJoCo."""

from betterbench.sim.worlds.betterbench.world import OWN_WORLD, OwnWorld
from betterbench.sim.worlds.registry import register_world

register_world(OWN_WORLD)

__all__ = ["OWN_WORLD", "OwnWorld"]
