"""Breakfast cups with a small handle, and tumblers without one."""

import math

import numpy as np

from betterbench.assets.authoring import Draft, Turned, disc, generator, glazed, grip, grip_across, part, zone
from betterbench.assets.authoring.mesh import Mesh, sweep
from betterbench.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms
from betterbench.assets.authoring.solids import round_wall, solid_box, upright_cylinder

_WALL, _COLORS = 0.0028, ("blue", "red", "white", "yellow")
_BANDS = {"band": ((0.58, 0.80),), "rim": ((0.92, 2.0), (0.02, 0.07))}


@generator("cup", colors=_COLORS)
def cup(rng: np.random.Generator, color: str) -> Draft:
    """Make a tea cup that narrows to its foot; its small handle points along +x.

    A porcelain cup of 0.15 l is 62 to 70 mm wide, 60 to 65 mm high and weighs 0.14 to 0.18 kg.
    """
    size, base, height = uniforms(rng, (0.985, 1.0), (0.0225, 0.0250), (0.0600, 0.0635))
    # The belly is the width at a third of the height as a share of the rim; the loop stands out by so much.
    belly, loop, thickness = uniforms(rng, (0.955, 0.985), (0.0165, 0.0195), (0.0075, 0.0090))
    decoration, pale = str(rng.choice(["plain", "band", "rim", "dots"])), rng.random() < 0.6
    radius, axis, half = 0.034 * size, -0.5 * loop, 0.5 * thickness
    shade = jittered(PALETTE[color], rng)
    inner, wide = radius - _WALL, belly * radius
    outside = (0.0, base, base + 0.0008, 0.90 * radius, wide, radius, radius - 0.0008)
    z = (0.0, 0.0, 0.0045, 0.0140, 0.0235, height - 0.0010, height, height - 0.0010, 0.0240, 0.0130, 0.0075)
    shell = Turned((*outside, inner, wide - _WALL, 0.86 * radius - _WALL, 0.0), z, sides=22)
    ink = (0.93, 0.92, 0.88) if sum(shade) < 2.2 else mixed(PALETTE["blue"], PALETTE["gray"], 0.2)
    colors = {"lining": (0.90, 0.89, 0.85) if pale else None, "ink": ink}
    glaze = glazed(
        rng, shell, shade, decoration, rows=(2, 3, 5, 7, 9), bands=_BANDS, shadow=(0.86, 0.36), unglazed=0.80, **colors
    )
    ear = _ear(radius, loop, height, half)
    apothem, foot, out = 0.5 * (1.0 + belly) * radius, 0.66 * base, axis + radius + loop
    return Draft(
        shape="cylinder",
        description=f"A {color} breakfast cup with a small handle.",
        tags=("cup", "tea cup", "coffee cup", "drinkware", "tableware"),
        mass_kg=0.16,
        # The loop is mostly air and the solid foot stands for a thin floor.
        densities=(0.4, 0.4, *([1.0] * 8), 0.35),
        parts=(
            part("shell", shell.mesh().moved(x=axis), glaze, specular=0.5, shininess=0.6),
            part("handle", ear.moved(x=axis), shaded(shade, 0.96), specular=0.5, shininess=0.6),
            solid_box((axis - foot, -foot, 0.0), (axis + foot, foot, 0.004)),
            upright_cylinder(base + 0.002, 0.0005, 0.019, x=axis),
            *round_wall(apothem, _WALL, 0.019, height, x=axis),
            solid_box((axis + radius - 0.002, -half, 0.018), (out, half, height - 0.012)),
        ),
        grasps=(grip("body", 0.042, 2.0 * apothem, x=axis, clearance=0.006),),
        regions=(
            disc("base", base, x=axis),
            disc("opening", inner, height, x=axis),
            zone("handle", 0.5 * loop, half, 0.5 * height, x=axis + radius + 0.5 * loop, half_z=0.5 * height - 0.014),
        ),
        parameters={"radius_m": radius, "height_m": height, "base_m": base, "decoration": decoration},
    )


