"""Image that shows the picture, the score and the license of each asset that a search found."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.report.figures.image_sheet import SheetCell, image_sheet

if TYPE_CHECKING:
    from betterbench.sim.assets.catalogue.search import Hit

_PIXELS = 192
_COLUMNS = 5


def asset_sheet(hits: Sequence[tuple[str, Hit]]) -> np.ndarray:
    """Draw the found assets in one image (height, width, 3) uint8.

    Args:
        hits: Asset id and search hit of each asset.

    Raises:
        MissingDependencyError: If an asset has to be rendered and off-screen OpenGL does not work on this machine.
    """
    cells = [
        SheetCell(_title(asset), [_picture(asset, hit)], f"{hit.score:.2f}  {hit.entry.license or 'license unknown'}")
        for asset, hit in hits
    ]
    return image_sheet([cells[start : start + _COLUMNS] for start in range(0, len(cells), _COLUMNS)])


def _title(asset: str) -> str:
    """Return the last part of an asset id. If it is a generic file name ("model.obj"), return the part before it."""
    parts = Path(asset).parts
    generic = len(parts) > 2 and Path(parts[-1]).stem in ("textured", "model", "mesh", "scene")
    return parts[-2] if generic else parts[-1]


def _picture(asset: str, hit: Hit) -> np.ndarray:
    from betterbench.sim.assets.catalogue.drawing import mesh_picture
    from betterbench.sim.assets.catalogue.sources import procedural

    if hit.entry.source == procedural.NAME:
        from betterbench.sim.assets import build
        from betterbench.sim.scenes.portraits import asset_portrait

        category, color, look = procedural.asset_address(asset)
        return asset_portrait(build(category, look=look, color=color), pixels=_PIXELS, turned_degrees=-25.0)
    if hit.entry.path:
        try:
            return mesh_picture(Path(hit.entry.path), pixels=_PIXELS)
        except InvalidInputError as error:
            return _tile(f"{hit.entry.name}\n\n{error.problem}")
    return _tile(f"{hit.entry.name}\n\nnot downloaded")


def _tile(text: str) -> np.ndarray:
    """Return an image that contains only the given text, for an asset that cannot be drawn."""
    from PIL import Image, ImageDraw

    image = Image.new("RGB", (_PIXELS, _PIXELS), (226, 224, 220))
    lines = [line for part in text.split("\n") for line in textwrap.wrap(part, 28) or [""]]
    shown = "\n".join(lines[:12]).encode("latin-1", "replace").decode("latin-1")
    ImageDraw.Draw(image).multiline_text((10, 10), shown, fill=(70, 70, 74))
    return np.asarray(image)
