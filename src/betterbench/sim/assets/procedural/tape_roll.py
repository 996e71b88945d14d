"""Generator of rolls of adhesive tape."""

import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, grip_across, part
from betterbench.sim.assets.authoring.mesh import box
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms


@generator("tape_roll", colors=("blue", "brown", "yellow", "green"))
def tape_roll(rng: np.random.Generator, color: str) -> Draft:
    """Make a roll of adhesive tape that lies flat. Its cardboard core has an open hole.

    Rolls of tape 15 to 30 mm wide, on cores of 25 to 40 mm, are 55 to 72 mm in diameter and weigh 40 to 80 g. A short
    end of the tape sticks out.
    """
    radius, width, hole = uniforms(rng, (0.0285, 0.0355), (0.0190, 0.0290), (0.42, 0.64))
    hole *= radius
    core, proud = hole + rng.uniform(0.0020, 0.0030), rng.uniform(0.0, 0.0008)  # the core sticks out of the tape
    kind, at = int(rng.integers(3)), rng.uniform(0.0, 2.0 * math.pi)
    shade = jittered(PALETTE[color], rng, amount=0.10)
    board = jittered(((0.90, 0.89, 0.85), (0.74, 0.58, 0.38), (0.16, 0.16, 0.17))[kind], rng)
    radii = (core, radius - 0.0008, radius, radius, radius - 0.0008, core, core)
    tape = Turned(radii, (0.0, 0.0, 0.0008, width - 0.0008, width, width, 0.0), sides=26)
    ring = Turned((hole, core, core, hole, hole), (0.0, 0.0, width + proud, width + proud, 0.0), sides=20)
    # The loose end leaves the roll along its tangent.
    size = (0.0008, 0.010, width - 0.001)
    loose = box(size, (radius - 0.0006, 0.004, 0.5 * width)).rotated("z", -0.25).moved(0.0005, 0.0).rotated("z", at)
    return Draft(
        shape="round",
        description=f"A roll of {color} adhesive tape on a cardboard core.",
        tags=("tape", "roll of tape", "adhesive tape", "office"),
        traits=("office",),
        mass_kg=round(930.0 * math.pi * (radius**2 - core**2) * width, 3),
        material="plastic",
        parts=(
            part("tape", tape.mesh(), _windings(rng, tape, shade), specular=0.5, shininess=0.5),
            part("core", ring.mesh(), _core(rng, ring, board, shade), specular=0.05),
            part("end", loose, mixed(shade, (1.0, 1.0, 1.0), 0.25), specular=0.4),
            *tape.filled(0.65 * radius),
        ),
        grasps=(grip_across(0.5 * width, radius, clearance=0.004),),
        regions=(disc("base", radius),),
        parameters={"radius_m": radius, "width_m": width, "hole_radius_m": hole},
    )


def _windings(rng: np.random.Generator, tape: Turned, shade: Rgb) -> Canvas:
    """Draw the tape: rings of the windings on both flat sides, and a glossy outside with the free end in front."""
    length, canvas = tape.rows, tape.canvas(shade, (64, 256))
    y = canvas.y
    flat = (y < length[1]) | canvas.between(length[4], length[5])
    canvas.paint(flat, mixed(shade, (1.0, 1.0, 1.0), 0.22))
    rings = rng.uniform(0.86, 1.06, 64)
    across = np.abs(y - 0.5 * (length[4] + length[5]))
    canvas.shade(np.where(flat, rings[(across / 0.0008).astype(int) % 64], 1.0))
    outside = canvas.between(length[2], length[3])
    canvas.paint(outside & (canvas.x < 0.006), mixed(shade, (1.0, 1.0, 1.0), 0.35))
    canvas.paint(outside & (np.abs(canvas.x - 0.006) < 0.0009), shaded(shade, 0.55))
    canvas.paint(y > length[5], shaded(shade, 0.5))
    return canvas


def _core(rng: np.random.Generator, ring: Turned, board: Rgb, shade: Rgb) -> Canvas:
    """Draw the core, with the plies of the board on its ends and a printed line inside."""
    _, _, low, high, end = ring.rows
    canvas = ring.canvas(board, (64, 128), width=1.0)
    plies = 1.0 + 0.12 * np.sin(2.0 * math.pi * (canvas.y - low) / 0.0008)
    canvas.shade(np.where(canvas.between(low, high), plies, 1.0))
    canvas.shadow(high, end, 0.78, 0.25)
    if rng.random() < 0.6:
        band = high + rng.uniform(0.25, 0.45) * (end - high)
        canvas.paint(np.abs(canvas.y - band) < 0.0028, mixed(shade, board, 0.3))
    return canvas
