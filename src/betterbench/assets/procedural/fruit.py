"""Fruit: apples, oranges and lemons, each on a small flat foot so that it lies where it is put."""

import math

import numpy as np

from betterbench.assets.asset import CollisionPart, Grasp
from betterbench.assets.authoring.draft import Draft, disc, grip, part, zone
from betterbench.assets.authoring.mesh import Mesh, creased, lathe, prism, profile_length, sweep, tube_section
from betterbench.assets.authoring.paint import PALETTE, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import solid_box

_APPLE_RADIUS = 0.035
_APPLE_SKIN: dict[str, Colour] = {"red": (0.70, 0.055, 0.06), "green": (0.42, 0.62, 0.11), "yellow": (0.92, 0.72, 0.16)}
# Colour of the skin around the stalk, where the sun does not reach.
_APPLE_CAVITY: dict[str, Colour] = {
    "red": (0.80, 0.52, 0.16),
    "green": (0.52, 0.60, 0.20),
    "yellow": (0.66, 0.62, 0.18),
}
_SEGMENTS = 18


@generator("apple", colours=("red", "green", "yellow"))
def apple(rng: np.random.Generator, colour: str) -> Draft:
    """Make an apple with shoulders, a stalk in its dimple and five faint lobes.

    A small dessert apple is 65 to 70 mm wide and weighs 0.15 to 0.18 kg; small ones are used because the jaw opens to
    80 mm.
    """
    radius, height = _APPLE_RADIUS * rng.uniform(0.985, 1.0), rng.uniform(0.0620, 0.0665)
    waist = rng.uniform(0.86, 0.97)  # slender apples narrow towards the calyx
    lobes, stalk, lean = rng.uniform(0.015, 0.045), rng.uniform(0.011, 0.015), rng.uniform(-0.004, 0.004)
    leafy, blush = rng.random() < 0.4, rng.uniform(0.15, 0.9)
    profile = [
        (share * radius * (waist if level < 0.35 else 1.0), level * height)
        for share, level in (
            (0.0, 0.060),
            (0.20, 0.020),
            (0.40, 0.0),
            (0.72, 0.100),
            (0.955, 0.300),
            (1.0, 0.540),
            (0.965, 0.720),
            (0.830, 0.885),
            (0.560, 0.990),
            (0.330, 0.985),
            (0.130, 0.880),
            (0.0, 0.830),
        )
    ]
    skin = jittered(_APPLE_SKIN[colour], rng)
    body = lathe(profile, _SEGMENTS, crease_degrees=80.0, wrap=True, phase=math.pi / 2)
    angle = np.arctan2(body.vertices[:, 1], body.vertices[:, 0])
    level = body.vertices[:, 2] / height
    factor = (1.0 - lobes * np.clip(1.0 - 3.0 * level, 0.0, 1.0) * (1.0 + np.cos(5.0 * angle)))[:, None]
    body = Mesh(body.vertices * np.hstack([factor, factor, np.ones_like(factor)]), body.faces, body.uv)
    picture = _apple_skin(rng, profile, skin, _APPLE_CAVITY[colour], colour=colour, blush=blush)

    root = 0.83 * height - 0.001
    path = [(0.0, 0.0, root), (0.25 * lean, 0.0, root + 0.5 * stalk), (lean, 0.0, root + stalk)]
    bark = jittered((0.33, 0.20, 0.09), rng)
    parts = [
        part("skin", body, picture, specular=0.55, shininess=0.6),
        part("stalk", sweep(path, tube_section(0.0017, 5), crease_degrees=80.0), bark, specular=0.1),
    ]
    if leafy:
        turn = rng.uniform(-0.9, 0.9)
        leaf = _leaf(0.024, 0.012).rotated("y", -0.20).rotated("z", turn).moved(z=root + 0.55 * stalk)
        parts.append(part("leaf", leaf, jittered((0.22, 0.45, 0.10), rng), specular=0.3))

    collision = _round_collision(radius, height, foot_half=0.011)
    return Draft(
        shape="round",
        description=f"A {colour} apple.",
        tags=("apple", "fruit", "food"),
        mass_kg=0.17,
        parts=(*parts, *collision),
        grasps=(_across(0.5 * height + 0.0005, radius),),
        regions=(disc("base", 0.4 * radius),),
        parameters={"radius_m": radius, "height_m": height, "leaf": str(leafy)},
    )


def _round_collision(radius: float, height: float, *, foot_half: float) -> tuple[CollisionPart, ...]:
    """Return a spheroid of the fruit's size on a flat foot.

    The foot is wide enough for the fruit to come back from a lean of 15 degrees and narrow enough to stay hidden.
    """
    half = 0.5 * height - 0.00025
    return (
        solid_box((-foot_half, -foot_half, 0.0), (foot_half, foot_half, 0.006)),
        CollisionPart("ellipsoid", (radius, radius, half), (0.0, 0.0, half + 0.0005)),
    )


