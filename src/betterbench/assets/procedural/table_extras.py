"""Small things that stand beside food: a stack of napkins, a cup of sauce."""

import math

import numpy as np

from betterbench.assets.authoring import Draft, Turned, disc, generator, grip, grip_across, part, standing, zone
from betterbench.assets.authoring.mesh import box, merge
from betterbench.assets.authoring.paint import PALETTE, Canvas, jittered, mixed, shaded
from betterbench.assets.authoring.solids import solid_box


@generator("napkin_stack", colors=("white", "red", "blue", "green", "yellow"))
def napkin_stack(rng: np.random.Generator, color: str) -> Draft:
    """Make a small stack of folded paper napkins.

    A folded cocktail napkin weighs 2 to 3 g; twenty of them are about 50 g and 20 mm high.
    """
    side, count, thickness = rng.uniform(0.060, 0.066), int(rng.integers(5, 8)), rng.uniform(0.0030, 0.0038)
    half, top = side / 2, count * thickness
    shade = jittered(PALETTE[color], rng, amount=0.05)
    accent = shaded(shade, 0.72) if color == "white" else mixed(shade, (1.0, 1.0, 1.0), 0.6)
    layers = []
    for k in range(count):
        turn = rng.uniform(-0.06, 0.06)
        sheet = box((side, side, 0.86 * thickness), (0.0, 0.0, (k + 0.5) * thickness), corner=0.002)
        layers.append(sheet.rotated("z", turn).moved(rng.uniform(-8e-4, 8e-4), rng.uniform(-8e-4, 8e-4)))
    canvas = Canvas(2.0, 2.0, (128, 128), shade)
    reach = np.maximum(np.abs(canvas.x - 1.0), np.abs(canvas.y - 1.0))
    canvas.paint((reach > 0.74) & (reach < 0.82), accent)
    canvas.paint((reach > 0.66) & (reach < 0.69), accent)
    canvas.paint(np.abs(canvas.x - 1.0) < 0.012, shaded(shade, 0.85))
    canvas.grain(rng, cells=(24, 24), amount=0.015)
    lower = merge([m.moved(z=-0.07 * thickness) for m in layers[:-1]])
    return Draft(
        shape="box",
        description=f"A stack of folded {color} paper napkins.",
        tags=("napkins", "napkin", "serviette", "paper"),
        mass_kg=0.05,
        parts=(
            part("sheets", lower, shaded(shade, 0.93), specular=0.05),
            part("top", layers[-1], canvas, view=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), specular=0.05),
            solid_box((-half, -half, 0.0), (half, half, top - 0.0002)),
        ),
        grasps=(grip("body", 0.5 * top, side),),
        regions=(zone("base", half, half),),
        parameters={"side_m": side, "sheets": count, "height_m": top},
    )


@generator("sauce_cup", colors=("red", "yellow", "white", "brown"))
def sauce_cup(rng: np.random.Generator, color: str) -> Draft:
    """Make a small paper cup of sauce; the color is that of the sauce.

    A 60 ml portion cup is about 60 mm wide and 35 mm high.
    """
    radius = rng.uniform(0.0285, 0.0315)
    base, height = radius * rng.uniform(0.76, 0.86), rng.uniform(0.032, 0.038)
    level, inner, edge = height - rng.uniform(0.005, 0.008), radius - 0.0022, radius - 0.0012
    z = (0.0, 0.0, height - 0.002, height - 0.0008, height, height - 0.001, level, level + 0.0004)
    cup = Turned((0.0, base, edge, radius, edge, inner, inner - 0.0012, 0.0), z)
    _, _, rim, _, top, _, sauce_row, _ = cup.rows
    sauce = jittered(mixed(PALETTE[color], (0.25, 0.10, 0.02), 0.12), rng)
    pleats = int(rng.choice([0, 9, 12]))
    canvas = cup.canvas((0.93, 0.92, 0.89), (128, 128))
    y = canvas.y
    if pleats:
        wave = np.cos(2.0 * math.pi * pleats * canvas.x / (math.pi * radius))
        canvas.shade(np.where(y < rim, 0.93 + 0.07 * wave, 1.0))
    canvas.shade(np.where(canvas.between(top, sauce_row), 0.85, 1.0))
    canvas.paint(y >= sauce_row, sauce)
    canvas.paint(canvas.between(sauce_row, sauce_row + 0.003), shaded(sauce, 0.75))
    canvas.shade(1.0 + 0.12 * np.where(y > sauce_row, np.sin(900.0 * (y - sauce_row)), 0.0))
    return Draft(
        shape="cylinder",
        description=f"A small paper cup of {color} sauce.",
        tags=("sauce", "dip", "ketchup", "cup", "condiment"),
        mass_kg=0.06,
        parts=(
            part("cup", cup.mesh(), canvas, specular=0.3),
            *standing(0.66 * base, (0.5 * (base + radius), 0.55 * height), (radius - 0.0008, height)),
        ),
        grasps=(grip_across(0.60 * height, radius, clearance=0.008),),
        regions=(disc("base", base), disc("opening", inner, height)),
        parameters={"radius_m": radius, "height_m": height, "pleats": float(pleats)},
    )
