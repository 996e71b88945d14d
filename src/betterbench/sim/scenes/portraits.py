"""Images of single assets in front of a plain background."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from betterbench.geometry import Pose
from betterbench.sim.assets import Asset
from betterbench.sim.scenes.objects import add_asset
from betterbench.sim.scenes.rendering import Renderer
from betterbench.sim.scenes.stage import QUALITIES, add_camera

_FIELD_DEGREES = 45.0
_DOWN = math.radians(35.0)
"""Angle by which the camera looks down, as the front camera of the scenes does [rad]."""
_FILLED = 0.72
"""Size of the asset in the image: diagonal of the asset's bounding box, as a fraction of the image's side."""
_SMALLER = 2
"""Supersampling factor along each side of the image, for antialiasing."""


def asset_portrait(asset: Asset, *, pixels: int, turned_degrees: float = 0.0) -> np.ndarray:
    """Render an image of an asset as a (pixels, pixels, 3) uint8 array.

    Args:
        asset: Asset to render.
        pixels: Width and height of the image.
        turned_degrees: Angle about the vertical between the camera and the front of the asset.

    Raises:
        MissingDependencyError: If off-screen OpenGL does not work on this machine.
    """
    spec = mujoco.MjSpec()
    spec.visual.headlight.ambient = [0.32, 0.32, 0.32]
    spec.visual.headlight.diffuse = [0.30, 0.30, 0.30]
    spec.visual.headlight.specular = [0.1, 0.1, 0.1]
    spec.visual.map.znear = 0.002
    spec.worldbody.add_light(
        pos=[0, 0, 3],
        dir=[-0.35, 0.45, -1.0],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=[0.55, 0.54, 0.52],
        castshadow=False,  # the shadow map does not cover the infinite ground, whose far part would have speckles
    )
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], rgba=[0.80, 0.76, 0.70, 1])
    add_asset(spec, "asset", asset, pose=Pose())
    turn = math.radians(turned_degrees)
    distance = math.hypot(*asset.size_m) / _FILLED / (2.0 * math.tan(math.radians(_FIELD_DEGREES / 2.0)))
    middle = 0.47 * asset.size_m[2]
    away = distance * math.cos(_DOWN)
    position = (away * math.cos(turn), away * math.sin(turn), middle + distance * math.sin(_DOWN))
    add_camera(spec.worldbody, "portrait", position, (0.0, 0.0, middle), fovy_deg=_FIELD_DEGREES)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    side = pixels * _SMALLER
    with Renderer(model, width=side, height=side, quality=QUALITIES["high"]) as renderer:
        image = renderer.render(data, "portrait").rgb
    if image is None:
        raise ValueError("no colors were rendered")
    small = image.reshape(pixels, _SMALLER, pixels, _SMALLER, 3).mean(axis=(1, 3))
    return np.asarray(np.rint(small), np.uint8)