def _ear(radius: float, loop: float, height: float, half: float) -> Mesh:
    """Return the ear-shaped handle of half a width [m] that stands out by ``loop`` [m]."""
    top, low = height - 0.014, 0.018
    wall, out = radius - 0.003, radius + loop - 0.003
    b, bevel = 0.0029, 0.0014
    section = [(half, -b + bevel), (half, b - bevel), (0.0, b), (-half, b - bevel), (-half, -b + bevel), (0.0, -b)]
    x = (wall, out - 0.006, out - 0.001, out, out - 0.005, wall - 0.001)
    z = (top, top + 0.001, top - 0.005, top - 0.013)
    return sweep(x, (*z, low + 0.006, low), section, crease_degrees=55.0)


@generator("tumbler", colors=_COLORS)
def tumbler(rng: np.random.Generator, color: str) -> Draft:
    """Make a straight tumbler of colored plastic, ribbed or faceted, without a handle.

    A tumbler of 0.25 l in acrylic is about 65 mm wide and 85 mm high and weighs 0.1 to 0.2 kg. Its collision shape is
    filled: nothing is put into it, and a jaw can then take it at any yaw with the same width.
    """
    size, share, height = uniforms(rng, (0.985, 1.0), (0.91, 0.96), (0.082, 0.088))
    radius, pattern, wall = 0.033 * size, str(rng.choice(["facets", "ribs", "rings"])), 0.0026
    base, faceted = radius * share, pattern == "facets"
    shade = jittered(mixed(PALETTE[color], (0.85, 0.90, 0.95), 0.12), rng)
    radii = (0.0, base - 0.002, base, radius, radius - 0.5 * wall, radius - wall, base - wall, 0.0)
    z = (0.0, 0.0, 0.003, height - 0.0008, height, height - 0.0008, 0.010, 0.010)
    sides, crease, phase = (12, 22.0, math.pi / 12) if faceted else (28, 40.0, 0.0)
    glass = Turned(radii, z, sides, crease, phase=phase)
    edge = radius * (math.cos(math.pi / 12) if faceted else 1.0) - wall
    return Draft(
        shape="cylinder",
        description=f"A {color} tumbler with {pattern}.",
        tags=("tumbler", "glass", "beaker", "drinkware", "tableware"),
        mass_kg=0.15,
        parts=(
            part("shell", glass.mesh(), _glass(rng, glass, shade, pattern=pattern), specular=0.7, shininess=0.7),
            *glass.filled(0.66 * base),
        ),
        grasps=(grip_across(0.57 * height, radius, clearance=0.006),),
        regions=(disc("base", base), disc("opening", edge, height)),
        parameters={"radius_m": radius, "height_m": height, "pattern": pattern},
    )


def _glass(rng: np.random.Generator, glass: Turned, shade: Rgb, *, pattern: str) -> Canvas:
    """Draw colored glass: dark at the thick foot, bright at the rim, pale streaks where it catches the light."""
    _, _, foot, rim, _, inside, floor, _ = glass.rows
    canvas = glass.canvas(shade, (256, 256))
    x, y, width = canvas.x, canvas.y, canvas.width
    canvas.shade(np.where(y < rim, 0.72 + 0.28 * np.clip(y / rim, 0.0, 1.0), 1.0))
    body = canvas.between(foot + 0.004, rim - 0.010)
    pale = mixed(shade, (1.0, 1.0, 1.0), 0.45)
    if pattern == "ribs":
        canvas.paint(body * np.clip(np.cos(2.0 * math.pi * x / width * 14.0), 0.0, 1.0), pale, strength=0.65)
    elif pattern == "rings":
        canvas.paint(body & (np.abs((y - foot) % 0.014 - 0.010) < 0.0018), pale, strength=0.8)
    else:
        canvas.paint(np.abs((x / width * 6.0) % 1.0 - 0.5) > 0.47, pale, strength=0.5)
    canvas.paint(canvas.between(rim - 0.0035, inside), pale)
    canvas.shadow(inside, floor, 0.84, 0.40)
    canvas.grain(rng, cells=(5, 3), amount=0.02)
    return canvas
