"""Names to import in a file that adds a world (see docs/adding-a-world.md)."""

from betterbench.interface.actions import TRANSLATION_PER_UNIT_M
from betterbench.sim.worlds.bare import BareScene, bare_object
from betterbench.sim.worlds.registry import register_world
from betterbench.sim.worlds.world import PlanRequest, SceneOptions, TrialScene, World
from betterbench.tasks import stream
from betterbench.tasks.trial import Trial
from betterbench.tasks.worlds.facts import Suite, WorldFacts

__all__ = [
    "TRANSLATION_PER_UNIT_M",
    "BareScene",
    "PlanRequest",
    "SceneOptions",
    "Suite",
    "Trial",
    "TrialScene",
    "World",
    "WorldFacts",
    "bare_object",
    "register_world",
    "stream",
]
