"""Living scenes: assets, robot and stage composed into one compiled MuJoCo model, stepped, rendered and checked."""

from betterbench.scenes.builder import CompiledScene, Placement, engine_version, place_objects
from betterbench.scenes.clearance import Clearance
from betterbench.scenes.scene import CONTROL_RATE_HZ, TIMESTEP_S, Scene

__all__ = [
    "CONTROL_RATE_HZ",
    "TIMESTEP_S",
    "Clearance",
    "CompiledScene",
    "Placement",
    "Scene",
    "engine_version",
    "place_objects",
]
