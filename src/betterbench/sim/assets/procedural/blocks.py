"""Generators of painted wooden blocks: toy blocks, and blocks that have the size of another object."""

import math
from collections.abc import Sequence

import numpy as np

from betterbench.sim.assets.authoring import Draft, Turned, block, disc, generator, grip, merge, part, zone
from betterbench.sim.assets.authoring.lettering import write_word
from betterbench.sim.assets.authoring.mesh import ABOVE, FRONT, box, mapped, slab
from betterbench.sim.assets.authoring.paint import BUN, PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms
from betterbench.sim.assets.authoring.solids import solid_box
from betterbench.sim.assets.procedural.stapler_outline import stapler_size

_BARE: Rgb = (0.85, 0.68, 0.46)  # color of bare beech


def _painted_wood(
    rng: np.random.Generator, shade: Rgb, *, rings: float, waves: tuple[float, float, float], amount: float, cells: int
) -> Canvas:
    """Draw painted wood with wavy annual rings and grain.

    ``waves`` gives the number of annual rings, and the height and the number of the waves in each ring. ``rings`` is
    the strength of the rings, ``amount`` is the strength of the grain, and ``cells`` is the number of fibers.
    """
    canvas = Canvas(1.0, 1.0, (64, 64), shade)
    count, height, number = waves
    canvas.shade(1.0 + rings * np.sin(2.0 * math.pi * (count * canvas.y + height * np.sin(number * canvas.x))))
    canvas.grain(rng, cells=(3, cells), amount=amount)
    return canvas


@generator("block", colors=("red", "blue", "green", "yellow", "orange", "purple", "white", "black", "brown"))
def toy_block(rng: np.random.Generator, color: str) -> Draft:
    """Make a painted toy block of beech: plain, framed, with a sign, striped, or worn at its edges.

    Wooden toy blocks have sides of 30 to 60 mm. The density of beech is 700 kg/m^3.
    """
    x, y, z = sorted((float(e) for e in rng.uniform(0.034, 0.058, 3)), reverse=True)
    if rng.random() < 0.4:
        x = z = y
    bevel, style = rng.uniform(0.0015, 0.0050), str(rng.choice(["plain", "frame", "star", "letter", "worn", "stripes"]))
    letter = str(rng.choice(["A", "1", "2", "3", "K", "S"]))
    shade = jittered(PALETTE[color], rng)
    bright = sum(shade) > 1.6
    ink = shaded(shade, 0.35) if bright else mixed(shade, (1.0, 0.97, 0.90), 0.85)
    wood = _painted_wood(rng, shade, rings=0.05, waves=(7.0, 0.35, 5.0), amount=0.05, cells=24)
    low, high, axes = (-x / 2, -y / 2, 0.0), (x / 2, y / 2, z), ((0.8, 0.6, 0.0), (-0.35, 0.35, 0.87))
    body, solid = block("block", low, high, wood, bevel=bevel, corner=bevel, view=axes, specular=0.25)
    seen = [body]
    if style != "plain":
        face = _block_face(style, shade, ink, letter)
        inset, thin = bevel + 0.0004, 0.0004
        top = box((x - 2.0 * inset, y - 2.0 * inset, thin), (0.0, 0.0, z))
        seen.append(part("top", top, face, view=ABOVE, specular=0.25))
        sides = box((x + thin, y - 2.0 * inset, z - 2.0 * inset), (0.0, 0.0, 0.5 * z))
        seen.append(part("front", sides, face, view=FRONT, specular=0.25))
    return Draft(
        shape="box",
        description=f"A {color} wooden toy block.",
        tags=("block", "cube", "cuboid", "wood", "toy"),
        traits=("wood",),
        mass_kg=round(700.0 * x * y * z, 4),
        material="wood",
        parts=(*seen, solid),
        grasps=(grip("body", z / 2, y), grip("long", z / 2, x, across="x", preference=1)),
        regions=(zone("top", x / 2, y / 2, z), zone("base", x / 2, y / 2)),
        parameters={"x_m": x, "y_m": y, "z_m": z, "bevel_m": bevel, "style": style},
    )


