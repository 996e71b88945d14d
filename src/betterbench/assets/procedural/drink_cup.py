"""Paper cups with a lid and a straw."""

from __future__ import annotations

import math

import numpy as np

from betterbench.assets.authoring.draft import Draft, disc, grip, part
from betterbench.assets.authoring.mesh import lathe, profile_length, sweep, tube_section
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import foot, upright_cylinder


@generator("drink_cup", colours=("blue", "red", "green", "yellow", "white", "orange"))
def drink_cup(rng: np.random.Generator, colour: str) -> Draft:
    """Make a lidded paper cup with a short bent straw that leans along +x.

    A small takeaway cup holds 0.25 l and weighs about 0.27 kg when full. Everything ends below the underside of a
    Franka hand that holds the cup below the lid (45 mm above the tool centre point), the straw too; the straw cannot be
    touched.
    """
    lid_radius = rng.uniform(0.0322, 0.0330)
    top_radius = lid_radius - 0.0022
    base_radius = top_radius - rng.uniform(0.0045, 0.0070)
    wall = rng.uniform(0.0940, 0.1000)
    lid_top = wall + 0.0100
    design = str(rng.choice(["wave", "band", "dots", "stripes"]))
    shade = jittered(PALETTE[colour], rng)

    cup_profile = [
        (0.0, 0.0),
        (base_radius - 0.0008, 0.0),
        (base_radius, 0.0015),
        (top_radius, wall),
        (0.0, wall + 0.001),
    ]
    lid_profile = [
        (0.0, wall - 0.002),
        (lid_radius - 0.001, wall - 0.002),
        (lid_radius, wall + 0.0015),
        (lid_radius - 0.0035, wall + 0.0040),
        (lid_radius - 0.0050, lid_top),
        (lid_radius - 0.0085, lid_top),
        (lid_radius - 0.0095, lid_top - 0.0030),
        (0.0, lid_top - 0.0030),
    ]
    lid_length = profile_length(lid_profile)
    lid_canvas = Canvas(1.0, float(lid_length[-1]), (16, 128), (0.93, 0.94, 0.95))
    lid_canvas.shade(np.where((lid_canvas.y > lid_length[5]) & (lid_canvas.y < lid_length[6]), 0.80, 1.0))
    lid_canvas.shade(np.where(lid_canvas.y > lid_length[6], 0.90, 1.0))
    lid_canvas.shade(np.where((lid_canvas.y > lid_length[3]) & (lid_canvas.y < lid_length[4]), 0.93, 1.0))

    straw_top = 0.1285
    x = 0.006
    straw = sweep(
        [
            (x, 0.0, lid_top - 0.005),
            (x + 0.001, 0.0, straw_top - 0.0085),
            (x + 0.0045, 0.0, straw_top - 0.0042),
            (lid_radius - 0.0006, 0.0, straw_top - 0.0010),
        ],
        tube_section(0.0029, 7),
        crease_degrees=70.0,
    )
    grip_z = 0.0860
    grip_radius = base_radius + (top_radius - base_radius) * grip_z / wall
    collision = (
        foot(0.66 * base_radius),
        upright_cylinder(0.5 * (base_radius + grip_radius) - 0.0004, 0.0005, 0.060),
        upright_cylinder(grip_radius, 0.060, wall - 0.002),
        upright_cylinder(lid_radius - 0.001, wall - 0.002, wall + 0.003),
        upright_cylinder(lid_radius - 0.005, wall + 0.003, lid_top),
    )
    return Draft(
        shape="cylinder",
        description=f"A {colour} paper cup with a soft drink, a plastic lid and a straw.",
        tags=("drink", "cup", "soda", "soft drink", "paper cup"),
        mass_kg=0.27,
        densities=(1.0, 1.0, 1.0, 0.1, 0.1),
        parts=(
            part(
                "cup", lathe(cup_profile, 24, wrap=True), _print(rng, cup_profile, shade, design=design), specular=0.2
            ),
            part("lid", lathe(lid_profile, 22), lid_canvas, specular=0.5, shininess=0.5),
            part("straw", straw, (0.90, 0.18, 0.16) if colour != "red" else (0.95, 0.95, 0.95), specular=0.4),
            *collision,
        ),
        grasps=(grip("body", grip_z, 2.0 * grip_radius, clearance=0.007),),
        regions=(
            disc("base", base_radius),
            disc("lid", lid_radius, lid_top),
        ),
        parameters={"lid_radius_m": lid_radius, "base_radius_m": base_radius, "wall_m": wall, "design": design},
    )


def _print(rng: np.random.Generator, profile: list[tuple[float, float]], shade: Colour, *, design: str) -> Canvas:
    """Draw the paper wall."""
    length = profile_length(profile)
    low, high = float(length[2]), float(length[3])
    span = high - low
    width = math.pi * profile[3][0]
    paper = (0.94, 0.93, 0.90)
    accent = paper if sum(shade) < 2.2 else (0.80, 0.20, 0.15)
    canvas = Canvas(width, float(length[-1]), (128, 256), shade)
    x, y = canvas.x, canvas.y
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
                centre = ((column + 0.5 * (row % 2)) / 5.0 * width, low + (0.10 + 0.135 * row) * span)
                radius = 0.0062 - 0.00065 * row
                canvas.ellipse(centre, (radius, radius), accent)
    else:
        canvas.paint((np.abs((x / width * 7.0 + 0.5) % 1.0 - 0.5) < 0.22) & (y < low + 0.90 * span), accent)
    canvas.band(low + 0.955 * span, high, mixed(shade, paper, 0.6))
    canvas.shade(0.90 + 0.10 * np.clip((y - low) / (0.3 * span), 0.0, 1.0))
    canvas.grain(rng, cells=(8, 8), amount=0.012)
    canvas.paint(y < length[1], shaded(paper, 0.7))
    return canvas
