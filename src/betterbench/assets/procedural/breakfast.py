"""Tableware that stands on a breakfast table: a bowl of cereal, a salt shaker, a jar of jam, an egg in its cup."""

from __future__ import annotations

import math

import numpy as np

from betterbench.assets.asset import CollisionPart, Grasp
from betterbench.assets.authoring.draft import JAW_OPENS_ALONG_Y, Draft, disc, part
from betterbench.assets.authoring.mesh import Mesh, lathe, profile_length
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import foot, upright_cylinder
from betterbench.geometry import Pose
from betterbench.state import Region


def _from_above(mesh: Mesh, radius: float) -> Mesh:
    """Return the mesh with a picture of side two laid on it from above, its rim at distance one."""
    return Mesh(mesh.vertices, mesh.faces, 0.5 + 0.5 * mesh.vertices[:, :2] / radius)


def _base(radius: float) -> Region:
    """Return the disc on which a thing stands."""
    return disc("base", radius)


def _round_body(height: float, radius: float) -> tuple[Grasp, ...]:
    """Return the grasp across the diameter at a height."""
    pose = Pose((0.0, 0.0, height), JAW_OPENS_ALONG_Y)
    return (Grasp("body", pose, 2.0 * radius, clearance_m=min(0.012, 0.039 - radius), symmetric_yaw=True),)


@generator("cereal_bowl", colours=("white", "blue", "green"))
def cereal_bowl(rng: np.random.Generator, colour: str) -> Draft:
    """Make a bowl of cereal with milk.

    A small bowl of 0.25 kg filled with 0.2 kg of cereal and milk. It is too wide for a jaw and filled to the rim, so
    its collision shape is solid.
    """
    radius = 0.060 * rng.uniform(0.98, 1.0)
    stand = rng.uniform(0.030, 0.034)
    height = rng.uniform(0.0485, 0.0520)
    level = height - rng.uniform(0.009, 0.012)
    cereal = str(rng.choice(["rings", "flakes", "balls"]))
    striped = rng.random() < 0.5
    glaze = jittered(mixed(PALETTE[colour], (0.9, 0.9, 0.9), 0.10), rng)
    inside = radius - 0.0035 - 0.10 * (height - level)
    profile = [
        (0.0, 0.0),
        (stand, 0.0),
        (stand + 0.001, 0.0050),
        (0.76 * radius, 0.0180),
        (0.93 * radius, 0.0340),
        (radius, height - 0.0010),
        (radius - 0.0012, height),
        (radius - 0.0030, height - 0.0010),
        (inside, level - 0.002),
        (0.0, level - 0.002),
    ]
    length = profile_length(profile)
    canvas = Canvas(1.0, float(length[-1]), (8, 128), glaze)
    accent = (0.92, 0.91, 0.87) if colour != "white" else mixed(PALETTE["blue"], PALETTE["grey"], 0.2)
    if striped:
        wall = float(length[5] - length[3])
        for share in (0.50, 0.70):
            canvas.band(float(length[3]) + share * wall, float(length[3]) + (share + 0.11) * wall, accent)
    canvas.shade(0.80 + 0.20 * np.clip(canvas.y / float(length[5]), 0.0, 1.0))
    canvas.shade(np.where(canvas.y > length[7], 0.88, 1.0))
    surface = lathe(
        [(0.0, level - 0.003), (inside + 0.0008, level - 0.003), (inside + 0.0008, level), (0.0, level)], 24
    )
    collision = (
        foot(0.68 * stand),
        upright_cylinder(0.76 * radius, 0.0005, 0.018),
        upright_cylinder(radius, 0.018, height),
    )
    return Draft(
        shape="round",
        description=f"A {colour} bowl of cereal with milk.",
        tags=("bowl", "cereal bowl", "cereal", "breakfast", "tableware"),
        mass_kg=0.45,
        parts=(
            part("bowl", lathe(profile, 24), canvas, specular=0.5, shininess=0.6),
            part("cereal", _from_above(surface, inside), _cereal(rng, kind=cereal), specular=0.25),
            *collision,
        ),
        regions=(_base(stand), disc("top", radius, height)),
        parameters={"radius_m": radius, "height_m": height, "cereal": cereal},
    )


