"""Images for the certificate of an asset: its visual shape, its collision shape, and its pose at rest."""

from __future__ import annotations

import colorsys
from dataclasses import replace

import numpy as np

from betterbench.sim.asset_checks.rest import settled
from betterbench.sim.assets import Asset, VisualPart
from betterbench.sim.assets.importing.measures import convex_surface, corners_of
from betterbench.sim.scenes.portraits import asset_portrait

_GOLDEN = 0.618034
"""Difference in hue between one collision part and the next, chosen so that neighboring parts look different."""


def asset_pictures(asset: Asset, *, pixels: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw three images of an asset: its visible parts, its collision parts, and its pose at rest.

    Each image is a (pixels, pixels, 3) uint8 array.

    Raises:
        MissingDependencyError: If off-screen OpenGL does not work on this machine.
    """
    touched = tuple(_colored(k, *convex_surface(corners_of(part))) for k, part in enumerate(asset.collision))
    pose = settled(asset).pose
    turned = tuple(
        replace(part, vertices=np.array([pose.apply(v) for v in part.vertices.tolist()], np.float32))
        for part in asset.visual
    )
    shown = (
        (asset, -25.0),
        (replace(asset, visual=touched), -25.0),
        (replace(asset, visual=turned), 65.0),
    )
    one, two, three = (asset_portrait(each, pixels=pixels, turned_degrees=turn) for each, turn in shown)
    return one, two, three


def _colored(number: int, vertices: np.ndarray, faces: np.ndarray) -> VisualPart:
    r, g, b = colorsys.hsv_to_rgb((number * _GOLDEN) % 1.0, 0.55, 0.9)
    return VisualPart(
        f"touched{number}", vertices.astype(np.float32), faces.astype(np.int32), (r, g, b, 1.0), smooth=False
    )
