"""Generators of tea cups with a handle, and of tall tumblers without one."""

import math

import numpy as np

from betterbench.sim.assets.asset import VisualPart
from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, glazed, grip, grip_across, part, zone
from betterbench.sim.assets.authoring.mesh import Mesh, sweep
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms
from betterbench.sim.assets.authoring.solids import foot_square, solid_box, standing, upright_cylinder

_WALL, _COLORS = 0.0028, ("blue", "red", "white", "yellow")
_BANDS = {"band": ((0.50, 0.78),), "rim": ((0.86, 2.0),), "stripes": ((0.30, 0.42), (0.58, 0.70))}
_FORMS = {
    # # Radii of the cup at four heights, as fractions of the largest radius.
    "flared": (0.66, 0.80, 0.91, 1.0),
    "round": (0.80, 0.94, 0.985, 1.0),
    "tulip": (0.84, 0.95, 0.945, 1.0),
    "straight": (0.90, 0.96, 0.985, 1.0),
}


@generator("cup", colors=_COLORS, family="tea cup")
def cup(rng: np.random.Generator, color: str) -> Draft:
    """Make a low, wide cup of tea on a narrow foot. Its ear-shaped handle sticks out along +x.

    A porcelain tea cup of 0.12 to 0.18 l is 65 to 90 mm wide and 50 to 65 mm high, and weighs 0.13 to 0.2 kg. The
    collision shape is filled, because the cup already contains tea and nothing is put into it.
    """
    size, base, height = uniforms(rng, (0.975, 1.0), (0.0200, 0.0245), (0.0530, 0.0610))
    # Distance by which the loop protrudes.
    loop, thickness, level = *uniforms(rng, (0.0225, 0.0270), (0.0080, 0.0105)), rng.uniform(0.72, 0.82)
    decoration, form = str(rng.choice(["plain", "band", "rim", "dots", "stripes"])), str(rng.choice(list(_FORMS)))
    tea = jittered(((0.42, 0.17, 0.04), (0.62, 0.33, 0.10), (0.24, 0.11, 0.05))[int(rng.integers(3))], rng)
    radius, axis, half = 0.0345 * size, -0.5 * loop, 0.5 * thickness
    shade = jittered(PALETTE[color], rng, amount=0.12)
    a, b, c, d = (share * radius for share in _FORMS[form])
    filled, inner = level * height, radius - _WALL
    outside = (0.0, base, base - 0.0010, max(base, a), b, c, d, d - 0.0008)
    rising = (0.0, 0.0, 0.0045, 0.22 * height, 0.48 * height, 0.76 * height, height - 0.0010, height)
    surface = float(np.interp(filled, rising[3:7], (a, b, c, d))) - _WALL
    shell = Turned((*outside, inner, surface, 0.0), (*rising, height - 0.0010, filled, filled), sides=22)
    ink = (0.95, 0.94, 0.91) if sum(shade) < 2.2 else mixed(PALETTE["gray"], PALETTE["blue"], 0.15)
    lining = (0.93, 0.92, 0.88)
    glaze = glazed(
        rng, shell, shade, decoration, rows=(2, 3, 6, 8, 9), lining=lining, ink=ink, bands=_BANDS, shadow=(0.92, 0.15),
        unglazed=0.80,
    )  # fmt: skip
    liquid = glaze.y > shell.rows[9]
    glaze.paint(liquid, tea)
    glaze.paint(liquid & (glaze.y < shell.rows[9] + 0.0022), shaded(tea, 1.35))
    top, low = height - 0.009, 0.20 * height
    ear = _ear(rng, radius, loop, (low, top), half)
    body, foot, out = 0.5 * (c + d), 0.66 * base, axis + radius + loop
    return Draft(
        shape="cylinder",
        description=f"A {color} tea cup with a handle.",
        tags=("cup", "tea cup", "coffee cup", "drinkware", "tableware"),
        mass_kg=round(0.165 * size**2 * height / 0.057, 4),
        material="ceramic",
        # The densities are low for the loop, which is mostly air, and for the solid foot, which represents a thin
        # floor.
        densities=(0.4, 0.4, 1.0, 0.35),
        parts=(
            part("shell", shell.mesh().moved(x=axis), glaze, specular=0.5, shininess=0.6),
            part("handle", ear.moved(x=axis), shaded(shade, 0.97), specular=0.5, shininess=0.6),
            foot_square(foot, height=0.004, x=axis),
            upright_cylinder(0.5 * (max(base, a) + b), 0.0005, 0.36 * height, x=axis),
            upright_cylinder(body, 0.36 * height, height - 0.0005, x=axis),
            solid_box((axis + body - 0.002, -half, low), (out, half, top + 0.002)),
        ),
        grasps=(grip("body", height - 0.0140, 2.0 * body, x=axis, clearance=0.005),),
        regions=(
            disc("base", base, x=axis),
            disc("opening", inner, height, x=axis),
            zone("handle", 0.5 * loop, half, 0.5 * (low + top), x=axis + radius + 0.5 * loop, half_z=0.5 * (top - low)),
        ),
        parameters={"radius_m": radius, "height_m": height, "form": form, "decoration": decoration},
    )


