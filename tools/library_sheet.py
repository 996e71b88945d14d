"""Render the procedural asset library into one contact sheet.

Each category is a strip of four pictures from the front camera's angle. Three pictures show looks in the default color,
seen from three sides. The last one shows a look in another color, if there is one. Strips are arranged in three
columns. Run from the repository root::

    MUJOCO_GL=egl python tools/library_sheet.py library.png
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from betterbench.geometry import Pose
from betterbench.report.figures.image_sheet import SheetCell, image_sheet
from betterbench.sim.assets import Asset, build, categories, colors, looks
from betterbench.sim.scenes.objects import add_asset

# The front camera is at (1.6, 0, 0.9) m and looks at the table about 0.5 m from the robot: about 35 degrees down.
_ELEVATION_DEGREES = -35.0
_PITCH = 1.0  # distance between the assets in the common scene [m]; far enough that no two share a picture
LOOKS = 3  # looks of a category that are shown in its default color


def scene(assets: Sequence[Asset]) -> mujoco.MjModel:
    """Return one static model with all assets in a row and without collisions."""
    spec = mujoco.MjSpec()
    spec.visual.headlight.ambient = [0.32, 0.32, 0.32]
    spec.visual.headlight.diffuse = [0.30, 0.30, 0.30]
    spec.visual.headlight.specular = [0.1, 0.1, 0.1]
    spec.visual.global_.offwidth = spec.visual.global_.offheight = 512
    spec.visual.quality.shadowsize = 4096
    spec.visual.map.znear = 0.002
    spec.worldbody.add_light(
        pos=[0, 0, 3], dir=[-0.35, 0.45, -1.0], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, diffuse=[0.55, 0.54, 0.52]
    )
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], rgba=[0.80, 0.76, 0.70, 1])
    for i, asset in enumerate(assets):
        add_asset(spec, f"asset{i}", asset, pose=Pose((0.0, i * _PITCH, 0.0)))
    return spec.compile()


def picture(renderer: mujoco.Renderer, data: mujoco.MjData, place: int, asset: Asset, azimuth: float) -> np.ndarray:
    """Return one rendered picture (height, width, 3) of the asset at a place in the row."""
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (0.0, place * _PITCH, 0.47 * asset.size_m[2])
    camera.distance = math.hypot(*asset.size_m) / 0.72 / (2.0 * math.tan(math.radians(22.5)))
    camera.azimuth, camera.elevation = azimuth, _ELEVATION_DEGREES
    renderer.update_scene(data, camera)
    return np.asarray(renderer.render())


def strip(name: str, *, pixels: int) -> SheetCell:
    """Return the labeled pictures of one category, each with sides of ``pixels``."""
    words = colors(name)
    assets = [build(name, look=k % len(looks(name))) for k in range(LOOKS)]
    assets.append(build(name, look=LOOKS % len(looks(name)), color=words[1 % len(words)]))
    # One scene per category: a shadow map that had to cover all of them would be coarse.
    model = scene(assets)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    shots = []
    with mujoco.Renderer(model, 2 * pixels, 2 * pixels) as renderer:
        for j, asset in enumerate(assets):
            shot = picture(renderer, data, j, asset, 180.0 + (0.0, -35.0, 35.0)[j % 3])
            shots.append(np.asarray(Image.fromarray(shot).resize((pixels, pixels), Image.Resampling.LANCZOS)))
    length, width, height = (round(1000 * side) for side in assets[0].size_m)
    return SheetCell(f"{name}  {length} x {width} x {height} mm", shots)


def sheet(names: Sequence[str], *, columns: int = 3, pixels: int = 144) -> Image.Image:
    """Return the contact sheet; categories follow each other down the columns."""
    strips = [strip(name, pixels=pixels) for name in names]
    rows = -(-len(strips) // columns)
    return Image.fromarray(image_sheet([strips[row::rows] for row in range(rows)]))


def main() -> None:
    """Parse the command line and write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("out", type=Path, help="PNG to write")
    parser.add_argument("--categories", nargs="*", default=None, help="only these categories")
    parser.add_argument("--columns", type=int, default=3, help="number of columns")
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    sheet(options.categories or categories(), columns=options.columns).save(options.out, optimize=True)
    print(options.out)


if __name__ == "__main__":
    main()
