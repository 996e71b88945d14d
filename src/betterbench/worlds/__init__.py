"""Foreign worlds: simulators that live in environments of their own and answer over a local socket.

Each public name is imported from its module when it is first used: a run in our own scenes reads nothing of CALVIN.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from betterbench.worlds.calvin import CHAIN_SUITES, ChainScene, ChainSettings, ChainTask, calvin_command
    from betterbench.worlds.libero import (
        PLUS_SUITES,
        PROTOCOLS,
        SUITES,
        FieldProtocol,
        Suite,
        protocol_named,
        suite_named,
    )
    from betterbench.worlds.libero_plus_scene import PlusSettings, VariantTask, plus_command, world_command
    from betterbench.worlds.process import WorldError, WorldProcess, WorldProcesses
    from betterbench.worlds.registry import WORLDS, ForeignWorld, world_named
    from betterbench.worlds.scene import ForeignScene, ForeignTracker, WorldSettings, WorldTask

__all__ = [
    "CHAIN_SUITES",
    "PLUS_SUITES",
    "PROTOCOLS",
    "SUITES",
    "WORLDS",
    "ChainScene",
    "ChainSettings",
    "ChainTask",
    "FieldProtocol",
    "ForeignScene",
    "ForeignTracker",
    "ForeignWorld",
    "PlusSettings",
    "Suite",
    "VariantTask",
    "WorldError",
    "WorldProcess",
    "WorldProcesses",
    "WorldSettings",
    "WorldTask",
    "calvin_command",
    "plus_command",
    "protocol_named",
    "suite_named",
    "world_command",
    "world_named",
]

_MODULES = {
    "calvin": ("CHAIN_SUITES", "ChainScene", "ChainSettings", "ChainTask", "calvin_command"),
    "libero": ("PLUS_SUITES", "PROTOCOLS", "SUITES", "FieldProtocol", "Suite", "protocol_named", "suite_named"),
    "libero_plus_scene": ("PlusSettings", "VariantTask", "plus_command", "world_command"),
    "process": ("WorldError", "WorldProcess", "WorldProcesses"),
    "registry": ("WORLDS", "ForeignWorld", "world_named"),
    "scene": ("ForeignScene", "ForeignTracker", "WorldSettings", "WorldTask"),
}
_HOMES = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import the module of a name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