def _block_face(style: str, shade: Rgb, ink: Rgb, letter: str) -> Canvas:
    """Draw one face of a toy block (1 by 1) in the given style."""
    canvas = Canvas(1.0, 1.0, (64, 64), shade)
    x, y = canvas.x, canvas.y
    edge = np.minimum(np.minimum(x, 1.0 - x), np.minimum(y, 1.0 - y))
    if style == "worn":
        canvas.paint(edge < 0.07 + 0.05 * np.sin(23.0 * x + 17.0 * y), _BARE, strength=0.9)
    elif style == "stripes":
        canvas.paint(np.abs(x - 0.5) < 0.11, ink)
    else:
        canvas.paint((edge > 0.04) & (edge < 0.11), ink)
    if style == "letter":
        write_word(canvas, letter, (0.5, 0.5), height=0.56, ink=ink, weight=0.20)
    elif style == "star":
        angle, reach = np.arctan2(y - 0.48, x - 0.5) - 0.5 * math.pi, np.hypot(x - 0.5, y - 0.48)
        wedge = np.abs((angle * 2.5 / math.pi + 1.0) % 2.0 - 1.0)  # 0 at a tip, 1 between two tips
        canvas.paint(reach < 0.34 - 0.19 * wedge, ink)
    return canvas


@generator("stapler_block", colors=("black", "red", "blue"), family="stapler")
def stapler_block(rng: np.random.Generator, color: str) -> Draft:
    """Make a solid painted wooden block with the size of a stapler, but without a gap or metal parts.

    The paint is worn off along the edges and at the ends, so that bare wood shows. At this size, a block of beech (700
    kg/m^3) would weigh 0.15 to 0.19 kg. This block weighs as much as a stapler (0.2 to 0.25 kg), as if it were made of
    denser wood. It therefore differs from a stapler only in appearance.
    """
    length, width, height = stapler_size(rng)
    bevel, chamfer = rng.uniform(0.0022, 0.0036), float(rng.choice([0.0, 0.010, 0.018]))
    count, wear, stained = rng.uniform(4.0, 9.0), rng.uniform(0.5, 1.0), rng.random() < 0.5
    shade = jittered(shaded(PALETTE[color], 1.25) if color == "black" else PALETTE[color], rng)
    half, side, height = 0.5 * length, 0.5 * width, 0.98 * height
    canvas = Canvas(1.0, 1.0, (256, 128), shade)
    x, y = canvas.x, canvas.y
    wave = count * y + 0.5 * np.sin(5.0 * x) + 0.3 * np.sin(11.0 * x + 1.0)
    # Dark annual rings can be seen from afar through the paint. On stained wood, the wood between them is pale.
    ring = np.clip(1.8 * np.sin(2.0 * math.pi * wave) - 0.6, 0.0, 1.0)
    canvas.shade(1.0 - 0.45 * ring)
    if stained:
        canvas.paint(np.clip(-1.8 * np.sin(2.0 * math.pi * wave) - 0.9, 0.0, 1.0), _BARE, strength=0.45)
    canvas.grain(rng, cells=(3, 40), amount=0.08)
    worn = np.minimum(np.minimum(x, 1.0 - x) / 0.030, np.minimum(y, 1.0 - y) / 0.045) + 0.35 * np.sin(
        40.0 * x + 9.0 * y
    )
    canvas.paint(worn < wear, _BARE, strength=0.85)
    flat, shoulder = half - chamfer, height - chamfer
    outline: tuple[Sequence[float], Sequence[float]] = ((-half, half, half, -half), (0.0, 0.0, height, height))
    if chamfer:
        outline = ((-half, half, half, flat, -flat, -half), (0.0, 0.0, shoulder, height, height, shoulder))
    body = mapped(slab(*outline, side, bevel=bevel), (1.0, 0.30, 0.0), (0.0, 0.75, 1.0))
    size = (0.0008, 2.0 * side - 0.008, shoulder - 0.008)
    ends = [box(size, (e * half, 0.0, 0.5 * shoulder)) for e in (-1, 1)]
    rings = Canvas(1.0, 1.0, (32, 32), shaded(_BARE, 0.92))
    rings.shade(0.86 + 0.14 * np.sin(2.0 * math.pi * 4.0 * np.hypot(rings.x - 0.3, rings.y + 0.2)))
    return Draft(
        shape="irregular",
        description=f"A {color} wooden block with the size of a stapler, its paint worn off at the edges.",
        tags=("block", "wooden block", "toy"),
        mass_kg=round(945.0 * length * width * height / 0.98, 4),
        material="wood",
        parts=(
            part("block", body, canvas, specular=0.1),
            part("ends", merge(ends), rings, view=FRONT, specular=0.05),
            solid_box((-half, -side, 0.0), (half, side, shoulder)),
            *([solid_box((-flat, -side, shoulder), (flat, side, height))] if chamfer else []),
        ),
        grasps=(grip("body", 0.032, width),),
        regions=(zone("base", half, side),),
        parameters={"length_m": length, "width_m": width, "height_m": height, "bevel_m": bevel},
    )


