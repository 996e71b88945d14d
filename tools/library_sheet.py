"""Render the procedural asset library into one contact sheet.

Each category is a strip of four pictures from the angle of the front camera: three looks in its default color, seen
from three sides, and one look in another color, where it has one. Strips stand in three columns. Run from the
repository root::

    MUJOCO_GL=egl python tools/library_sheet.py library.png
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from betterbench.assets import Asset, VisualPart, build, categories, colors, looks

# The front camera stands at (1.6, 0, 0.9) m and looks at the table some 0.5 m from the robot: about 35 degrees down.
_ELEVATION_DEGREES = -35.0
_PITCH = 1.0  # distance of the assets in the common scene [m]; far enough for no two to share a picture
LOOKS = 3  # looks of a category that are shown in its default color
_LABEL = 22  # height of a strip's title [pixels]
_MARGIN = 12  # between two columns [pixels]


def add_visual(spec: mujoco.MjSpec, body: mujoco.MjsBody, visual: VisualPart, name: str) -> None:
    """Add one visual part to a body.

    Args:
        spec: The model being built.
        body: Where to attach it.
        visual: The part.
        name: Unique name for its mesh, material and texture.
    """
    mesh = spec.add_mesh(name=name)
    mesh.uservert = visual.vertices.ravel()
    mesh.userface = visual.faces.ravel()
    mesh.smoothnormal = visual.smooth
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    material = spec.add_material(name=name, rgba=visual.rgba, specular=visual.specular, shininess=visual.shininess)
    if visual.texture is not None:
        height, width = visual.texture.pixels.shape[:2]
        texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height)
        texture.nchannel = 3
        # MuJoCo puts the first row of the data at v = 0, the asset's picture starts at the top.
        texture.data = np.ascontiguousarray(visual.texture.pixels[::-1]).tobytes()
        mesh.usertexcoord = visual.texture.uv.ravel()
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name)
    geom.contype = geom.conaffinity = 0


def scene(rows: Sequence[Sequence[Asset]]) -> mujoco.MjModel:
    """Compile one model with every asset at its own place.

    Args:
        rows: Assets by row and column of the sheet.
    """
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
    for i, row in enumerate(rows):
        for j, asset in enumerate(row):
            body = spec.worldbody.add_body(pos=[i * _PITCH, j * _PITCH, 0.0])
            for visual in asset.visual:
                add_visual(spec, body, visual, f"{i}_{j}_{visual.name}")
    return spec.compile()


def picture(
    renderer: mujoco.Renderer, data: mujoco.MjData, place: tuple[int, int], asset: Asset, *, zoom: float, azimuth: float
) -> np.ndarray:
    """Return one rendered picture (height, width, 3) of the asset at a place of the common scene."""
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (place[0] * _PITCH, place[1] * _PITCH, 0.47 * asset.size_m[2])
    reach = math.hypot(*asset.size_m)
    camera.distance = reach / (0.72 * zoom) / (2.0 * math.tan(math.radians(22.5)))
    camera.azimuth, camera.elevation = azimuth, _ELEVATION_DEGREES
    renderer.update_scene(data, camera)
    return np.asarray(renderer.render())


def strip(name: str, *, pixels: int) -> Image.Image:
    """Return the labeled pictures of one category.

    Args:
        name: The category.
        pixels: Size of one picture.
    """
    words = colors(name)
    assets = [build(name, look=k % len(looks(name))) for k in range(LOOKS)]
    other = words[1 % len(words)]
    assets.append(build(name, look=LOOKS % len(looks(name)), color=other))
    # One scene per category: a shadow map that had to cover all of them would be coarse.
    model = scene([assets])
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    image = Image.new("RGB", (len(assets) * pixels, pixels + _LABEL), "white")
    length, width, height = (round(1000 * side) for side in assets[0].size_m)
    title = f"{name}  {length} x {width} x {height} mm"
    ImageDraw.Draw(image).text((4, 4), title, fill="black", font=ImageFont.load_default(14))
    with mujoco.Renderer(model, 2 * pixels, 2 * pixels) as renderer:
        for j, asset in enumerate(assets):
            shot = picture(renderer, data, (0, j), asset, zoom=1.0, azimuth=180.0 + (0.0, -35.0, 35.0)[j % 3])
            small = Image.fromarray(shot).resize((pixels, pixels), Image.Resampling.LANCZOS)
            image.paste(small, (j * pixels, _LABEL))
    return image


def sheet(names: Sequence[str], *, columns: int = 3, pixels: int = 144) -> Image.Image:
    """Return the contact sheet; categories follow each other down the columns.

    Args:
        names: Categories.
        columns: Number of strips beside each other.
        pixels: Size of one picture.
    """
    strips = [strip(name, pixels=pixels) for name in names]
    width, height = strips[0].size
    rows = -(-len(strips) // columns)
    image = Image.new("RGB", (columns * (width + _MARGIN) - _MARGIN, rows * height), "white")
    for i, one in enumerate(strips):
        image.paste(one, ((i // rows) * (width + _MARGIN), (i % rows) * height))
    return image


def main() -> None:
    """Parse the command line and write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("out", type=Path, help="PNG to write")
    parser.add_argument("--categories", nargs="*", default=None, help="only these categories")
    parser.add_argument("--columns", type=int, default=3, help="categories beside each other")
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    sheet(options.categories or categories(), columns=options.columns).save(options.out, optimize=True)
    print(options.out)


if __name__ == "__main__":
    main()
