"""Open waste bins for a desk."""

import math

import numpy as np

from betterbench.assets.authoring import Draft, Turned, disc, generator, part, ring_of_boards, solid_box, zone
from betterbench.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms

_WALL, _FLOOR = 0.004, 0.006


@generator("waste_bin", colors=("black", "gray", "blue"))
def waste_bin(rng: np.random.Generator, color: str) -> Draft:
    """Make a round open waste bin that widens toward its rim.

    A steel mesh bin of this size weighs 0.4 to 0.7 kg. Most of the 0.6 kg is given to the floor, as in bins that stand
    firm. It is a low table bin: what is let go above its rim falls 8 cm.
    """
    rim, foot, height = uniforms(rng, (0.1030, 0.1065), (0.0830, 0.0870), (0.112, 0.118))
    roll = rng.uniform(0.0022, 0.0034)  # radius of the rolled rim
    pattern, metal_rim = str(rng.choice(["mesh", "holes", "plain", "slots"])), rng.random() < 0.4
    shade = jittered(shaded(PALETTE[color], 1.12) if color == "black" else PALETTE[color], rng)
    top = rim - roll
    radii = (0.0, foot - 0.003, foot, top, rim, rim - 0.3 * roll, rim - roll, rim - 2.2 * roll, foot - 0.003, 0.0)
    crest = (height - 2.0 * roll, height - 1.4 * roll, height - 0.25 * roll, height, height - 0.8 * roll)
    shell = Turned(radii, (0.0, 0.0, 0.004, *crest, _FLOOR, _FLOOR), sides=30, crease_degrees=50.0)
    flare = math.atan2(top - foot, height)
    inner_low, inner_top = foot - _WALL, top - _WALL
    half_wall = 0.5 * (height - 0.001) / math.cos(flare)
    board = (0.5 * _WALL, (inner_top + _WALL) * math.tan(math.pi / 8.0), half_wall - 0.0005)
    away, middle = 0.5 * (inner_low + inner_top) + 0.5 * _WALL, 0.001 + 0.5 * (height - 0.001)
    # Two crossed plates fill an octagon and stand on fixed corners; a cylinder would touch in points that wander.
    long, short = inner_low - 0.0005, 0.55 * inner_low
    # The widest upright box between floor and rim that the walls leave room for at the floor.
    inside, square = 0.5 * (height - _FLOOR), 0.78 * inner_low
    return Draft(
        shape="cylinder",
        description=f"A round open {color} waste bin.",
        tags=("bin", "waste bin", "trash can", "wastebasket", "container"),
        mass_kg=0.60,
        densities=(3.0, 3.0, *(0.25,) * 8),
        parts=(
            part("bin", shell.mesh(), _pattern(rng, shell, shade, pattern=pattern, metal_rim=metal_rim), specular=0.25),
            solid_box((-long, -short, 0.0), (long, short, _FLOOR)),
            solid_box((-short, -long, 0.0), (short, long, _FLOOR)),
            *ring_of_boards(board, away, middle, lean=flare),
        ),
        regions=(
            zone("inside", square, square, _FLOOR + inside, half_z=inside),
            disc("opening", inner_top, height),
            disc("base", foot),
        ),
        parameters={"rim_radius_m": rim, "foot_radius_m": foot, "height_m": height, "pattern": pattern},
    )


def _pattern(rng: np.random.Generator, shell: Turned, shade: Rgb, *, pattern: str, metal_rim: bool) -> Canvas:
    """Draw the bin from below over the wall and the rim to the floor inside."""
    foot, top, crest, lip, floor = (shell.rows[k] for k in (2, 3, 6, 7, 8))
    half = math.pi * 0.5 * (shell.radii[2] + shell.radii[3])
    canvas = shell.canvas(shade, (256, 256), width=half)
    x, y = canvas.x, canvas.y
    inside = y > lip
    # The same height on the wall inside and outside, so that the pattern goes through it.
    share = np.where(inside, 1.0 - (y - lip) / (floor - lip), (y - foot) / (top - foot))
    up = share * (top - foot)
    wall, field = (share > 0.0) & (share < 1.0), (share > 0.10) & (share < 0.93)
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
        r = np.hypot(dx, up - (row + 0.5) * 0.87 * pitch)
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
    metal = (0.72, 0.73, 0.75) if metal_rim else mixed(shade, (1.0, 1.0, 1.0), 0.12)
    canvas.paint(canvas.between(top, lip), metal)
    canvas.paint(canvas.between(crest, lip), shaded(shade, 0.7), strength=0.3)
    return canvas
