"""Open lunchboxes of plastic with a hinged lid."""

from __future__ import annotations

import math

import numpy as np

from betterbench.assets.asset import CollisionPart
from betterbench.assets.authoring.draft import Draft, centred, part, zone
from betterbench.assets.authoring.mesh import Mesh, box, creased, loft, mapped, merge, prism, rectangle
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import solid_box
from betterbench.geometry import Quaternion
from betterbench.state import Region

_WALL = 0.005
_FLOOR = 0.006
_LIP = 0.003


@generator("lunchbox", colours=("blue", "green", "red"))
def lunchbox(rng: np.random.Generator, colour: str) -> Draft:
    """Make an open lunchbox; its latch looks along +x and its lid leans back over the -x side.

    The inside is about 0.20 m (x) by 0.25 m (y). The lid is opened by about 120 degrees, so that nothing is above the
    opening and a hand that comes straight down keeps clear of it. A box of this size in 2.5 mm polypropylene weighs
    0.35 kg; 0.5 kg, most of it in the floor, stands for one with a cooling element.
    """
    half_x = 0.100 + rng.uniform(-0.002, 0.002)
    half_y = 0.125 + rng.uniform(-0.002, 0.002)
    height = 0.065 + rng.uniform(-0.002, 0.002)
    corner = rng.uniform(0.020, 0.034)
    opened = math.radians(rng.uniform(117.0, 124.0))
    depth = rng.uniform(0.014, 0.018)  # of the lid
    latches = int(rng.choice([1, 2]))
    motif = str(rng.choice(["fruit", "stripes", "dots", "star"]))
    shade = jittered(mixed(PALETTE[colour], (1.0, 1.0, 1.0), 0.06), rng)
    lining = mixed(shade, (0.93, 0.93, 0.91), float(rng.choice([0.25, 0.75])))
    trim = ((0.93, 0.92, 0.88), (0.95, 0.70, 0.12), (0.20, 0.21, 0.24))[int(rng.integers(3))]

    ox, oy = half_x + _WALL, half_y + _WALL
    tray = _tray(ox, oy, height, corner=corner)
    hinge = (-ox - 0.001, 0.0, height)
    lid_length, lid_half = 2.0 * ox + _LIP, oy + _LIP
    lid = _lid(lid_length, lid_half, depth, corner=corner).rotated("y", -opened).moved(*hinge)
    at = (0.0,) if latches == 1 else (-0.45 * oy, 0.45 * oy)
    clips = merge(
        [box((0.008, 0.034, 0.030), (ox + _LIP + 0.003, y, height - 0.017), bevel=0.002, corner=0.002) for y in at]
    )
    knuckles = merge([box((0.010, 0.040, 0.012), (-ox - 0.003, y, height - 0.002)) for y in (-0.5 * oy, 0.5 * oy)])
    shift = centred(tray, lid, clips, knuckles)

    c, s = math.cos(opened), math.sin(opened)
    middle = (hinge[0] + c * 0.5 * lid_length - s * 0.5 * depth, 0.0, hinge[2] + s * 0.5 * lid_length + c * 0.5 * depth)
    lean: Quaternion = (math.cos(0.5 * opened), 0.0, -math.sin(0.5 * opened), 0.0)
    dx = shift[0]
    collision = (
        solid_box((dx - ox, -oy, 0.0), (dx + ox, oy, _FLOOR)),
        solid_box((dx + half_x, -oy, _FLOOR), (dx + ox, oy, height)),
        solid_box((dx - ox, -oy, _FLOOR), (dx - half_x, oy, height)),
        solid_box((dx - half_x, half_y, _FLOOR), (dx + half_x, oy, height)),
        solid_box((dx - half_x, -oy, _FLOOR), (dx + half_x, -half_y, height)),
        CollisionPart("box", (0.5 * lid_length, lid_half, 0.5 * depth), (dx + middle[0], 0.0, middle[2]), lean),
    )
    inside = 0.5 * (height - _FLOOR)
    return Draft(
        shape="box",
        description=f"An open {colour} plastic lunchbox with a hinged lid.",
        tags=("lunchbox", "lunch box", "box", "container", "plastic"),
        mass_kg=0.5,
        densities=(4.0, 0.5, 0.5, 0.5, 0.5, 0.15),
        parts=(
            part("tray", tray.moved(x=dx), _shell(shade, lining), specular=0.4, shininess=0.5),
            part("lid", lid.moved(x=dx), _lining(rng, shade, lining, trim, motif=motif), specular=0.35, shininess=0.5),
            part("latch", clips.moved(x=dx), trim, specular=0.4),
            part("hinge", knuckles.moved(x=dx), shaded(shade, 0.75), specular=0.3),
            *collision,
        ),
        regions=(
            Region("inside", (dx, 0.0, _FLOOR + inside), (half_x, half_y, inside)),
            zone("opening", half_x, half_y, height, x=dx),
            zone("base", ox, oy, x=dx),
        ),
        parameters={
            "inner_x_m": 2 * half_x,
            "inner_y_m": 2 * half_y,
            "height_m": height,
            "lid_degrees": math.degrees(opened),
            "motif": motif,
        },
    )


