"""Generators of small objects that are served with food: a stack of napkins, and a cup of sauce."""

import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, grip, grip_across, part, standing, zone
from betterbench.sim.assets.authoring.mesh import box, merge
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms
from betterbench.sim.assets.authoring.solids import solid_box

# Rotation of a stack's top napkin relative to the bottom one [rad], and the radius of its corners [m].
_FAN, _CORNER = (-0.4, 0.4), (0.001, 0.008)


@generator("napkin_stack", colors=("white", "red", "blue", "green", "yellow"))
def napkin_stack(rng: np.random.Generator, color: str) -> Draft:
    """Make a small stack of folded paper napkins.

    A folded cocktail napkin weighs 2 to 3 g. A stack of twenty weighs about 50 g and is 20 mm high.
    """
    side, count, thickness = rng.uniform(0.056, 0.068), int(rng.integers(4, 9)), rng.uniform(0.0026, 0.0034)
    print_, fan, round_corner = str(rng.choice(["frame", "dots", "stripes", "flower"])), *uniforms(rng, _FAN, _CORNER)
    half, top = side / 2, count * thickness
    shade = jittered(PALETTE[color], rng, amount=0.05)
    ink = (PALETTE["red"], PALETTE["green"], PALETTE["blue"], PALETTE["orange"])[int(rng.integers(4))]
    accent = ink if color == "white" else mixed(shade, (1.0, 1.0, 1.0), 0.75)
    layers = []
    for k in range(count):
        turn = fan * (k - 0.5 * count) / count + rng.uniform(-0.04, 0.04)
        sheet = box((side, side, 0.86 * thickness), (0.0, 0.0, (k + 0.5) * thickness), corner=round_corner, steps=2)
        layers.append(sheet.rotated("z", turn).moved(rng.uniform(-8e-4, 8e-4), rng.uniform(-8e-4, 8e-4)))
    canvas = Canvas(2.0, 2.0, (128, 128), shade)
    _print_napkin(canvas, print_, accent)
    canvas.paint(np.abs(canvas.x - 1.0) < 0.016, shaded(shade, 0.75))
    canvas.grain(rng, cells=(24, 24), amount=0.015)
    lower = merge([m.moved(z=-0.07 * thickness) for m in layers[:-1]])
    return Draft(
        shape="box",
        description=f"A stack of folded {color} paper napkins.",
        tags=("napkins", "napkin", "serviette", "paper"),
        traits=("paper",),
        mass_kg=round(0.008 * count, 3),
        material="paper",
        parts=(
            part("sheets", lower, shaded(shade, 0.86), specular=0.05),
            part("top", layers[-1], canvas, view=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), specular=0.05),
            solid_box((-half, -half, 0.0), (half, half, top - 0.0002)),
        ),
        grasps=(grip("body", 0.5 * top, side),),
        regions=(zone("base", half, half),),
        parameters={"side_m": side, "sheets": count, "height_m": top},
    )


def _print_napkin(canvas: Canvas, kind: str, ink: Rgb) -> None:
    """Print a pattern on the texture of a napkin. The texture is 2 units wide and high, and its center is at (1, 1)."""
    x, y = canvas.x - 1.0, canvas.y - 1.0
    reach = np.maximum(np.abs(x), np.abs(y))
    if kind == "frame":
        canvas.paint((reach > 0.70) & (reach < 0.84), ink)
    elif kind == "stripes":
        canvas.paint(np.abs(y % 0.5 - 0.25) < 0.07, ink)
    elif kind == "dots":
        canvas.paint(np.hypot(x % 0.5 - 0.25, y % 0.5 - 0.25) < 0.11, ink)
    else:
        angle, away = np.arctan2(y, x), np.hypot(x, y)
        canvas.paint((away < 0.30 + 0.26 * np.abs(np.cos(2.5 * angle))) & (away > 0.16), ink)


@generator("sauce_cup", colors=("red", "yellow", "white", "brown"))
def sauce_cup(rng: np.random.Generator, color: str) -> Draft:
    """Make a small paper cup of sauce. The color word is the color of the sauce.

    Portion cups of 45 to 90 ml are 54 to 68 mm wide and 27 to 42 mm high. They are made of white or brown paper or of
    black plastic.
    """
    radius = rng.uniform(0.0270, 0.0340)
    base, height = radius * rng.uniform(0.66, 0.90), rng.uniform(0.028, 0.041)
    outside = ((0.93, 0.92, 0.89), (0.66, 0.50, 0.33), (0.12, 0.12, 0.13), (0.93, 0.92, 0.89))[int(rng.integers(4))]
    level, inner, edge = height - rng.uniform(0.005, 0.008), radius - 0.0022, radius - 0.0012
    z = (0.0, 0.0, height - 0.002, height - 0.0008, height, height - 0.001, level, level + 0.0004)
    cup = Turned((0.0, base, edge, radius, edge, inner, inner - 0.0012, 0.0), z)
    _, _, rim, _, top, _, sauce_row, _ = cup.rows
    sauce = jittered(mixed(PALETTE[color], (0.25, 0.10, 0.02), 0.12), rng)
    pleats = int(rng.choice([0, 9, 12]))
    canvas = cup.canvas(outside, (128, 128))
    y = canvas.y
    if pleats:
        wave = np.cos(2.0 * math.pi * pleats * canvas.x / (math.pi * radius))
        canvas.shade(np.where(y < rim, 0.86 + 0.14 * wave, 1.0))
    canvas.shade(np.where(canvas.between(top, sauce_row), 0.85, 1.0))
    canvas.paint(y >= sauce_row, sauce)
    canvas.paint(canvas.between(sauce_row, sauce_row + 0.003), shaded(sauce, 0.75))
    canvas.shade(1.0 + 0.12 * np.where(y > sauce_row, np.sin(900.0 * (y - sauce_row)), 0.0))
    return Draft(
        shape="cylinder",
        description=f"A small paper cup of {color} sauce.",
        tags=("sauce", "dip", "ketchup", "cup", "condiment"),
        mass_kg=round(0.006 + 1000.0 * math.pi * (0.5 * (base + radius)) ** 2 * (level - 0.004) * 0.8, 3),
        material="paper",
        parts=(
            part("cup", cup.mesh(), canvas, specular=0.3),
            *standing(0.66 * base, (0.5 * (base + radius), 0.55 * height), (radius - 0.0008, height)),
        ),
        grasps=(grip_across(0.60 * height, radius, clearance=0.005),),
        regions=(disc("base", base), disc("opening", inner, height)),
        parameters={"radius_m": radius, "height_m": height, "pleats": float(pleats)},
    )
