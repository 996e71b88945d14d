"""Rolls of adhesive tape."""

from __future__ import annotations

import math

import numpy as np

from betterbench.assets.authoring.draft import Draft, disc, grip, part
from betterbench.assets.authoring.mesh import lathe, profile_length
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import foot, upright_cylinder

_BOARD: Colour = (0.74, 0.58, 0.38)


@generator("tape_roll", colours=("blue", "brown", "yellow", "green"))
def tape_roll(rng: np.random.Generator, colour: str) -> Draft:
    """Make a roll of adhesive tape that lies flat; one sees through the hole of its cardboard core.

    A roll of 24 mm tape on a core of 25 to 38 mm with 33 m of tape is 65 mm wide and weighs 50 to 70 g.
    """
    radius = rng.uniform(0.0320, 0.0340)
    width = rng.uniform(0.0225, 0.0255)
    hole = rng.uniform(0.0145, 0.0185)
    core = hole + rng.uniform(0.0020, 0.0030)
    proud = rng.uniform(0.0, 0.0008)  # how far the core stands out of the tape
    white_core = rng.random() < 0.35
    shade = jittered(PALETTE[colour], rng, amount=0.10)
    board = jittered((0.86, 0.84, 0.79) if white_core else _BOARD, rng)

    tape_profile = [
        (core, 0.0),
        (radius - 0.0008, 0.0),
        (radius, 0.0008),
        (radius, width - 0.0008),
        (radius - 0.0008, width),
        (core, width),
    ]
    tape = lathe([*tape_profile, tape_profile[0]], 28, wrap=True)
    core_profile = [(hole, 0.0), (core, 0.0), (core, width + proud), (hole, width + proud), (hole, 0.0)]
    ring = lathe(core_profile, 24, wrap=True)
    collision = (foot(0.0215), upright_cylinder(radius, 0.0005, width))
    return Draft(
        shape="round",
        description=f"A roll of {colour} adhesive tape on a cardboard core.",
        tags=("tape", "roll of tape", "adhesive tape", "office"),
        mass_kg=0.06,
        parts=(
            part("tape", tape, _windings(rng, tape_profile, shade), specular=0.5, shininess=0.5),
            part("core", ring, _core(rng, core_profile, board, shade), specular=0.05),
            *collision,
        ),
        grasps=(grip("body", 0.013, 2.0 * radius, clearance=0.005, symmetric_yaw=True),),
        regions=(disc("base", radius),),
        parameters={"radius_m": radius, "width_m": width, "hole_radius_m": hole},
    )


def _windings(rng: np.random.Generator, profile: list[tuple[float, float]], shade: Colour) -> Canvas:
    """Draw the tape: rings of the windings on both flat sides, a glossy outside with the free end at the front."""
    length = profile_length([*profile, profile[0]])
    half = math.pi * profile[2][0]
    canvas = Canvas(half, float(length[-1]), (64, 256), shade)
    y = canvas.y
    flat = (y < length[1]) | ((y > length[4]) & (y < length[5]))
    canvas.paint(flat, mixed(shade, (1.0, 1.0, 1.0), 0.16))
    rings = rng.uniform(0.86, 1.06, 64)
    across = np.abs(y - 0.5 * (length[4] + length[5]))
    canvas.shade(np.where(flat, rings[(across / 0.0008).astype(int) % 64], 1.0))
    outside = (y > length[2]) & (y < length[3])
    canvas.paint(outside & (canvas.x < 0.006), mixed(shade, (1.0, 1.0, 1.0), 0.35))
    canvas.paint(outside & (np.abs(canvas.x - 0.006) < 0.0009), shaded(shade, 0.55))
    canvas.paint((y > length[5]), shaded(shade, 0.5))
    return canvas


def _core(rng: np.random.Generator, profile: list[tuple[float, float]], board: Colour, shade: Colour) -> Canvas:
    """Draw the core: plies of board on its end, a printed line inside."""
    length = profile_length(profile)
    canvas = Canvas(1.0, float(length[-1]), (64, 128), board)
    y = canvas.y
    end = (y > length[2]) & (y < length[3])
    canvas.shade(np.where(end, 1.0 + 0.12 * np.sin(2.0 * math.pi * (y - length[2]) / 0.0008), 1.0))
    inner = y > length[3]
    canvas.shade(np.where(inner, 0.78 - 0.25 * np.clip((y - length[3]) / (length[4] - length[3]), 0.0, 1.0), 1.0))
    if rng.random() < 0.6:
        band = length[3] + rng.uniform(0.25, 0.45) * (length[4] - length[3])
        canvas.paint(np.abs(y - band) < 0.0028, mixed(shade, board, 0.3))
    return canvas
