"""Coloured wooden blocks."""

from __future__ import annotations

import math

import numpy as np

from betterbench.assets.authoring.draft import Draft, grip, part, zone
from betterbench.assets.authoring.mesh import box, mapped
from betterbench.assets.authoring.paint import PALETTE, Canvas, jittered
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import solid_box


@generator("block", colours=("red", "blue", "green", "yellow", "orange", "purple", "white", "black", "brown"))
def block(rng: np.random.Generator, colour: str) -> Draft:
    """Make a painted wooden cube or cuboid with bevelled edges.

    Beech has a density of 700 kg/m^3.
    """
    x, y, z = sorted((float(e) for e in rng.uniform(0.034, 0.058, 3)), reverse=True)
    if rng.random() < 0.4:
        x = z = y
    bevel = rng.uniform(0.0018, 0.0035)
    shade = jittered(PALETTE[colour], rng)
    canvas = Canvas(1.0, 1.0, (64, 64), shade)
    canvas.shade(1.0 + 0.03 * np.sin(2.0 * math.pi * (9.0 * canvas.y + 0.35 * np.sin(5.0 * canvas.x))))
    canvas.grain(rng, cells=(3, 24), amount=0.05)
    mesh = mapped(box((x, y, z), (0.0, 0.0, z / 2), bevel=bevel, corner=bevel), (0.8, 0.6, 0.0), (-0.35, 0.35, 0.87))
    collision = (solid_box((-x / 2, -y / 2, 0.0), (x / 2, y / 2, z)),)
    return Draft(
        shape="box",
        description=f"A {colour} wooden toy block.",
        tags=("block", "cube", "cuboid", "wood", "toy"),
        mass_kg=round(700.0 * x * y * z, 4),
        parts=(part("block", mesh, canvas, specular=0.25), *collision),
        grasps=(
            grip("body", z / 2, y),
            grip("long", z / 2, x, across="x", preference=1),
        ),
        regions=(
            zone("top", x / 2, y / 2, z),
            zone("base", x / 2, y / 2),
        ),
        parameters={"x_m": x, "y_m": y, "z_m": z, "bevel_m": bevel},
    )
