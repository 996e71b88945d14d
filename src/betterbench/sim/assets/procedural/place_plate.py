"""Generator of the flat plate of a place setting, around which cutlery and cups are placed."""

import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, part, ring_of_boards, standing, zone
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded

_RADIUS, _HEIGHT = 0.095, 0.018
_SIDE = _RADIUS + 0.045  # distance from the center of the plate to the zones next to it [m]


@generator("place_plate", colors=("white", "blue", "cream"), family="place plate")
def place_plate(rng: np.random.Generator, color: str) -> Draft:
    """Make a breakfast plate with a decorated rim. The diner sits at +x.

    A stoneware plate with a diameter of 18 to 19 cm weighs 0.4 to 0.6 kg. These plates have a mass near the upper end,
    so that they stay in place while objects are placed around them. The regions are named from the view of the diner:
    right is +y, and upper is -x.
    """
    stand = rng.uniform(0.046, 0.058)
    well = stand + rng.uniform(0.003, 0.014)
    decoration = str(rng.choice(["bands", "dots", "leaves", "petals", "wide", "center"]))
    base = mixed(PALETTE["blue"], (0.62, 0.74, 0.90), 0.55) if color == "blue" else PALETTE[color]
    glaze = jittered(base, rng, amount=0.05)
    inks = ((0.33, 0.34, 0.37), (0.62, 0.18, 0.12), (0.18, 0.42, 0.24), (0.36, 0.26, 0.16))
    drawn = inks[int(rng.integers(len(inks)))]
    ink = (0.92, 0.93, 0.93) if color == "blue" else drawn
    radius, height = _RADIUS * rng.uniform(0.945, 1.0), _HEIGHT * rng.uniform(0.86, 1.0)
    radii = (0.0, stand, stand + 0.003, radius, radius - 0.0008, well + 0.003, well - 0.003, 0.0)
    z = (0.0, 0.0, 0.0040, height - 0.0010, height, 0.0088, 0.0070, 0.0064)
    plate = Turned(radii, z, sides=36, crease_degrees=50.0, wrap=False).mesh().seen_from_above(radius)
    picture = _glaze(rng, glaze, ink, decoration=decoration, well=well / radius)
    # Eight inclined boards follow the rim from the edge of the well outward.
    (inner, low), (outer, high) = (well - 0.002, 0.0052), (radius - 0.0035, height - 0.0022)
    slope, half = math.atan2(high - low, outer - inner), 0.5 * math.hypot(outer - inner, high - low)
    board = (half, outer * math.tan(math.pi / 8), 0.0018)
    return Draft(
        shape="round",
        description=f"A {color} breakfast plate with a decorated rim.",
        tags=("plate", "breakfast plate", "dish", "tableware"),
        mass_kg=round(0.55 * (radius / _RADIUS) ** 2, 4),
        material="ceramic",
        parts=(
            part("plate", plate, picture, specular=0.5, shininess=0.6),
            *standing(0.66 * stand, (well, 0.0065)),
            *ring_of_boards(board, 0.5 * (inner + outer), 0.5 * (low + high), lean=-slope),
        ),
        regions=(
            disc("base", radius),
            disc("top", well - 0.003, 0.0065),
            zone("left", 0.03, 0.022, x=0.02, y=-_SIDE, half_z=0.02),
            zone("right", 0.03, 0.022, x=0.02, y=_SIDE, half_z=0.02),
            zone("upper_right", 0.03, 0.03, x=-0.13, y=0.10, half_z=0.02),
        ),
        parameters={"radius_m": radius, "height_m": height, "stand_m": stand, "well_m": well, "decoration": decoration},
    )


def _glaze(rng: np.random.Generator, glaze: Rgb, ink: Rgb, *, decoration: str, well: float) -> Canvas:
    """Draw the plate from above, with a print on the rim and a faint shadow where the well begins."""
    canvas = Canvas(2.0, 2.0, (256, 256), glaze)
    r = canvas.radius
    middle = 0.5 * (well + 0.97)
    # The edge has the color of the ink, because the glaze is thin there.
    canvas.paint(r > 0.965, ink, strength=0.9)
    if decoration == "bands":
        canvas.paint((r > middle - 0.055) & (r < middle + 0.055), ink)
        canvas.paint(np.abs(r - middle + 0.095) < 0.012, ink)
    elif decoration == "dots":
        around = (canvas.angle / (2.0 * math.pi) * 18.0) % 1.0 - 0.5
        canvas.paint(np.hypot(around * 2.0 * math.pi / 18.0 * r, r - middle) < 0.065, ink)
    elif decoration == "leaves":
        around = (canvas.angle / (2.0 * math.pi) * 14.0) % 1.0 - 0.5
        along = around * 2.0 * math.pi / 14.0 * r
        slant = (r - middle) - 0.55 * along
        canvas.paint((along / 0.135) ** 2 + (slant / 0.042) ** 2 < 1.0, ink)
        canvas.paint(np.abs(r - middle + 0.115) < 0.010, ink)
    elif decoration == "wide":
        canvas.paint(r > well + 0.06, mixed(glaze, ink, 0.6))
    elif decoration == "center":
        canvas.paint((r < 0.30) & (np.cos(6.0 * canvas.angle) + 1.6 > 8.0 * r), ink)
        canvas.paint(r < 0.07, glaze)
    else:
        wave = 0.085 * np.cos(12.0 * canvas.angle)
        canvas.paint(np.abs(r - middle - wave) < 0.022, ink)
        canvas.paint(np.abs(r - middle + wave) < 0.022, mixed(glaze, ink, 0.55))
    canvas.shade(1.0 - 0.16 * np.exp(-(((r - well) / 0.03) ** 2)))
    canvas.paint(np.exp(-(((r - well - 0.055) / 0.02) ** 2)), shaded(glaze, 1.3), strength=0.25)
    canvas.grain(rng, cells=(8, 8), amount=0.010)
    return canvas
