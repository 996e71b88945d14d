"""Rolls of adhesive tape."""

import math

import numpy as np

from betterbench.assets.authoring import Draft, Turned, disc, generator, grip_across, part
from betterbench.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms


@generator("tape_roll", colors=("blue", "brown", "yellow", "green"))
def tape_roll(rng: np.random.Generator, color: str) -> Draft:
    """Make a roll of adhesive tape that lies flat; one sees through the hole of its cardboard core.

    A roll of 24 mm tape on a core of 25 to 38 mm with 33 m of tape is 65 mm wide and weighs 50 to 70 g.
    """
    radius, width, hole = uniforms(rng, (0.0320, 0.0340), (0.0225, 0.0255), (0.0145, 0.0185))
    core, proud = hole + rng.uniform(0.0020, 0.0030), rng.uniform(0.0, 0.0008)  # the core stands out of the tape
    white_core = rng.random() < 0.35
    shade = jittered(PALETTE[color], rng, amount=0.10)
    board = jittered((0.86, 0.84, 0.79) if white_core else (0.74, 0.58, 0.38), rng)
    radii = (core, radius - 0.0008, radius, radius, radius - 0.0008, core, core)
    tape = Turned(radii, (0.0, 0.0, 0.0008, width - 0.0008, width, width, 0.0), sides=28)
    ring = Turned((hole, core, core, hole, hole), (0.0, 0.0, width + proud, width + proud, 0.0))
    return Draft(
        shape="round",
        description=f"A roll of {color} adhesive tape on a cardboard core.",
        tags=("tape", "roll of tape", "adhesive tape", "office"),
        mass_kg=0.06,
        parts=(
            part("tape", tape.mesh(), _windings(rng, tape, shade), specular=0.5, shininess=0.5),
            part("core", ring.mesh(), _core(rng, ring, board, shade), specular=0.05),
            *tape.filled(0.0215),
        ),
        grasps=(grip_across(0.013, radius, clearance=0.005),),
        regions=(disc("base", radius),),
        parameters={"radius_m": radius, "width_m": width, "hole_radius_m": hole},
    )


def _windings(rng: np.random.Generator, tape: Turned, shade: Rgb) -> Canvas:
    """Draw the tape: rings of the windings on both flat sides, a glossy outside with the free end at the front."""
    length, canvas = tape.rows, tape.canvas(shade, (64, 256))
    y = canvas.y
    flat = (y < length[1]) | canvas.between(length[4], length[5])
    canvas.paint(flat, mixed(shade, (1.0, 1.0, 1.0), 0.16))
    rings = rng.uniform(0.86, 1.06, 64)
    across = np.abs(y - 0.5 * (length[4] + length[5]))
    canvas.shade(np.where(flat, rings[(across / 0.0008).astype(int) % 64], 1.0))
    outside = canvas.between(length[2], length[3])
    canvas.paint(outside & (canvas.x < 0.006), mixed(shade, (1.0, 1.0, 1.0), 0.35))
    canvas.paint(outside & (np.abs(canvas.x - 0.006) < 0.0009), shaded(shade, 0.55))
    canvas.paint(y > length[5], shaded(shade, 0.5))
    return canvas


def _core(rng: np.random.Generator, ring: Turned, board: Rgb, shade: Rgb) -> Canvas:
    """Draw the core: plies of board on its end, a printed line inside."""
    _, _, low, high, end = ring.rows
    canvas = ring.canvas(board, (64, 128), width=1.0)
    plies = 1.0 + 0.12 * np.sin(2.0 * math.pi * (canvas.y - low) / 0.0008)
    canvas.shade(np.where(canvas.between(low, high), plies, 1.0))
    canvas.shadow(high, end, 0.78, 0.25)
    if rng.random() < 0.6:
        band = high + rng.uniform(0.25, 0.45) * (end - high)
        canvas.paint(np.abs(canvas.y - band) < 0.0028, mixed(shade, board, 0.3))
    return canvas