# Texture rows of the tray's rings: outside below 0.45, lip to 0.55, inside above.
_ROWS = (0.02, 0.06, 0.42, 0.46, 0.50, 0.54, 0.60, 0.90, 0.97)


def _tray(half_x: float, half_y: float, height: float, *, corner: float) -> Mesh:
    """Return the box with rounded corners, a lip and a real inside."""
    steps = (
        (0.008, 0.0),
        (0.002, 0.006),
        (0.0, height - 0.011),
        (-_LIP, height - 0.009),
        (-_LIP, height - 0.001),
        (-_LIP + 0.001, height),
        (_WALL - 0.002, height),
        (_WALL - 0.0015, _FLOOR + 0.006),
        (_WALL + 0.005, _FLOOR),
    )
    rings = [
        rectangle(half_x - inset, half_y - inset, z, corner=max(corner - inset, 0.006), steps=3) for inset, z in steps
    ]
    return creased(loft(rings, v=_ROWS), 40.0)


def _shell(shade: Colour, lining: Colour) -> Canvas:
    """Draw the tray from its underside over the lip to the floor, with the inside in its own shadow."""
    canvas = Canvas(1.0, 1.0, (8, 128), shade)
    y = canvas.y
    canvas.shade(np.where(y < 0.42, 0.86 + 0.14 * y / 0.42, 1.0))
    canvas.band(0.55, 1.1, lining)
    canvas.shade(np.where(y > 0.55, 0.92 - 0.22 * np.clip((y - 0.55) / 0.35, 0.0, 1.0), 1.0))
    canvas.paint((y > 0.47) & (y < 0.55), shaded(shade, 1.12), strength=0.7)
    return canvas


def _lid(length: float, half_y: float, depth: float, *, corner: float) -> Mesh:
    """Return the closed lid from its hinge at the origin along +x, mapped to a picture of its inner side."""
    steps = ((0.007, depth - 0.004), (0.006, 0.0), (0.0, 0.0), (0.0, depth - 0.004), (0.004, depth))
    rings = [
        rectangle(0.5 * length - inset, half_y - inset, z, corner=max(corner - inset, 0.006), steps=3)
        for inset, z in steps
    ]
    # Seen from below (which is the front when it is open) with the hinge at the bottom.
    return mapped(prism(rings, crease_degrees=40.0).moved(x=0.5 * length), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))


def _lining(rng: np.random.Generator, shade: Colour, lining: Colour, trim: Colour, *, motif: str) -> Canvas:
    """Draw the inner side of the lid: a border, a moulded panel and a printed motif."""
    width, height = 0.266, 0.213
    canvas = Canvas(width, height, (192, 160), shade)
    x, y = canvas.x - 0.5 * width, canvas.y - 0.5 * height
    edge = np.minimum(0.5 * width - np.abs(x), 0.5 * height - np.abs(y))
    canvas.paint(edge > 0.0075, lining)
    canvas.paint((edge > 0.022) & (edge < 0.0245), shaded(lining, 0.80))
    ink = trim if abs(sum(trim) - sum(lining)) > 0.6 else shade
    if motif == "stripes":
        for offset in (-0.036, 0.0, 0.036):
            canvas.paint((np.abs(y - offset) < 0.007) & (edge > 0.032), ink)
    elif motif == "dots":
        for u in np.linspace(-0.075, 0.075, 5).tolist():
            for v in (-0.045, 0.0, 0.045):
                canvas.ellipse((0.5 * width + u, 0.5 * height + v), (0.009, 0.009), ink)
    elif motif == "star":
        r, angle = np.hypot(x, y), np.arctan2(x, y)
        canvas.paint(r < 0.030 * (1.0 + 0.42 * np.cos(5.0 * angle)), ink)
    else:
        canvas.paint(np.hypot(np.abs(x) - 0.013, y + 0.004) < 0.026, ink)
        canvas.paint((np.abs(x - 0.1 * y) < 0.0022) & (y > 0.015) & (y < 0.042), (0.34, 0.22, 0.10))
        canvas.ellipse((0.5 * width + 0.016, 0.5 * height + 0.034), (0.014, 0.006), (0.25, 0.50, 0.14), 0.45)
    canvas.grain(rng, cells=(6, 5), amount=0.012)
    return canvas
