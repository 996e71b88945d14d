"""Painted wooden blocks: cuboids, and those that have the size of something else."""

import math

import numpy as np

from betterbench.assets.authoring import Draft, Turned, block, disc, generator, grip, part, zone
from betterbench.assets.authoring.mesh import mapped, slab
from betterbench.assets.authoring.paint import BUN, PALETTE, Canvas, Rgb, jittered, shaded
from betterbench.assets.authoring.solids import leaning_box, solid_box


def _painted_wood(
    rng: np.random.Generator, shade: Rgb, *, rings: float, waves: tuple[float, float, float], amount: float, cells: int
) -> Canvas:
    """Draw paint on wood: wavy year rings and grain.

    The ``waves`` are the number of year rings, and the height and number of their waves; ``rings`` and ``amount`` are
    the strengths of the rings and of the grain, ``cells`` is the number of fibers.
    """
    canvas = Canvas(1.0, 1.0, (64, 64), shade)
    count, height, number = waves
    canvas.shade(1.0 + rings * np.sin(2.0 * math.pi * (count * canvas.y + height * np.sin(number * canvas.x))))
    canvas.grain(rng, cells=(3, cells), amount=amount)
    return canvas


@generator("block", colors=("red", "blue", "green", "yellow", "orange", "purple", "white", "black", "brown"))
def toy_block(rng: np.random.Generator, color: str) -> Draft:
    """Make a painted cube or cuboid of beech (700 kg/m^3) with bevelled edges."""
    x, y, z = sorted((float(e) for e in rng.uniform(0.034, 0.058, 3)), reverse=True)
    if rng.random() < 0.4:
        x = z = y
    bevel = rng.uniform(0.0018, 0.0035)
    wood = _painted_wood(rng, jittered(PALETTE[color], rng), rings=0.03, waves=(9.0, 0.35, 5.0), amount=0.05, cells=24)
    low, high, axes = (-x / 2, -y / 2, 0.0), (x / 2, y / 2, z), ((0.8, 0.6, 0.0), (-0.35, 0.35, 0.87))
    return Draft(
        shape="box",
        description=f"A {color} wooden toy block.",
        tags=("block", "cube", "cuboid", "wood", "toy"),
        mass_kg=round(700.0 * x * y * z, 4),
        parts=block("block", low, high, wood, bevel=bevel, corner=bevel, view=axes, specular=0.25),
        grasps=(grip("body", z / 2, y), grip("long", z / 2, x, across="x", preference=1)),
        regions=(zone("top", x / 2, y / 2, z), zone("base", x / 2, y / 2)),
        parameters={"x_m": x, "y_m": y, "z_m": z, "bevel_m": bevel},
    )


@generator("stapler_block", colors=("black", "red", "blue"))
def stapler_block(rng: np.random.Generator, color: str) -> Draft:
    """Make a painted wooden wedge with the size and outline of a stapler: no gap, no metal, bevelled edges.

    Beech of 700 kg/m^3 would weigh 0.15 kg at this size; the block has a stapler's 0.22 kg, as a denser wood has, so
    that it differs from a stapler for the eye alone.
    """
    length, width, height = rng.uniform(0.121, 0.128), rng.uniform(0.0345, 0.0365), rng.uniform(0.053, 0.057)
    rear, front = height * rng.uniform(0.48, 0.60), height * rng.uniform(0.86, 1.0)
    bevel = rng.uniform(0.0020, 0.0032)
    shade = jittered(shaded(PALETTE[color], 1.25) if color == "black" else PALETTE[color], rng)
    half, side = 0.5 * length, 0.5 * width
    ridge = half - 0.030
    wood = _painted_wood(rng, shade, rings=0.05, waves=(11.0, 0.4, 4.0), amount=0.07, cells=26)
    mesh = slab((-half, half, half, ridge, -half), (0.0, 0.0, front, height, rear), side, bevel=bevel)
    slope = math.atan2(height - rear, ridge + half)
    # The wedge: a box to the height of the rear, and one that lies under the slope.
    plate = 0.5 * (height - rear) * math.cos(slope)
    x = 0.5 * (ridge - half) + 0.5 * plate * math.sin(slope)
    z = 0.5 * (height + rear) - 0.5 * plate * math.cos(slope)
    along = 0.5 * (ridge + half) / math.cos(slope) - 0.5 * math.tan(slope) * plate
    return Draft(
        shape="irregular",
        description=f"A {color} wooden block with the outline of a stapler.",
        tags=("block", "wedge", "wooden block", "toy"),
        mass_kg=0.22,
        parts=(
            part("block", mapped(mesh, (1.0, 0.5, 0.0), (0.0, 0.6, 1.0)), wood),
            solid_box((-half, -side, 0.0), (half, side, rear)),
            solid_box((0.0, -side, rear), (half - 0.001, side, 0.5 * (rear + height))),
            leaning_box((along, side, 0.5 * plate), (x, 0.0, z), -slope),
            solid_box((ridge - 0.012, -side, rear), (half - 0.006, side, 0.5 * (front + height) - 0.001)),
        ),
        grasps=(grip("body", 0.032, width),),
        regions=(zone("base", half, side),),
        parameters={"length_m": length, "width_m": width, "height_m": height, "bevel_m": bevel},
    )


@generator("round_block", colors=("brown", "red", "green", "yellow", "blue"))
def round_block(rng: np.random.Generator, color: str) -> Draft:
    """Make a wooden round block with the size of a burger; in brown it has the color of the bun.

    Beech of 700 kg/m^3 weighs 0.13 kg at this size.
    """
    radius, height, bevel = rng.uniform(0.0325, 0.0340), rng.uniform(0.0480, 0.0540), rng.uniform(0.0018, 0.0032)
    shade = jittered(BUN if color == "brown" else PALETTE[color], rng, amount=0.10)
    radii = (0.0, radius - bevel, radius, radius, radius - bevel, 0.0)
    solid = Turned(radii, (0.0, 0.0, bevel, height - bevel, height, height), sides=28, crease_degrees=35.0)
    _, under, _, edge, top, _ = solid.rows
    canvas = solid.canvas(shade, (64, 256))
    # End grain: year rings on both flat faces, long fibers on the side.
    flat = (canvas.y > top) | (canvas.y < under)
    year = rng.uniform(0.0035, 0.0055)
    canvas.shade(np.where(flat, 0.95 + 0.05 * np.sin(2.0 * math.pi * (canvas.y - top) / year), 1.0))
    canvas.grain(rng, cells=(26, 3), amount=0.045)
    canvas.paint(canvas.between(edge, top), shaded(shade, 1.25))
    return Draft(
        shape="round",
        description=f"A {color} round wooden block with flat faces and bevelled edges.",
        tags=("block", "round block", "cylinder", "wood", "toy"),
        mass_kg=round(700.0 * math.pi * radius**2 * height, 4),
        parts=(part("block", solid.mesh(), canvas, specular=0.25), *solid.filled(0.021)),
        grasps=(grip("body", 0.5 * height, 2.0 * radius, clearance=0.005, symmetric_yaw=True),),
        regions=(disc("base", radius), disc("top", 0.5 * radius, height)),
        parameters={"radius_m": radius, "height_m": height, "bevel_m": bevel},
    )
