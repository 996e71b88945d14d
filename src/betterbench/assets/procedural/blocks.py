"""Colored wooden blocks."""

from __future__ import annotations

import math

import numpy as np

from betterbench.assets.asset import Grasp
from betterbench.assets.procedural.body import JAW_OPENS_ALONG_X, JAW_OPENS_ALONG_Y, mass_properties, solid_box
from betterbench.assets.procedural.mesh import box, mapped
from betterbench.assets.procedural.paint import PALETTE, Canvas, jittered
from betterbench.assets.procedural.registry import Draft, generator, part
from betterbench.geometry import Pose
from betterbench.state import Region


@generator("block", colors=("red", "blue", "green", "yellow", "orange", "purple", "white", "black", "brown"))
def block(rng: np.random.Generator, color: str) -> Draft:
    """Make a painted wooden cube or cuboid with bevelled edges.

    Beech has a density of 700 kg/m^3.

    Args:
        rng: Source of proportions and grain.
        color: Color word.

    Returns:
        The draft.
    """
    x, y, z = sorted((float(e) for e in rng.uniform(0.034, 0.058, 3)), reverse=True)
    if rng.random() < 0.4:
        x = z = y
    bevel = float(rng.uniform(0.0018, 0.0035))
    shade = jittered(PALETTE[color], rng)
    canvas = Canvas(1.0, 1.0, (64, 64), shade)
    canvas.shade(1.0 + 0.03 * np.sin(2.0 * math.pi * (9.0 * canvas.y + 0.35 * np.sin(5.0 * canvas.x))))
    canvas.grain(rng, cells=(3, 24), amount=0.05)
    mesh = mapped(box((x, y, z), (0.0, 0.0, z / 2), bevel=bevel, corner=bevel), (0.8, 0.6, 0.0), (-0.35, 0.35, 0.87))
    collision = (solid_box((-x / 2, -y / 2, 0.0), (x / 2, y / 2, z)),)
    return Draft(
        shape="box",
        description=f"A {color} wooden toy block.",
        tags=("block", "cube", "cuboid", "wood", "toy", color),
        body=mass_properties(collision, round(700.0 * x * y * z, 4)),
        visual=(part("block", mesh, shade, picture=canvas.pixels(), specular=0.25),),
        collision=collision,
        grasps=(
            Grasp("body", Pose((0.0, 0.0, z / 2), JAW_OPENS_ALONG_Y), y),
            Grasp("long", Pose((0.0, 0.0, z / 2), JAW_OPENS_ALONG_X), x, preference=1),
        ),
        regions=(
            Region("top", (0.0, 0.0, z), (x / 2, y / 2, 0.001)),
            Region("base", (0.0, 0.0, 0.0), (x / 2, y / 2, 0.001)),
        ),
        parameters={"x_m": x, "y_m": y, "z_m": z, "bevel_m": bevel},
    )
