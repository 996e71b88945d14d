"""Foreign worlds: simulators that live in environments of their own and answer over a local socket."""

from betterbench.worlds.calvin import CHAIN_SUITES, ChainScene, ChainSettings, ChainTask, calvin_command
from betterbench.worlds.libero import PROTOCOLS, SUITES, FieldProtocol, Suite, protocol_named, suite_named
from betterbench.worlds.process import WorldError, WorldProcess, WorldProcesses
from betterbench.worlds.registry import WORLDS, ForeignWorld, world_named
from betterbench.worlds.scene import ForeignScene, ForeignTracker, WorldSettings, WorldTask

__all__ = [
    "CHAIN_SUITES",
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
    "Suite",
    "WorldError",
    "WorldProcess",
    "WorldProcesses",
    "WorldSettings",
    "WorldTask",
    "calvin_command",
    "protocol_named",
    "suite_named",
    "world_named",
]
