"""Small things that stand beside food: a stack of napkins, a cup of sauce."""

from __future__ import annotations

import math

import numpy as np

from betterbench.assets.authoring.draft import Draft, disc, grip, part
from betterbench.assets.authoring.mesh import box, lathe, mapped, merge, profile_length
from betterbench.assets.authoring.paint import PALETTE, Canvas, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import foot, solid_box, upright_cylinder


@generator("napkin_stack", colours=("white", "red", "blue", "green", "yellow"))
def napkin_stack(rng: np.random.Generator, colour: str) -> Draft:
    """Make a small stack of folded paper napkins.

    A folded cocktail napkin weighs 2 to 3 g; twenty of them are about 50 g and 20 mm high.
    """
    side = rng.uniform(0.060, 0.066)
    count = int(rng.integers(5, 8))
    thickness = rng.uniform(0.0030, 0.0038)
    shade = jittered(PALETTE[colour], rng, amount=0.05)
    accent = shaded(shade, 0.72) if colour == "white" else mixed(shade, (1.0, 1.0, 1.0), 0.6)
    top = count * thickness
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
    flat = mapped(layers[-1], (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    collision = (solid_box((-side / 2, -side / 2, 0.0), (side / 2, side / 2, top - 0.0002)),)
    return Draft(
        shape="box",
        description=f"A stack of folded {colour} paper napkins.",
        tags=("napkins", "napkin", "serviette", "paper"),
        mass_kg=0.05,
        parts=(
            part(
                "sheets", merge([m.moved(z=-0.07 * thickness) for m in layers[:-1]]), shaded(shade, 0.93), specular=0.05
            ),
            part("top", flat, canvas, specular=0.05),
            *collision,
        ),
        grasps=(grip("body", 0.5 * top, side),),
        regions=(disc("base", side / 2),),
        parameters={"side_m": side, "sheets": count, "height_m": top},
    )


@generator("sauce_cup", colours=("red", "yellow", "white", "brown"))
def sauce_cup(rng: np.random.Generator, colour: str) -> Draft:
    """Make a small paper cup of sauce; the colour is that of the sauce.

    A 60 ml portion cup is about 60 mm wide and 35 mm high.
    """
    radius = rng.uniform(0.0285, 0.0315)
    base = radius * rng.uniform(0.76, 0.86)
    height = rng.uniform(0.032, 0.038)
    level = height - rng.uniform(0.005, 0.008)
    inner = radius - 0.0022
    profile = [
        (0.0, 0.0),
        (base, 0.0),
        (radius - 0.0012, height - 0.002),
        (radius, height - 0.0008),
        (radius - 0.0012, height),
        (inner, height - 0.001),
        (inner - 0.0012, level),
        (0.0, level + 0.0004),
    ]
    length = profile_length(profile)
    sauce = jittered(mixed(PALETTE[colour], (0.25, 0.10, 0.02), 0.12), rng)
    paper = (0.93, 0.92, 0.89)
    pleats = int(rng.choice([0, 9, 12]))
    canvas = Canvas(math.pi * radius, float(length[-1]), (128, 128), paper)
    if pleats:
        wave = np.cos(2.0 * math.pi * pleats * canvas.x / (math.pi * radius))
        canvas.shade(np.where(canvas.y < length[2], 0.93 + 0.07 * wave, 1.0))
    canvas.shade(np.where((canvas.y > length[4]) & (canvas.y < length[6]), 0.85, 1.0))
    canvas.paint(canvas.y >= length[6], sauce)
    canvas.paint((canvas.y > length[6]) & (canvas.y < length[6] + 0.003), shaded(sauce, 0.75))
    canvas.shade(1.0 + 0.12 * np.where(canvas.y > length[6], np.sin(900.0 * (canvas.y - length[6])), 0.0))
    collision = (
        foot(0.66 * base),
        upright_cylinder(0.5 * (base + radius), 0.0005, 0.55 * height),
        upright_cylinder(radius - 0.0008, 0.55 * height, height),
    )
    return Draft(
        shape="cylinder",
        description=f"A small paper cup of {colour} sauce.",
        tags=("sauce", "dip", "ketchup", "cup", "condiment"),
        mass_kg=0.06,
        parts=(part("cup", lathe(profile, 24, wrap=True), canvas, specular=0.3), *collision),
        grasps=(grip("body", 0.60 * height, 2.0 * radius, symmetric_yaw=True, clearance=0.008),),
        regions=(
            disc("base", base),
            disc("opening", inner, height),
        ),
        parameters={"radius_m": radius, "height_m": height, "pleats": float(pleats)},
    )