@generator("round_block", colors=("brown", "red", "green", "yellow", "blue"))
def round_block(rng: np.random.Generator, color: str) -> Draft:
    """Make a round wooden toy block with the size of a burger. The brown block has the color of a bun.

    A letter or a digit is painted on its face, as on a child's blocks. Some blocks have a darker or lighter side, as if
    stained, and the width of the beveled edges varies. The block has neither a groove nor a ring, because these would
    make it look like a box with a lid. At this size, beech (700 kg/m^3) weighs 0.11 to 0.15 kg.
    """
    radius, height = uniforms(rng, (0.0318, 0.0350), (0.0465, 0.0555))
    bevel = float(rng.choice([0.0015, 0.0040, 0.0070, 0.0100]))
    stain, sign = (0.72, 1.0, 1.0, 1.20)[int(rng.integers(4))], str(rng.choice(["A", "E", "K", "R", "2", "3"]))
    shade = jittered(BUN if color == "brown" else PALETTE[color], rng, amount=0.10)
    foot = radius * rng.uniform(0.88, 1.0)
    radii = (0.0, foot - bevel, foot, radius, radius - bevel, 0.0)
    solid = Turned(radii, (0.0, 0.0, bevel, height - bevel, height, height), sides=24, crease_degrees=35.0)
    under, edge, top = solid.rows[1], solid.rows[-3], solid.rows[-2]
    canvas = solid.canvas(shade, (64, 256))
    canvas.paint(canvas.between(under, edge), shaded(shade, stain))
    canvas.paint((canvas.y > top) | (canvas.y < under), mixed(shade, _BARE, 0.45))
    canvas.grain(rng, cells=(26, 3), amount=0.06)
    canvas.paint(canvas.between(edge, top), mixed(shade, _BARE, 0.75))
    flat = radius - bevel - 0.0005
    face = Turned((flat, flat, 0.0), (height, height + 0.0004, height + 0.0004), sides=24).mesh()
    return Draft(
        shape="round",
        description=f"A {color} round wooden toy block, a sign painted on its face.",
        tags=("block", "round block", "cylinder", "wood", "toy"),
        traits=("wood",),
        mass_kg=round(700.0 * math.pi * radius**2 * height, 4),
        material="wood",
        parts=(
            part("block", solid.mesh(), canvas, specular=0.25),
            part("face", face, _round_face(rng, shade, sign), view=ABOVE, specular=0.25),
            *solid.filled(0.021),
        ),
        grasps=(grip("body", 0.5 * height, 2.0 * radius, clearance=0.004, symmetric_yaw=True),),
        regions=(disc("base", radius), disc("top", 0.5 * radius, height)),
        parameters={"radius_m": radius, "height_m": height, "bevel_m": bevel, "sign": sign},
    )


def _round_face(rng: np.random.Generator, shade: Rgb, sign: str) -> Canvas:
    """Draw the face of a round toy block, which shows bare wood with grain and a sign in dark ink."""
    canvas = Canvas(1.0, 1.0, (96, 96), mixed(shade, _BARE, 0.85))
    ink = mixed(shaded(shade, 0.22), (0.10, 0.05, 0.02), 0.5)
    wave = np.sin(2.0 * math.pi * (4.0 * canvas.y + 0.25 * np.sin(4.0 * canvas.x)))
    canvas.shade(1.0 - 0.16 * np.clip(wave, 0.0, 1.0))
    canvas.grain(rng, cells=(3, 18), amount=0.05)
    write_word(canvas, sign, (0.5, 0.5), height=0.62, ink=ink, weight=0.24)
    return canvas
