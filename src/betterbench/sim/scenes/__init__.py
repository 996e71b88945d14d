"""Scenes: assets, robot and furniture, combined in one compiled MuJoCo model.

- ``builder``, ``appearance``, ``objects``, ``stage``, ``rooms``, ``surfaces``: code that builds a model from a
  condition and a seed.
- ``scene``, ``contacts``, ``clearance``: the state of a scene, its reset and step, its contacts, and collision checks
  for planners.
- ``rendering``, ``gl_context``, ``cameras``, ``culling``, ``framing``, ``sights``, ``instances``: images of a scene and
  what they show.
- ``stored``, ``limited``, ``glb``: compiled scenes on disk, opened in a process with limits, or exported for other
  viewers.

Each public name is imported from its module when it is first used, so that a process that only renders does not import
the code that builds scenes.
"""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names
from betterbench.sim.graphics import gl_backend, require_engine

if TYPE_CHECKING:
    from betterbench.sim.scenes.builder import CompiledScene, Placement, engine_version, place_objects
    from betterbench.sim.scenes.clearance import Clearance
    from betterbench.sim.scenes.gl_context import renderer_fingerprint
    from betterbench.sim.scenes.objects import add_asset, rest_pose
    from betterbench.sim.scenes.rendering import Images, Renderer
    from betterbench.sim.scenes.scene import CONTROL_RATE_HZ, TIMESTEP_S, Scene, SceneSnapshot
    from betterbench.sim.scenes.stage import quality_preset
    from betterbench.sim.scenes.stored import StoredView, load_model

require_engine()  # checked before MuJoCo reads these variables at import, because MuJoCo's own error names no remedy

__all__ = [
    "CONTROL_RATE_HZ",
    "TIMESTEP_S",
    "Clearance",
    "CompiledScene",
    "Images",
    "Placement",
    "Renderer",
    "Scene",
    "SceneSnapshot",
    "StoredView",
    "add_asset",
    "engine_version",
    "gl_backend",
    "load_model",
    "place_objects",
    "quality_preset",
    "renderer_fingerprint",
    "rest_pose",
]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(
        __name__,
        {
            "builder": ("CompiledScene", "Placement", "engine_version", "place_objects"),
            "clearance": ("Clearance",),
            "gl_context": ("renderer_fingerprint",),
            "objects": ("add_asset", "rest_pose"),
            "rendering": ("Images", "Renderer"),
            "scene": ("CONTROL_RATE_HZ", "TIMESTEP_S", "Scene", "SceneSnapshot"),
            "stage": ("quality_preset",),
            "stored": ("StoredView", "load_model"),
        },
    )
