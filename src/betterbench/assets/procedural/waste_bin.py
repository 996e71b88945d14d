"""Open waste bins for a desk."""

from __future__ import annotations

import math

import numpy as np

from betterbench.assets.asset import CollisionPart
from betterbench.assets.authoring.draft import Draft, disc, part
from betterbench.assets.authoring.mesh import lathe, profile_length
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import solid_box
from betterbench.geometry import from_axis_angle, from_yaw, multiply
from betterbench.state import Region

_WALL = 0.004
_FLOOR = 0.006


@generator("waste_bin", colours=("black", "grey", "blue"))
def waste_bin(rng: np.random.Generator, colour: str) -> Draft:
    """Make a round open waste bin that widens towards its rim.

    A steel mesh bin of this size weighs 0.4 to 0.7 kg. Most of the 0.6 kg is given to the floor, as in bins that stand
    firm. It is a low table bin: what is let go above its rim falls 8 cm.
    """
    rim = rng.uniform(0.1030, 0.1065)
    foot_radius = rng.uniform(0.0830, 0.0870)
    height = rng.uniform(0.112, 0.118)
    roll = rng.uniform(0.0022, 0.0034)  # radius of the rolled rim
    pattern = str(rng.choice(["mesh", "holes", "plain", "slots"]))
    metal_rim = rng.random() < 0.4
    shade = jittered(shaded(PALETTE[colour], 1.12) if colour == "black" else PALETTE[colour], rng)
    wall_top = rim - roll
    profile = [
        (0.0, 0.0),
        (foot_radius - 0.003, 0.0),
        (foot_radius, 0.004),
        (wall_top, height - 2.0 * roll),
        (rim, height - 1.4 * roll),
        (rim - 0.3 * roll, height - 0.25 * roll),
        (rim - roll, height),
        (rim - 2.2 * roll, height - 0.8 * roll),
        (foot_radius - 0.003, _FLOOR),
        (0.0, _FLOOR),
    ]
    shell = lathe(profile, 30, wrap=True, crease_degrees=50.0)
    picture = _pattern(rng, profile, shade, pattern=pattern, metal_rim=metal_rim)

    flare = math.atan2(wall_top - foot_radius, height)
    inner_low, inner_top = foot_radius - _WALL, wall_top - _WALL
    apothem = 0.5 * (inner_low + inner_top) + 0.5 * _WALL
    half_wall = 0.5 * (height - 0.001) / math.cos(flare)
    walls = [
        CollisionPart(
            "box",
            (0.5 * _WALL, (inner_top + _WALL) * math.tan(math.pi / 8.0), half_wall - 0.0005),
            (apothem * math.cos(angle), apothem * math.sin(angle), 0.001 + 0.5 * (height - 0.001)),
            multiply(from_yaw(angle), from_axis_angle((0.0, flare, 0.0))),
        )
        for angle in (k * math.pi / 4.0 for k in range(8))
    ]
    # Two crossed plates fill an octagon and stand on fixed corners; a cylinder would touch in points that wander.
    long, short = inner_low - 0.0005, 0.55 * inner_low
    floor = (
        solid_box((-long, -short, 0.0), (long, short, _FLOOR)),
        solid_box((-short, -long, 0.0), (short, long, _FLOOR)),
    )
    collision = (*floor, *walls)
    # The widest upright box between floor and rim that the walls leave room for at the floor.
    inside = 0.5 * (height - _FLOOR)
    square = 0.78 * inner_low
    return Draft(
        shape="cylinder",
        description=f"A round open {colour} waste bin.",
        tags=("bin", "waste bin", "trash can", "wastebasket", "container"),
        mass_kg=0.60,
        densities=(3.0, 3.0, *(0.25,) * 8),
        parts=(part("bin", shell, picture, specular=0.25, shininess=0.3), *collision),
        regions=(
            Region("inside", (0.0, 0.0, _FLOOR + inside), (square, square, inside)),
            disc("opening", inner_top, height),
            disc("base", foot_radius),
        ),
        parameters={"rim_radius_m": rim, "foot_radius_m": foot_radius, "height_m": height, "pattern": pattern},
    )


def _pattern(
    rng: np.random.Generator,
    profile: list[tuple[float, float]],
    shade: Colour,
    *,
    pattern: str,
    metal_rim: bool,
) -> Canvas:
    """Draw the bin from below over the wall and the rim to the floor inside."""
    length = profile_length(profile)
    foot, top, crest, lip, floor = (float(length[k]) for k in (2, 3, 6, 7, 8))
    half = math.pi * 0.5 * (profile[2][0] + profile[3][0])
    canvas = Canvas(half, float(length[-1]), (256, 256), shade)
    x, y = canvas.x, canvas.y
    inside = y > lip
    # The same height on the wall inside and outside, so that the pattern goes through it.
    share = np.where(inside, 1.0 - (y - lip) / (floor - lip), (y - foot) / (top - foot))
    up = share * (top - foot)
    wall = (share > 0.0) & (share < 1.0)
    field = wall & (share > 0.10) & (share < 0.93)
    down = np.clip((y - lip) / (floor - lip), 0.0, 1.0)
    open_, edge = shaded(shade, 0.22), mixed(shade, (1.0, 1.0, 1.0), 0.22)
    if pattern == "mesh":
        pitch = half / 32
        a, b = (x + up) % pitch, (x - up) % pitch
        wire = (np.abs(a - 0.5 * pitch) < 0.17 * pitch) | (np.abs(b - 0.5 * pitch) < 0.17 * pitch)
        canvas.paint(field & ~wire, open_)
        canvas.paint(field & wire, edge)
    elif pattern == "holes":
        pitch = half / 24
        row = np.floor(up / (0.87 * pitch))
        dx = (x + 0.5 * pitch * (row % 2)) % pitch - 0.5 * pitch
        dy = up - (row + 0.5) * 0.87 * pitch
        r = np.hypot(dx, dy)
        canvas.paint(field & (r < 0.34 * pitch), edge)
        canvas.paint(field & (r < 0.29 * pitch), open_)
    elif pattern == "slots":
        pitch = half / 30
        canvas.paint(field & (np.abs(x % pitch - 0.5 * pitch) < 0.24 * pitch) & (np.abs(share - 0.5) > 0.03), open_)
    else:
        canvas.grain(rng, cells=(20, 20), amount=0.015)
        canvas.paint(wall & (np.abs(share - 0.80) < 0.014), shaded(shade, 0.65))
        canvas.paint(wall & (np.abs(share - 0.765) < 0.010), edge)
    canvas.shade(np.where(inside, 0.82 - 0.42 * down, 0.84 + 0.16 * np.clip(share, 0.0, 1.0)))
    ring = (y > top) & (y < lip)
    canvas.paint(ring, (0.72, 0.73, 0.75) if metal_rim else mixed(shade, (1.0, 1.0, 1.0), 0.12))
    canvas.paint((y > crest) & (y < lip), shaded(shade, 0.7), strength=0.3)
    return canvas