def _ear(rng: np.random.Generator, radius: float, loop: float, z: tuple[float, float], half: float) -> Mesh:
    """Return an ear-shaped handle between two heights, with the given half width. It sticks out by ``loop`` [m]."""
    (low, top), b, bevel = z, 0.0034, 0.0016
    droop, start = rng.uniform(0.0, 0.30) * (top - low), radius - 0.0035
    out = radius + loop - b
    section = [(half, -b + bevel), (half, b - bevel), (0.0, b), (-half, b - bevel), (-half, -b + bevel), (0.0, -b)]
    x = (start, out - 0.0085, out - 0.0016, out, out - 0.0070, start - 0.16 * radius)
    bend = top - 0.0075 - 0.4 * droop
    heights = (top - 0.002, top, top - 0.0050, bend - 0.006, low + 0.010 - 0.2 * droop, low)
    return sweep(x, heights, section, crease_degrees=55.0)


@generator("tumbler", colors=_COLORS)
def tumbler(rng: np.random.Generator, color: str) -> Draft:
    """Make a tall, straight drinking glass of tinted, see-through glass, without a handle.

    The glass is ribbed, ringed, faceted or plain. Its thick foot has the full color. A long drink glass of 0.25 l is 60
    to 65 mm wide and 110 to 120 mm high, and weighs 0.15 to 0.25 kg. The collision shape is filled, because nothing is
    put into the glass. A gripper can grasp it at any yaw, and the width is always the same.
    """
    radius, share, height, wall = uniforms(rng, (0.0290, 0.0325), (0.80, 0.95), (0.106, 0.122), (0.0020, 0.0026))
    pattern, thick = str(rng.choice(["facets", "ribs", "rings", "plain"])), rng.uniform(0.014, 0.020)
    base, faceted = radius * share, pattern == "facets"
    shade = jittered(mixed(PALETTE[color], (0.85, 0.90, 0.95), 0.12), rng)
    sides = int(rng.choice([8, 10, 12]))
    turned = (sides, 22.0) if faceted else (24, 40.0)
    phase = math.pi / sides if faceted else 0.0
    at_foot = base + (radius - base) * thick / height
    foot = Turned(
        (0.0, base - 0.002, base, at_foot, at_foot - wall, 0.0), (0.0, 0.0, 0.003, thick, thick, 0.8 * thick),
        *turned, phase=phase,
    )  # fmt: skip
    shell = Turned(
        (at_foot, radius, radius - wall, at_foot - wall), (thick, height - 0.002, height - 0.002, thick),
        *turned, phase=phase,
    )  # fmt: skip
    lip = Turned(
        (radius, radius, radius - 0.5 * wall, radius - wall, radius - wall),
        (height - 0.002, height - 0.0008, height, height - 0.0008, height - 0.002), *turned, phase=phase,
    )  # fmt: skip
    edge = radius * (math.cos(math.pi / sides) if faceted else 1.0) - wall
    held = max(0.57 * height, height - 0.046)
    at_grip = base + (radius - base) * held / height
    return Draft(
        shape="cylinder",
        description=f"A tall {color} drinking glass, {pattern}, without a handle.",
        tags=("tumbler", "glass", "drinking glass", "drinkware", "tableware"),
        mass_kg=round(0.19 * radius / 0.031 * height / 0.114, 4),
        material="glass",
        parts=(
            _clear("foot", foot, shaded(shade, 0.80)),
            _clear("lip", lip, mixed(shade, (1.0, 1.0, 1.0), 0.60)),
            _clear("shell", shell, _glass(shell, shade, pattern=pattern), opacity=0.42),
            *standing(0.66 * base, (0.5 * (base + at_grip), held - 0.014), (at_grip, height)),
        ),
        grasps=(grip_across(held, at_grip, clearance=0.006),),
        regions=(disc("base", base), disc("opening", edge, height)),
        parameters={"radius_m": radius, "height_m": height, "pattern": pattern},
    )


def _clear(name: str, turned: Turned, paint: Rgb | Canvas, *, opacity: float = 1.0) -> VisualPart:
    return part(name, turned.mesh(), paint, specular=0.9, shininess=0.8, opacity=opacity)


def _glass(glass: Turned, shade: Rgb, *, pattern: str) -> Canvas:
    """Draw the wall of a tinted glass, with its pattern, and white streaks where the glass catches the light."""
    _, rim, inside, _ = glass.rows
    canvas = glass.canvas(shade, (192, 256))
    x, y, width = canvas.x, canvas.y, canvas.width
    pale, body = mixed(shade, (1.0, 1.0, 1.0), 0.50), canvas.between(0.004, rim - 0.010)
    if pattern == "ribs":
        canvas.paint(body * np.clip(np.cos(2.0 * math.pi * x / width * 9.0), 0.0, 1.0), shaded(shade, 0.6))
    elif pattern == "rings":
        canvas.paint(body & (np.abs(y % 0.020 - 0.010) < 0.0026), shaded(shade, 0.5))
    elif pattern == "facets":
        canvas.paint(np.abs((x / width * 6.0) % 1.0 - 0.5) > 0.46, pale)
    for at, half in ((0.24, 0.045), (0.36, 0.015), (0.80, 0.022)):
        canvas.paint((np.abs(x / width - at) < half) & body, (1.0, 1.0, 1.0), strength=0.65)
    canvas.paint(y > inside, pale, strength=0.5)
    return canvas
