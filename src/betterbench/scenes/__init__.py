"""Scenes: assets, robot and furniture composed into one compiled MuJoCo model, stepped, rendered and checked."""

from betterbench.scenes.builder import CompiledScene, Placement, engine_version, place_objects
from betterbench.scenes.clearance import Clearance
from betterbench.scenes.gl_context import gl_backend, renderer_fingerprint
from betterbench.scenes.rendering import Images, Renderer
from betterbench.scenes.scene import CONTROL_RATE_HZ, TIMESTEP_S, Scene, SceneSnapshot
from betterbench.scenes.stored import StoredView, load_model

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
    "engine_version",
    "gl_backend",
    "load_model",
    "place_objects",
    "renderer_fingerprint",
]
