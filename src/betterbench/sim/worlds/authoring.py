"""Names to import in a file that adds a world (see docs/adding-a-world.md)."""

from typing import TYPE_CHECKING

from betterbench.interface.actions import TRANSLATION_PER_UNIT_M
from betterbench.lazy_names import lazy_names
from betterbench.sim.worlds.bare import BareScene, bare_object
from betterbench.sim.worlds.registry import register_world
from betterbench.sim.worlds.world import PlanRequest, SceneOptions, TrialScene, World
from betterbench.tasks import stream
from betterbench.tasks.trial import Trial
from betterbench.tasks.worlds.facts import Suite, WorldFacts

if TYPE_CHECKING:
    from betterbench.sim.scenes.rendering import Images

__all__ = [
    "TRANSLATION_PER_UNIT_M",
    "BareScene",
    "Images",
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

if not TYPE_CHECKING:
    # A world without images needs no renderer.
    __getattr__ = lazy_names("betterbench.sim.scenes", {"rendering": ("Images",)})