def _cereal(rng: np.random.Generator, *, kind: str) -> Canvas:
    """Draw milk with cereal floating in it, seen from above."""
    milk: Colour = (0.95, 0.94, 0.90)
    canvas = Canvas(2.0, 2.0, (192, 192), milk)
    r = np.hypot(canvas.x - 1.0, canvas.y - 1.0)
    canvas.shade(1.0 - 0.10 * np.clip((r - 0.85) / 0.15, 0.0, 1.0))
    placed: list[tuple[float, float]] = []
    gap = 0.17 if kind == "flakes" else 0.20
    for _ in range(700):
        angle, distance = rng.uniform(0.0, 2.0 * math.pi), 0.84 * math.sqrt(rng.random())
        x, y = 1.0 + distance * math.cos(angle), 1.0 + distance * math.sin(angle)
        if any(math.hypot(x - px, y - py) < gap for px, py in placed):
            continue
        placed.append((x, y))
        crust = jittered((0.80, 0.52, 0.17), rng, amount=0.16)
        turn = rng.uniform(0.0, math.pi)
        if kind == "flakes":
            size = rng.uniform(0.09, 0.13)
            canvas.ellipse((x + 0.015, y - 0.02), (size, 0.7 * size), (0.68, 0.60, 0.48), turn)
            canvas.ellipse((x, y), (size, 0.7 * size), crust, turn)
            canvas.ellipse((x, y), (0.55 * size, 0.3 * size), shaded(crust, 1.18), turn)
        else:
            if kind == "balls":
                crust = jittered((0.42, 0.22, 0.09), rng, amount=0.16)
            canvas.ellipse((x + 0.015, y - 0.02), (0.105, 0.105), (0.70, 0.63, 0.52))
            canvas.ellipse((x, y), (0.098, 0.098), crust)
            if kind == "rings":
                canvas.ellipse((x, y), (0.042, 0.042), (0.86, 0.80, 0.68))
            else:
                canvas.ellipse((x - 0.02, y + 0.025), (0.045, 0.04), shaded(crust, 1.3))
    return canvas


@generator("salt_shaker", colours=("white", "silver"))
def salt_shaker(rng: np.random.Generator, colour: str) -> Draft:
    """Make a salt shaker with a pierced chrome top.

    A porcelain or steel shaker of this size, half full, weighs about 0.12 kg.
    """
    radius = 0.020 * rng.uniform(0.97, 1.0)
    height = rng.uniform(0.073, 0.077)
    shoulder = height - rng.uniform(0.018, 0.022)
    waist = rng.uniform(0.80, 1.0)
    facets = rng.random() < 0.4
    shade = jittered(PALETTE[colour], rng, amount=0.05)
    profile = [
        (0.0, 0.0),
        (radius - 0.0015, 0.0),
        (radius, 0.0020),
        (0.5 * (1.0 + waist) * radius, 0.55 * shoulder),
        (0.88 * waist * radius, shoulder),
        (0.0, shoulder),
    ]
    cap_radius = 0.88 * waist * radius + 0.0012
    cap = [
        (0.0, shoulder - 0.0010),
        (cap_radius, shoulder - 0.0010),
        (cap_radius, shoulder + 0.0070),
        (0.93 * cap_radius, height - 0.0070),
        (0.70 * cap_radius, height - 0.0022),
        (0.36 * cap_radius, height - 0.0004),
        (0.0, height),
    ]
    length = profile_length(profile)
    canvas = Canvas(math.pi * radius, float(length[-1]), (128, 128), shade)
    x, y = canvas.x, canvas.y
    canvas.shade(0.84 + 0.16 * np.clip(y / float(length[4]), 0.0, 1.0))
    # An S for salt on each half of the body: two arcs of a ring, open on opposite sides.
    ink: Colour = (0.15, 0.22, 0.42)
    size = 0.0052
    cx, cy = 0.5 * math.pi * radius, float(length[2]) + 0.55 * shoulder
    for sign in (1.0, -1.0):
        dx, dy = sign * (x - cx), sign * (y - cy) - size
        ring = np.abs(np.hypot(dx, dy) - size) < 0.0014
        canvas.paint(ring & ~((dx > 0.0) & (dy < 0.35 * size)), ink)
    body = lathe(profile, 12 if facets else 20, crease_degrees=22.0 if facets else 40.0, wrap=True, phase=math.pi / 2)
    top = lathe(cap, 18, crease_degrees=55.0)
    picture = Canvas(2.0, 2.0, (96, 96), (0.78, 0.79, 0.82))
    r = np.hypot(picture.x - 1.0, picture.y - 1.0)
    picture.shade(1.0 - 0.30 * np.exp(-(((r - 0.80) / 0.08) ** 2)))
    for k in range(6):
        a = 2.0 * math.pi * k / 6
        picture.ellipse((1.0 + 0.40 * math.cos(a), 1.0 + 0.40 * math.sin(a)), (0.095, 0.095), (0.08, 0.08, 0.09))
    picture.ellipse((1.0, 1.0), (0.095, 0.095), (0.08, 0.08, 0.09))
    collision = (
        foot(0.66 * radius),
        upright_cylinder(radius, 0.0005, 0.62 * shoulder),
        upright_cylinder(cap_radius, 0.62 * shoulder, height - 0.001),
    )
    return Draft(
        shape="cylinder",
        description=f"A {colour} salt shaker with a pierced chrome top.",
        tags=("salt", "salt shaker", "shaker", "condiment", "tableware"),
        mass_kg=0.12,
        parts=(
            part("body", body, canvas, specular=0.5, shininess=0.6),
            part("top", _from_above(top, cap_radius), picture, specular=0.9, shininess=0.8),
            *collision,
        ),
        grasps=_round_body(0.40 * height, radius),
        regions=(_base(radius), disc("top", 0.7 * cap_radius, height)),
        parameters={"radius_m": radius, "height_m": height, "facets": str(facets)},
    )


