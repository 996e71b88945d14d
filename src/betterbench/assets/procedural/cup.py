"""Breakfast cups with a small handle, and tumblers without one."""

from __future__ import annotations

import math

import numpy as np

from betterbench.assets.asset import CollisionPart
from betterbench.assets.authoring.draft import Draft, disc, grip, part
from betterbench.assets.authoring.mesh import Mesh, lathe, profile_length, sweep
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import foot, solid_box, upright_cylinder
from betterbench.geometry import from_yaw
from betterbench.state import Region

_WALL = 0.0028
_COLOURS = ("blue", "red", "white", "yellow")
_CUP_GRIP_HEIGHT = 0.042


@generator("cup", colours=_COLOURS)
def cup(rng: np.random.Generator, colour: str) -> Draft:
    """Make a tea cup that narrows to its foot; its small handle points along +x.

    A porcelain cup of 0.15 l is 62 to 70 mm wide, 60 to 65 mm high and weighs 0.14 to 0.18 kg.
    """
    radius = 0.034 * rng.uniform(0.985, 1.0)
    base = rng.uniform(0.0225, 0.0250)
    height = rng.uniform(0.0600, 0.0635)
    belly = rng.uniform(0.955, 0.985)  # width at a third of the height as a share of the rim
    loop = rng.uniform(0.0165, 0.0195)  # how far the handle stands out
    thickness = rng.uniform(0.0075, 0.0090)
    decoration = str(rng.choice(["plain", "band", "rim", "dots"]))
    pale = rng.random() < 0.6
    axis = -0.5 * loop
    shade = jittered(PALETTE[colour], rng)
    inner = radius - _WALL
    profile = [
        (0.0, 0.0),
        (base, 0.0),
        (base + 0.0008, 0.0045),
        (0.90 * radius, 0.0140),
        (belly * radius, 0.0235),
        (radius, height - 0.0010),
        (radius - 0.0008, height),
        (inner, height - 0.0010),
        (belly * radius - _WALL, 0.0240),
        (0.86 * radius - _WALL, 0.0130),
        (0.0, 0.0075),
    ]
    shell = lathe(profile, 22, wrap=True)
    picture = _cup_glaze(profile, shade, decoration=decoration, pale=pale)
    handle = _loop(radius, loop, height, thickness=thickness)

    apothem = 0.5 * (1.0 + belly) * radius
    low = 0.019
    half_height = 0.5 * (height - low)
    walls = [
        CollisionPart(
            "box",
            (0.5 * _WALL, apothem * math.tan(math.pi / 8), half_height),
            (
                axis + (apothem - 0.5 * _WALL) * math.cos(a),
                (apothem - 0.5 * _WALL) * math.sin(a),
                low + half_height,
            ),
            from_yaw(a),
        )
        for a in (k * math.pi / 4 for k in range(8))
    ]
    half = 0.66 * base
    collision = (
        solid_box((axis - half, -half, 0.0), (axis + half, half, 0.004)),
        CollisionPart("cylinder", (base + 0.002, 0.5 * (low - 0.0005), 0.0), (axis, 0.0, 0.5 * (low + 0.0005))),
        *walls,
        solid_box(
            (axis + radius - 0.002, -0.5 * thickness, 0.018), (axis + radius + loop, 0.5 * thickness, height - 0.012)
        ),
    )
    # The loop is mostly air and the solid foot stands for a thin floor.
    densities = (0.4, 0.4, *([1.0] * 8), 0.35)
    return Draft(
        shape="cylinder",
        description=f"A {colour} breakfast cup with a small handle.",
        tags=("cup", "tea cup", "coffee cup", "drinkware", "tableware"),
        mass_kg=0.16,
        densities=densities,
        parts=(
            part("shell", shell.moved(x=axis), picture, specular=0.5, shininess=0.6),
            part("handle", handle.moved(x=axis), shaded(shade, 0.96), specular=0.5, shininess=0.6),
            *collision,
        ),
        grasps=(grip("body", _CUP_GRIP_HEIGHT, 2.0 * apothem, x=axis, clearance=0.006),),
        regions=(
            disc("base", base, x=axis),
            disc("opening", inner, height, x=axis),
            Region(
                "handle",
                (axis + radius + 0.5 * loop, 0.0, 0.5 * height),
                (0.5 * loop, 0.5 * thickness, 0.5 * height - 0.014),
            ),
        ),
        parameters={"radius_m": radius, "height_m": height, "base_m": base, "decoration": decoration},
    )


def _loop(radius: float, loop: float, height: float, *, thickness: float) -> Mesh:
    """Return the ear-shaped handle."""
    top, low = height - 0.014, 0.018
    wall, out = radius - 0.003, radius + loop - 0.003
    path = [
        (wall, 0.0, top),
        (out - 0.006, 0.0, top + 0.001),
        (out - 0.001, 0.0, top - 0.005),
        (out, 0.0, top - 0.013),
        (out - 0.005, 0.0, low + 0.006),
        (wall - 0.001, 0.0, low),
    ]
    a, b, bevel = 0.5 * thickness, 0.0029, 0.0014
    section = [(a, -b + bevel), (a, b - bevel), (0.0, b), (-a, b - bevel), (-a, -b + bevel), (0.0, -b)]
    return sweep(path, section, crease_degrees=55.0)


