"""Generator of paper cups with a lid and a straw."""

import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, grip, part, standing, sweep
from betterbench.sim.assets.authoring.mesh import tube_section
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms

_STRAW_TOP, _GRIP = 0.1285, 0.0860


@generator("drink_cup", colors=("blue", "red", "green", "yellow", "white", "orange"), keeps_upright=True)
def drink_cup(rng: np.random.Generator, color: str) -> Draft:
    """Make a paper cup with a lid and a short bent straw that leans toward +x.

    The color word is the color of the print. A small takeaway cup contains 0.25 l and weighs about 0.27 kg when full.
    The underside of the Franka gripper's hand is 45 mm above the tool center point. The cup and its straw stay below it
    when the gripper holds the cup below the lid. The straw has no collision shape.
    """
    lid, narrower, wall = uniforms(rng, (0.0315, 0.0330), (0.0030, 0.0085), (0.0930, 0.1000))
    top = lid - 0.0022
    base, lid_top = top - narrower, wall + 0.0100
    design, shade = str(rng.choice(["wave", "band", "dots", "stripes", "full", "rings"])), jittered(PALETTE[color], rng)
    cup = Turned((0.0, base - 0.0008, base, top, 0.0), (0.0, 0.0, 0.0015, wall, wall + 0.001))
    radii = (0.0, lid - 0.001, lid, lid - 0.0035, lid - 0.0050, lid - 0.0085, lid - 0.0095, 0.0)
    low, inner = wall - 0.002, lid_top - 0.0030
    domed, clear = rng.uniform(0.0, 0.0060), bool(rng.random() < 0.4)
    z = (low, low, wall + 0.0015, wall + 0.0040, lid_top, lid_top, inner + domed, inner + domed)
    cover = Turned(radii, z, sides=22, wrap=False)
    rows, plastic = cover.rows, cover.canvas((0.78, 0.82, 0.84) if clear else (0.93, 0.94, 0.95), (16, 128))
    for start, end, light in ((rows[5], rows[6], 0.80), (rows[6], 1.0, 0.90), (rows[3], rows[4], 0.93)):
        plastic.shade(np.where(plastic.between(start, end), light, 1.0))
    x, bend = (0.006, 0.007, 0.0105, lid - 0.0006), (_STRAW_TOP - 0.0085, _STRAW_TOP - 0.0042, _STRAW_TOP - 0.0010)
    straw = sweep(x, (lid_top - 0.005, *bend), tube_section(0.0029, 7), crease_degrees=70.0)
    paint = ((0.95, 0.95, 0.95), (0.10, 0.10, 0.11), (0.90, 0.55, 0.08))[int(rng.integers(3))]
    held = base + (top - base) * _GRIP / wall
    body = ((0.5 * (base + held) - 0.0004, 0.060), (held, wall - 0.002))
    return Draft(
        shape="cylinder",
        description=f"A {color} paper cup with a soft drink, a plastic lid and a straw.",
        tags=("drink", "cup", "soda", "soft drink", "paper cup"),
        mass_kg=round(0.27 * (top / 0.030) ** 2 * wall / 0.097, 4),
        material="paper",
        densities=(1.0, 1.0, 1.0, 0.1, 0.1),
        parts=(
            part("cup", cup.mesh(), _print(rng, cup, shade, design=design)),
            part("lid", cover.mesh(), plastic, specular=0.5, shininess=0.5),
            part("straw", straw, paint, specular=0.4),
            *standing(0.66 * base, *body, (lid - 0.001, wall + 0.003), (lid - 0.005, lid_top)),
        ),
        grasps=(grip("body", _GRIP, 2.0 * held, clearance=0.007),),
        regions=(disc("base", base), disc("lid", lid, lid_top)),
        parameters={"lid_radius_m": lid, "base_radius_m": base, "wall_m": wall, "design": design},
    )


def _print(rng: np.random.Generator, cup: Turned, shade: Rgb, *, design: str) -> Canvas:
    """Draw the printed wall of the paper cup."""
    low, high = cup.rows[2], cup.rows[3]
    span, paper = high - low, (0.94, 0.93, 0.90)
    accent = paper if sum(shade) < 2.2 else (0.80, 0.20, 0.15)
    canvas = cup.canvas(shade)
    x, y, width = canvas.x, canvas.y, canvas.width
    if design == "wave":
        wave = low + 0.36 * span + 0.10 * span * np.cos(4.0 * math.pi * x / width)
        canvas.paint(y < wave, accent)
        canvas.paint(np.abs(y - wave - 0.07 * span) < 0.02 * span, mixed(shade, accent, 0.75))
    elif design == "band":
        canvas.band(low + 0.36 * span, low + 0.66 * span, accent)
        for u in (0.0, 1.0):
            canvas.ellipse((u * width, low + 0.51 * span), (0.011, 0.011), shade)
        canvas.band(low + 0.70 * span, low + 0.725 * span, accent)
    elif design == "dots":
        for row in range(7):
            for column in range(6):
                center = ((column + 0.5 * (row % 2)) / 5.0 * width, low + (0.10 + 0.135 * row) * span)
                radius = 0.0062 - 0.00065 * row
                canvas.ellipse(center, (radius, radius), accent)
    elif design == "rings":
        for share in (0.18, 0.42, 0.66):
            canvas.band(low + share * span, low + (share + 0.12) * span, accent)
    elif design == "stripes":
        canvas.paint((np.abs((x / width * 7.0 + 0.5) % 1.0 - 0.5) < 0.22) & (y < low + 0.90 * span), accent)
    canvas.band(low + 0.955 * span, high, mixed(shade, paper, 0.6))
    canvas.shade(0.90 + 0.10 * np.clip((y - low) / (0.3 * span), 0.0, 1.0))
    canvas.grain(rng, cells=(8, 8), amount=0.012)
    canvas.paint(y < cup.rows[1], shaded(paper, 0.7))
    return canvas