@generator("jam_jar", colours=("red", "orange"))
def jam_jar(rng: np.random.Generator, colour: str) -> Draft:
    """Make a jar of jam with a screw lid and a label; the colour is that of the jam.

    A jar of 0.12 l, full, weighs about 0.25 kg.
    """
    radius = 0.030 * rng.uniform(0.975, 1.0)
    height = rng.uniform(0.072, 0.078)
    lid_low = height - rng.uniform(0.013, 0.016)
    lid_radius = 0.93 * radius
    lid_kind = str(rng.choice(["gingham", "gold", "white"]))
    fruit = {"red": (0.50, 0.03, 0.05), "orange": (0.86, 0.38, 0.03)}[colour]
    jam = jittered(fruit, rng, amount=0.10)
    glass = mixed(jam, (0.90, 0.95, 0.95), 0.60)
    profile = [
        (0.0, 0.0),
        (radius - 0.004, 0.0),
        (radius, 0.0045),
        (radius, lid_low - 0.0090),
        (0.95 * radius, lid_low - 0.0040),
        (0.86 * radius, lid_low - 0.0010),
        (0.86 * radius, lid_low + 0.001),
        (0.0, lid_low + 0.001),
    ]
    length = profile_length(profile)
    width = math.pi * radius
    canvas = Canvas(width, float(length[-1]), (192, 128), jam)
    x, y = canvas.x, canvas.y
    canvas.paint(y > length[3] + 0.001, glass)
    canvas.paint(y < length[2], glass, strength=0.5)
    canvas.grain(rng, cells=(14, 9), amount=0.10)
    for at in (0.06 * width, 0.94 * width):
        canvas.paint((np.abs(x - at) < 0.0016) & (y > length[2]) & (y < length[3]), (1.0, 0.95, 0.9), strength=0.45)
    middle = 0.5 * float(length[2] + length[3])
    tall = 0.62 * 0.5 * float(length[3] - length[2])
    label = (np.abs(x - 0.5 * width) < 0.27 * width) & (np.abs(y - middle) < tall)
    canvas.paint(label, (0.95, 0.93, 0.86))
    canvas.paint(label & (np.abs(y - middle) > 0.84 * tall), jam)
    canvas.ellipse((0.5 * width, middle + 0.22 * tall), (0.0062, 0.0062), jam)
    canvas.ellipse((0.5 * width + 0.003, middle + 0.22 * tall + 0.0068), (0.0042, 0.0018), (0.18, 0.45, 0.14), 0.5)
    for drop, share in ((-0.38, 0.15), (-0.60, 0.11)):
        canvas.paint(
            (np.abs(x - 0.5 * width) < share * width) & (np.abs(y - middle - drop * tall) < 0.0010), (0.25, 0.16, 0.12)
        )
    lid = lathe(
        [
            (0.0, lid_low),
            (lid_radius, lid_low),
            (lid_radius, height - 0.0020),
            (lid_radius - 0.0020, height),
            (0.82 * lid_radius, height),
            (0.78 * lid_radius, height - 0.0010),
            (0.0, height - 0.0010),
        ],
        22,
        crease_degrees=50.0,
    )
    paint = {"gingham": (0.93, 0.92, 0.88), "gold": (0.80, 0.62, 0.20), "white": (0.92, 0.92, 0.91)}[lid_kind]
    cover = Canvas(2.0, 2.0, (128, 128), paint)
    if lid_kind == "gingham":
        ink = jam if colour == "red" else (0.20, 0.42, 0.26)
        columns, rows = (cover.x % 0.36) < 0.18, (cover.y % 0.36) < 0.18
        cover.paint(columns, ink, strength=0.55)
        cover.paint(rows, ink, strength=0.55)
    else:
        r = np.hypot(cover.x - 1.0, cover.y - 1.0)
        cover.paint((r > 0.50) & (r < 0.58), shaded(paint, 0.75))
    collision = (
        foot(0.64 * radius),
        upright_cylinder(radius, 0.0005, lid_low - 0.005),
        upright_cylinder(lid_radius, lid_low - 0.005, height),
    )
    return Draft(
        shape="cylinder",
        description=f"A glass jar of {colour} jam with a lid and a label.",
        tags=("jam", "jam jar", "marmalade", "jar", "breakfast"),
        mass_kg=0.25,
        parts=(
            part("jar", lathe(profile, 22, wrap=True, phase=math.pi / 2), canvas, specular=0.8, shininess=0.8),
            part("lid", _from_above(lid, lid_radius), cover, specular=0.4, shininess=0.5),
            *collision,
        ),
        grasps=_round_body(0.45 * height, radius),
        regions=(_base(radius), disc("top", 0.7 * lid_radius, height)),
        parameters={"radius_m": radius, "height_m": height, "lid": lid_kind},
    )