def _across(height: float, radius: float) -> Grasp:
    """Return the grasp across the diameter at the widest height."""
    return grip("body", height, 2.0 * radius, clearance=min(0.012, 0.0395 - radius), symmetric_yaw=True)


def _leaf(length: float, width: float) -> Mesh:
    """Return a thin pointed leaf from the origin along +x, its blade folded up a little at the tip."""
    outline = [(0.0, 0.0), (0.30, -0.42), (0.62, -0.40), (1.0, 0.0), (0.62, 0.40), (0.30, 0.42)]
    low = np.array([(length * x, width * y, 0.004 * x * x) for x, y in outline])
    return prism([low, low + np.array([0.0, 0.0, 0.0008])], crease_degrees=50.0)


def _apple_skin(
    rng: np.random.Generator,
    profile: list[tuple[float, float]],
    skin: Colour,
    cavity: Colour,
    *,
    colour: str,
    blush: float,
) -> Canvas:
    """Draw the skin from the calyx to the stalk: streaks, a sunny side, pale pores, russet around the stalk."""
    length = profile_length(profile)
    width, whole = math.pi * _APPLE_RADIUS, float(length[-1])
    canvas = Canvas(width, whole, (128, 256), skin)
    x, y = canvas.x, canvas.y
    shoulder = float(length[8])
    if colour == "yellow":
        sun = np.exp(-(((x - 0.68 * width) / (0.17 * width)) ** 2 + ((y - 0.60 * whole) / (0.20 * whole)) ** 2))
        canvas.paint(sun, (0.86, 0.30, 0.12), strength=0.55 * blush)
    elif colour == "green":
        sun = np.exp(-(((x - 0.35 * width) / (0.22 * width)) ** 2 + ((y - 0.62 * whole) / (0.22 * whole)) ** 2))
        canvas.paint(sun, (0.70, 0.72, 0.22), strength=0.55 * blush)
    else:
        # Streaks from pole to pole where the paler ground shows through, more on the side away from the sun.
        shadow = np.clip(1.3 * np.abs(x / width - 0.62) - 0.12, 0.0, 1.0) * blush
        for _ in range(46):
            at, thick = rng.uniform(0.0, width), rng.uniform(0.0004, 0.0012)
            low, high = sorted(rng.uniform(0.18 * whole, 0.80 * whole, 2).tolist())
            streak = (np.abs(x - at) < thick) & (y > low) & (y < high)
            canvas.paint(streak * np.clip(0.15 + shadow, 0.0, 0.6), (0.86, 0.50, 0.18))
    canvas.grain(rng, cells=(14, 8), amount=0.04)
    pores = rng.uniform(0.0, 1.0, (150, 3))
    pore = mixed(skin, (0.96, 0.90, 0.66), 0.62) if colour != "yellow" else shaded(skin, 0.72)
    for u, v, size in pores.tolist():
        centre = (u * width, (0.16 + 0.62 * v) * whole)
        canvas.ellipse(centre, (0.00035 + 0.0004 * size, 0.00035 + 0.0004 * size), pore)
    rays = 0.0045 * np.sin(2.0 * math.pi * x / width * 7.0) + 0.002 * np.sin(2.0 * math.pi * x / width * 17.0)
    canvas.paint(np.clip((y + rays - shoulder + 0.002) / 0.010, 0.0, 1.0), cavity, strength=0.85)
    canvas.paint(np.clip((y - length[9]) / 0.012, 0.0, 1.0), (0.30, 0.20, 0.08), strength=0.75)
    canvas.paint(np.clip(1.0 - y / float(length[2]), 0.0, 1.0), (0.25, 0.17, 0.08), strength=0.8)
    canvas.shade(0.84 + 0.16 * np.clip(y / (0.45 * whole), 0.0, 1.0))
    return canvas