def _cup_glaze(profile: list[tuple[float, float]], shade: Colour, *, decoration: str, pale: bool) -> Canvas:
    """Draw the cup from its foot over the rim to the floor inside."""
    length = profile_length(profile)
    wall, rim, inside, floor = (float(length[k]) for k in (3, 5, 7, 9))
    width = math.pi * profile[5][0]
    canvas = Canvas(width, float(length[-1]), (128, 256), shade)
    x, y = canvas.x, canvas.y
    span = rim - wall
    accent = (0.93, 0.92, 0.88) if sum(shade) < 2.2 else mixed(PALETTE["blue"], PALETTE["grey"], 0.2)
    if decoration == "band":
        canvas.band(wall + 0.58 * span, wall + 0.80 * span, accent)
    elif decoration == "rim":
        canvas.band(rim - 0.08 * span, inside, accent)
        canvas.band(wall + 0.02 * span, wall + 0.07 * span, accent)
    elif decoration == "dots":
        for k in range(9):
            for row in range(2):
                centre = ((k + 0.5 * row) * width / 8.0, wall + (0.42 + 0.30 * row) * span)
                canvas.ellipse(centre, (0.0030, 0.0030), accent)
    if pale:
        canvas.paint(y > inside, (0.90, 0.89, 0.85))
    down = np.clip((y - inside) / (floor - inside), 0.0, 1.0)
    canvas.shade(np.where(y > inside, 0.86 - 0.36 * down, 1.0))
    canvas.shade(np.where(y < length[2], 0.80, 1.0) * np.where(x >= 0.0, 1.0, 1.0))
    canvas.paint((y > rim) & (y < inside), shaded(shade, 1.25), strength=0.6)
    return canvas


@generator("tumbler", colours=_COLOURS)
def tumbler(rng: np.random.Generator, colour: str) -> Draft:
    """Make a straight tumbler of coloured plastic, ribbed or faceted, without a handle.

    A tumbler of 0.25 l in acrylic is about 65 mm wide and 85 mm high and weighs 0.1 to 0.2 kg. Its collision shape is
    filled: nothing is put into it, and a jaw can then take it at any yaw with the same width.
    """
    radius = 0.033 * rng.uniform(0.985, 1.0)
    base = radius * rng.uniform(0.91, 0.96)
    height = rng.uniform(0.082, 0.088)
    pattern = str(rng.choice(["facets", "ribs", "rings"]))
    shade = jittered(mixed(PALETTE[colour], (0.85, 0.90, 0.95), 0.12), rng)
    wall = 0.0026
    profile = [
        (0.0, 0.0),
        (base - 0.002, 0.0),
        (base, 0.003),
        (radius, height - 0.0008),
        (radius - 0.5 * wall, height),
        (radius - wall, height - 0.0008),
        (base - wall, 0.010),
        (0.0, 0.010),
    ]
    if pattern == "facets":
        shell = lathe(profile, 12, crease_degrees=22.0, wrap=True, phase=math.pi / 12)
    else:
        shell = lathe(profile, 28, wrap=True)
    length = profile_length(profile)
    rim, inside, floor = (float(length[k]) for k in (3, 5, 6))
    width = math.pi * radius
    canvas = Canvas(width, float(length[-1]), (256, 256), shade)
    x, y = canvas.x, canvas.y
    # Coloured glass: dark at the thick foot, bright at the rim, pale streaks where it catches the light.
    canvas.shade(np.where(y < rim, 0.72 + 0.28 * np.clip(y / rim, 0.0, 1.0), 1.0))
    body = (y > length[2] + 0.004) & (y < rim - 0.010)
    pale = mixed(shade, (1.0, 1.0, 1.0), 0.45)
    if pattern == "ribs":
        canvas.paint(body * np.clip(np.cos(2.0 * math.pi * x / width * 14.0), 0.0, 1.0), pale, strength=0.65)
    elif pattern == "rings":
        canvas.paint(body & (np.abs((y - length[2]) % 0.014 - 0.010) < 0.0018), pale, strength=0.8)
    else:
        canvas.paint(np.abs((x / width * 6.0) % 1.0 - 0.5) > 0.47, pale, strength=0.5)
    canvas.paint((y > rim - 0.0035) & (y < inside), pale)
    down = np.clip((y - inside) / (floor - inside), 0.0, 1.0)
    canvas.shade(np.where(y > inside, 0.84 - 0.40 * down, 1.0))
    canvas.grain(rng, cells=(5, 3), amount=0.02)
    edge = radius * (math.cos(math.pi / 12) if pattern == "facets" else 1.0)
    collision = (foot(0.66 * base), upright_cylinder(radius, 0.0005, height))
    return Draft(
        shape="cylinder",
        description=f"A {colour} tumbler with {pattern}.",
        tags=("tumbler", "glass", "beaker", "drinkware", "tableware"),
        mass_kg=0.15,
        parts=(part("shell", shell, canvas, specular=0.7, shininess=0.7), *collision),
        grasps=(grip("body", 0.57 * height, 2.0 * radius, clearance=0.006, symmetric_yaw=True),),
        regions=(
            disc("base", base),
            disc("opening", edge - wall, height),
        ),
        parameters={"radius_m": radius, "height_m": height, "pattern": pattern},
    )
