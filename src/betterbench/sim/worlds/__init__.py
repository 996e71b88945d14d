"""Foreign worlds: simulators in separate environments that communicate over a local socket.

Each public name is imported from its module at first use: a run in our own scenes does not import CALVIN.
"""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from betterbench.sim.worlds.calvin import ChainScene, ChainSettings, ChainTask, calvin_command
    from betterbench.sim.worlds.libero_plus_scene import PlusSettings, VariantTask, plus_command, world_command
    from betterbench.sim.worlds.process import WorldError, WorldProcess, WorldProcesses
    from betterbench.sim.worlds.registry import WORLDS, ForeignWorld, world_named
    from betterbench.sim.worlds.scene import ForeignScene, ForeignTracker, WorldSettings, WorldTask

__all__ = [
    "WORLDS",
    "ChainScene",
    "ChainSettings",
    "ChainTask",
    "ForeignScene",
    "ForeignTracker",
    "ForeignWorld",
    "PlusSettings",
    "VariantTask",
    "WorldError",
    "WorldProcess",
    "WorldProcesses",
    "WorldSettings",
    "WorldTask",
    "calvin_command",
    "plus_command",
    "world_command",
    "world_named",
]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(
        __name__,
        {
            "calvin": ("ChainScene", "ChainSettings", "ChainTask", "calvin_command"),
            "libero_plus_scene": ("PlusSettings", "VariantTask", "plus_command", "world_command"),
            "process": ("WorldError", "WorldProcess", "WorldProcesses"),
            "registry": ("WORLDS", "ForeignWorld", "world_named"),
            "scene": ("ForeignScene", "ForeignTracker", "WorldSettings", "WorldTask"),
        },
    )