@generator("orange", colours=("orange",))
def orange(rng: np.random.Generator, _colour: str) -> Draft:
    """Make an orange with a dimpled peel and the green scar of its stalk.

    A small orange of 70 mm weighs 0.16 to 0.2 kg.
    """
    radius = 0.035 * rng.uniform(0.985, 1.0)
    height = 2.0 * radius * rng.uniform(0.93, 0.985)
    neck = rng.uniform(0.0, 0.0016)  # how far the peel rises around the stalk
    peel = jittered(mixed(PALETTE["orange"], (0.95, 0.52, 0.03), 0.7), rng)
    leafy = rng.random() < 0.3
    angles = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 12)
    profile = [
        (radius * max(math.cos(a), 0.0), 0.5 * height * (1.0 + math.sin(a)) + (neck if k == 10 else 0.0))
        for k, a in enumerate(angles.tolist())
    ]
    profile[-1] = (0.0, profile[-1][1] - 0.0006)
    profile[0] = (0.0, profile[0][1] + 0.0004)
    length = profile_length(profile)
    width, whole = math.pi * radius, float(length[-1])
    canvas = Canvas(width, whole, (192, 192), peel)
    canvas.grain(rng, cells=(6, 6), amount=0.04)
    canvas.grain(rng, cells=(64, 62), amount=0.075)
    canvas.paint(canvas.y > whole - 0.0095, shaded(peel, 0.80), strength=0.45)
    rays = 0.0010 * np.sin(2.0 * math.pi * 5.0 * canvas.x / width)
    canvas.paint(canvas.y > whole - 0.0062 + rays, (0.34, 0.42, 0.12))
    canvas.paint(canvas.y > whole - 0.0028, (0.62, 0.54, 0.30))
    canvas.paint(canvas.y < 0.004, (0.50, 0.30, 0.08), strength=0.7)
    canvas.shade(0.86 + 0.14 * np.clip(canvas.y / (0.4 * whole), 0.0, 1.0))
    parts = [
        part(
            "peel",
            lathe(profile, 20, crease_degrees=80.0, wrap=True, phase=math.pi / 2),
            canvas,
            specular=0.45,
            shininess=0.45,
        )
    ]
    if leafy:
        turn = rng.uniform(-0.9, 0.9)
        leaf = _leaf(0.026, 0.013).rotated("y", 0.05).rotated("z", turn).moved(z=height - 0.0005)
        parts.append(part("leaf", leaf, jittered((0.16, 0.38, 0.10), rng), specular=0.4))
    collision = _round_collision(radius, height, foot_half=0.011)
    return Draft(
        shape="round",
        description="An orange.",
        tags=("orange", "fruit", "citrus", "food"),
        mass_kg=0.18,
        parts=(*parts, *collision),
        grasps=(_across(0.5 * height, radius),),
        regions=(disc("base", 0.4 * radius),),
        parameters={"radius_m": radius, "height_m": height, "leaf": str(leafy)},
    )


@generator("lemon", colours=("yellow",))
def lemon(rng: np.random.Generator, _colour: str) -> Draft:
    """Make a lemon that lies on its side along x, its nipple at +x.

    A lemon is 50 to 60 mm wide, 75 to 90 mm long and weighs about 0.1 kg.
    """
    radius, half = 0.029 * rng.uniform(0.965, 1.0), 0.040 * rng.uniform(0.97, 1.03)
    nipple = rng.uniform(0.0065, 0.0095)
    full = rng.uniform(0.0, 0.06)  # how far the ends are filled out
    peel = jittered((0.95, 0.80, 0.10), rng, amount=0.06)
    profile = [
        (share * radius, z)
        for share, z in (
            (0.0, -half + 0.0012),
            (0.13, -half),
            (0.20, -half + 0.0030),
            (0.43 + full, -0.80 * half),
            (0.76 + 0.5 * full, -0.52 * half),
            (0.96, -0.20 * half),
            (1.0, 0.04 * half),
            (0.93, 0.30 * half),
            (0.70 + 0.5 * full, 0.58 * half),
            (0.37 + full, half - nipple - 0.001),
            (0.24, half - 0.45 * nipple),
            (0.14, half - 0.0008),
            (0.0, half),
        )
    ]
    length = profile_length(profile)
    width, whole = math.pi * radius, float(length[-1])
    canvas = Canvas(width, whole, (128, 192), peel)
    canvas.grain(rng, cells=(5, 7), amount=0.035)
    canvas.grain(rng, cells=(48, 72), amount=0.065)
    green = mixed(peel, (0.50, 0.62, 0.12), 0.6)
    canvas.paint(np.clip((canvas.y - whole + 0.016) / 0.014, 0.0, 1.0), green, strength=0.75)
    canvas.paint(np.clip((0.012 - canvas.y) / 0.010, 0.0, 1.0), green, strength=0.6)
    canvas.paint(canvas.y < 0.0042, (0.40, 0.34, 0.14))
    # Turned so that the seams of the mirrored picture lie at the sides and the axis along +x.
    mesh = lathe(profile, 18, crease_degrees=80.0, wrap=True, phase=math.pi / 2).rotated("y", 0.5 * math.pi)
    mesh = creased(Mesh(mesh.vertices + np.array([0.0, 0.0, radius]), mesh.faces, mesh.uv), 80.0)
    low = float(mesh.vertices[:, 2].min())
    mesh = mesh.moved(z=-low)
    collision = (
        solid_box((-0.013, -0.008, 0.0), (0.013, 0.008, 0.006)),
        CollisionPart("ellipsoid", (0.90 * half, radius, radius - 0.00025), (0.0, 0.0, radius + 0.00025)),
        CollisionPart(
            "capsule", (0.0055, half - 0.0055, 0.0), (0.0, 0.0, radius), (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
        ),
    )
    return Draft(
        shape="round",
        description="A lemon lying on its side.",
        tags=("lemon", "fruit", "citrus", "food"),
        mass_kg=0.10,
        densities=(1.0, 1.0),
        parts=(part("peel", mesh, canvas, specular=0.45, shininess=0.45), *collision),
        grasps=(grip("body", radius, 2.0 * radius, clearance=0.010),),
        regions=(zone("base", 0.013, 0.008),),
        parameters={"radius_m": radius, "length_m": 2.0 * half, "nipple_m": nipple},
    )
