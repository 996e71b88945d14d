"""Generator of woven fruit baskets."""

import math

import numpy as np

from betterbench.sim.assets.authoring import (
    Draft,
    Rgb,
    Turned,
    disc,
    flared_walls,
    generator,
    jittered,
    mixed,
    part,
    shaded,
    uniforms,
    zone,
)
from betterbench.sim.assets.authoring.paint import Canvas

_WALL, _FLOOR = 0.005, 0.006
_SIDES = 32

_WILLOW: dict[str, Rgb] = {"brown": (0.62, 0.42, 0.22), "cream": (0.86, 0.74, 0.52), "white": (0.90, 0.87, 0.80)}


@generator("fruit_basket", colors=("brown", "cream", "white"))
def fruit_basket(rng: np.random.Generator, color: str) -> Draft:
    """Make a low, round basket that is woven of willow and has a twisted rim.

    Bread and fruit baskets of this kind are 18 to 25 cm wide and 5 to 9 cm high, and weigh 0.15 to 0.3 kg.
    """
    rim, foot, height = uniforms(rng, (0.097, 0.104), (0.076, 0.083), (0.056, 0.066))
    rows, stakes, band = int(rng.integers(7, 11)), 2 * int(rng.integers(13, 19)), rng.random() < 0.5
    willow = jittered(_WILLOW[color], rng)
    # The rim is a thick rod around the upper edge.
    edge = 0.0045
    radii = (
        0.0,
        foot - 0.003,
        foot,
        rim - edge,
        rim,
        rim,
        rim - edge,
        rim - 2 * edge,
        rim - 2 * edge,
        foot - _WALL,
        0.0,
    )
    top = (height - 2.0 * edge, height - 1.4 * edge, height - 0.5 * edge, height)
    heights = (0.0, 0.0, 0.003, *top, height - 0.5 * edge, height - 2.0 * edge, _FLOOR, _FLOOR)
    shell = Turned(radii, heights, sides=_SIDES, crease_degrees=60.0)
    walls = flared_walls(foot, rim - 0.5 * edge, height, wall=_WALL, floor=_FLOOR)
    inside, half = 0.5 * (height - _FLOOR), 0.85 * (foot - _WALL)
    return Draft(
        shape="cylinder",
        description=f"A {color} woven fruit basket.",
        tags=("basket", "fruit basket", "bread basket", "container"),
        traits=("woven", "willow", "wicker"),
        mass_kg=round(26.0 * rim * height + 0.03, 3),
        densities=(3.0, 3.0, *(0.6,) * 8),
        material="wood",
        parts=(part("willow", shell.mesh(), _weave(rng, shell, willow, rows=rows, stakes=stakes, band=band)), *walls),
        regions=(
            zone("inside", half, half, _FLOOR + inside, half_z=inside),
            disc("floor", foot - _WALL - 0.004, _FLOOR),
            disc("opening", rim - 2 * edge, height),
            disc("rim", rim, height),
            disc("base", foot),
        ),
        parameters={"rim_radius_m": rim, "foot_radius_m": foot, "height_m": height, "rows": float(rows)},
    )


def _weave(rng: np.random.Generator, shell: Turned, willow: Rgb, *, rows: int, stakes: int, band: bool) -> Canvas:
    """Draw the texture of a basket, in which strands go over and under upright stakes.

    The texture runs from the bottom over the wall and the rim to the floor inside.
    """
    foot, low_edge, high_edge, floor = (shell.rows[k] for k in (2, 3, 8, 9))
    canvas = shell.canvas(willow, (256, 256))
    x, y = canvas.x, canvas.y
    dark, light = shaded(willow, 0.42), mixed(willow, (1.0, 0.95, 0.82), 0.35)
    outside, inside, rim = y < low_edge, canvas.between(high_edge, floor), canvas.between(low_edge, high_edge)
    # At each height, both sides of the wall show the same row of strands, so the strands seem to continue through the
    # wall.
    share = np.where(inside, 1.0 - (y - high_edge) / (floor - high_edge), (y - foot) / (low_edge - foot))
    across = x / canvas.width * 0.5 * stakes
    row = np.floor(share * rows)
    bulge = np.abs(np.sin(math.pi * share * rows))
    over = 0.5 + 0.5 * np.cos(math.pi * (across * 2.0 + row)) * np.where(inside, -1.0, 1.0)
    wall = (outside & (share > 0.0)) | inside
    canvas.grain(rng, cells=(60, 90), amount=0.05)
    canvas.paint(wall * np.clip(1.0 - bulge, 0.0, 1.0) ** 2, dark, strength=0.9)
    canvas.paint(wall * (1.0 - over) ** 3, dark, strength=0.75)
    canvas.paint(wall * over * bulge, light, strength=0.55)
    if band:
        stripe = wall & (np.abs(row - rows // 2) < 1.0)
        canvas.paint(stripe, shaded(willow, 0.55), strength=0.6)
    # Slanted strands make the rim look twisted.
    twist = np.sin(2.0 * math.pi * (across * 1.5 + 90.0 * (y - low_edge)))
    canvas.paint(rim * np.clip(twist, 0.0, 1.0), light, strength=0.5)
    canvas.paint(rim * np.clip(-twist, 0.0, 1.0), dark, strength=0.7)
    _floor(canvas, floor, dark, light)
    canvas.shade(np.where(inside, 0.80 + 0.15 * share, np.where(outside, 0.86 + 0.14 * np.clip(share, 0.0, 1.0), 1.0)))
    return canvas


def _floor(canvas: Canvas, first: float, dark: Rgb, light: Rgb) -> None:
    """Draw the floor, which consists of rings of strands over spokes. Its texture begins at row ``first``."""
    where = canvas.y > first
    ring = np.abs(np.sin(math.pi * (canvas.y - first) / 0.006))
    spoke = 0.5 + 0.5 * np.cos(2.0 * math.pi * canvas.x / canvas.width * 6.0)
    canvas.paint(where * (1.0 - ring) ** 2, dark, strength=0.8)
    canvas.paint(where * ring * spoke, light, strength=0.3)
    canvas.shade(np.where(where, 0.74, 1.0))