@generator("egg_cup", colours=("white", "yellow"))
def egg_cup(rng: np.random.Generator, colour: str) -> Draft:
    """Make a footed egg cup with a boiled egg in it; the colour is that of the cup.

    A hen's egg weighs 60 g, a porcelain cup the same; the egg does not come out.
    """
    radius = 0.026 * rng.uniform(0.97, 1.0)
    stand = radius * rng.uniform(0.82, 0.92)
    lip = rng.uniform(0.040, 0.043)
    height = rng.uniform(0.0685, 0.0715)
    stem = rng.uniform(0.36, 0.46)
    banded = rng.random() < 0.5
    glaze = jittered(PALETTE[colour], rng, amount=0.05)
    brown = rng.random()
    shell: Colour = mixed((0.95, 0.91, 0.84), (0.80, 0.54, 0.34), 0.25 + 0.75 * brown)
    profile = [
        (0.0, 0.0),
        (stand, 0.0),
        (stand, 0.0030),
        (stem * radius, 0.0090),
        (stem * radius, 0.0140),
        (0.78 * radius, 0.0220),
        (0.97 * radius, 0.0320),
        (radius, lip - 0.0008),
        (radius - 0.0012, lip),
        (radius - 0.0035, lip - 0.0030),
        (0.0, lip - 0.0030),
    ]
    length = profile_length(profile)
    canvas = Canvas(1.0, float(length[-1]), (8, 128), glaze)
    accent = mixed(PALETTE["blue"], PALETTE["grey"], 0.2) if colour == "white" else (0.93, 0.92, 0.88)
    if banded:
        canvas.band(float(length[7]) - 0.0075, float(length[7]) - 0.0035, accent)
        canvas.band(float(length[1]), float(length[2]) + 0.001, accent)
    canvas.shade(np.where(canvas.y > length[8], 0.75, 1.0))
    egg_radius = radius - 0.0042
    angles = np.linspace(-0.15 * math.pi, 0.5 * math.pi, 7).tolist()
    middle = lip - 0.001
    egg = [(0.0, middle + (height - middle) * math.sin(angles[0]))]
    egg += [(egg_radius * max(math.cos(a), 0.0), middle + (height - middle) * math.sin(a)) for a in angles]
    spots = Canvas(2.0, 2.0, (96, 96), jittered(shell, rng, amount=0.04))
    spots.grain(rng, cells=(20, 20), amount=0.035)
    for u, v, size in rng.uniform(0.0, 1.0, (26, 3)).tolist():
        spots.ellipse((2.0 * u, 2.0 * v), (0.010 + 0.014 * size, 0.010 + 0.014 * size), shaded(shell, 0.82))
    collision = (
        foot(0.66 * stand),
        upright_cylinder(stand, 0.0005, 0.020),
        upright_cylinder(radius, 0.020, lip),
        CollisionPart("ellipsoid", (egg_radius, egg_radius, height - middle), (0.0, 0.0, middle)),
    )
    return Draft(
        shape="irregular",
        description=f"A boiled egg in a {colour} egg cup.",
        tags=("egg cup", "egg", "boiled egg", "breakfast", "tableware"),
        mass_kg=0.12,
        parts=(
            part("cup", lathe(profile, 20, crease_degrees=50.0), canvas, specular=0.5),
            part("egg", _from_above(lathe(egg, 16, crease_degrees=80.0), egg_radius), spots, specular=0.2),
            *collision,
        ),
        grasps=_round_body(0.031, radius),
        regions=(_base(stand),),
        parameters={"radius_m": radius, "height_m": height, "banded": str(banded)},
    )
