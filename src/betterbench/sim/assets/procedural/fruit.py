"""Generators of fruit: apples, oranges, lemons and mangosteens.

Each has a small flat foot, so that it does not roll.
"""

import math

import numpy as np

from betterbench.sim.assets.asset import CollisionPart
from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, grip, grip_across, part, zone
from betterbench.sim.assets.authoring.mesh import Mesh, creased, merge, prism, sweep, tube_section
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, shaded, uniforms
from betterbench.sim.assets.authoring.solids import foot_square, solid_box, spheroid

# Colors of the skin and of the area around the stalk, which the sun does not reach.
_APPLES: dict[str, tuple[Rgb, Rgb]] = {
    "red": ((0.70, 0.055, 0.06), (0.80, 0.52, 0.16)),
    "green": ((0.42, 0.62, 0.11), (0.52, 0.60, 0.20)),
    "yellow": ((0.92, 0.72, 0.16), (0.66, 0.62, 0.18)),
}
_APPLE_RADIUS = 0.035


def _round_collision(radius: float, height: float) -> tuple[CollisionPart, ...]:
    """Return the collision shape of a round fruit: a spheroid with the size of the fruit, on a flat foot.

    The foot is wide enough that a fruit tilted by 15 degrees rights itself, but too small to be seen.
    """
    half = 0.5 * height - 0.00025
    return (foot_square(0.011, height=0.006), spheroid(radius, half, half + 0.0005))


def _leaf(rng: np.random.Generator, length: float, width: float, lift: float, z: float) -> Mesh:
    """Return a thin pointed leaf that sticks out from the axis at height ``z`` [m]. Its blade is bent up at the tip."""
    turn = rng.uniform(-0.9, 0.9)
    outline = [(0.0, 0.0), (0.30, -0.42), (0.62, -0.40), (1.0, 0.0), (0.62, 0.40), (0.30, 0.42)]
    low = np.array([(length * x, width * y, 0.004 * x * x) for x, y in outline])
    blade = prism([low, low + np.array([0.0, 0.0, 0.0008])], crease_degrees=50.0)
    return blade.rotated("y", lift).rotated("z", turn).moved(z=z)


@generator("apple", colors=("red", "green", "yellow"))
def apple(rng: np.random.Generator, color: str) -> Draft:
    """Make an apple with shoulders, five faint lobes, and a stalk in its dimple.

    A small dessert apple is 65 to 70 mm wide and weighs 0.15 to 0.18 kg. The apples are small because the gripper opens
    to only 80 mm.
    """
    size, height, waist = uniforms(rng, (0.930, 1.0), (0.0580, 0.0670), (0.82, 0.98))
    lobes, stalk, lean = uniforms(rng, (0.010, 0.055), (0.009, 0.016), (-0.006, 0.006))
    leafy, blush, radius = rng.random() < 0.4, rng.uniform(0.15, 0.9), _APPLE_RADIUS * size
    levels = (0.060, 0.020, 0.0, 0.100, 0.300, 0.540, 0.720, 0.885, 0.990, 0.985, 0.880, 0.830)
    shares = (0.0, 0.20, 0.40, 0.72, 0.955, 1.0, 0.965, 0.830, 0.560, 0.330, 0.130, 0.0)
    # Slender apples narrow toward the calyx.
    radii = [s * radius * (waist if level < 0.35 else 1.0) for s, level in zip(shares, levels, strict=True)]
    solid = Turned(radii, [level * height for level in levels], 18, 80.0, phase=math.pi / 2)
    skin = jittered(_APPLES[color][0], rng, amount=0.16)
    body = solid.mesh()
    angle = np.arctan2(body.vertices[:, 1], body.vertices[:, 0])
    low = np.clip(1.0 - 3.0 * body.vertices[:, 2] / height, 0.0, 1.0)
    body = body.scaled_across(1.0 - lobes * low * (1.0 + np.cos(5.0 * angle)))
    picture = _apple_skin(rng, solid, skin, color=color, blush=blush)
    root = 0.83 * height - 0.001
    stem_z = (root, root + 0.5 * stalk, root + stalk)
    stem = sweep((0.0, 0.25 * lean, lean), stem_z, tube_section(0.0017, 5), crease_degrees=80.0)
    parts = [
        part("skin", body, picture, specular=0.55, shininess=0.6),
        part("stalk", stem, jittered((0.33, 0.20, 0.09), rng), specular=0.1),
    ]
    if leafy:
        leaf = _leaf(rng, 0.024, 0.012, -0.20, root + 0.55 * stalk)
        parts.append(part("leaf", leaf, jittered((0.22, 0.45, 0.10), rng), specular=0.3))
    return Draft(
        shape="round",
        description=f"A {color} apple.",
        tags=("apple", "fruit", "food"),
        traits=("food",),
        # Apples float: they have 830 kg/m^3. The shape fills nine tenths of its ellipsoid.
        mass_kg=round(0.9 * 830.0 * 4.0 / 3.0 * math.pi * radius**2 * 0.5 * height, 4),
        material="fruit",
        parts=(*parts, *_round_collision(radius, height)),
        grasps=(grip_across(0.5 * height + 0.0005, radius),),
        regions=(disc("base", 0.4 * radius),),
        parameters={"radius_m": radius, "height_m": height, "leaf": str(leafy)},
    )


def _apple_skin(rng: np.random.Generator, solid: Turned, skin: Rgb, *, color: str, blush: float) -> Canvas:
    """Draw the skin from the calyx to the stalk.

    The skin has streaks, a sunny side, pale pores, and russet at the stalk.
    """
    canvas = solid.canvas(skin, width=math.pi * _APPLE_RADIUS)
    x, y, width, whole = canvas.x, canvas.y, canvas.width, canvas.height
    shoulder, cavity = solid.rows[8], solid.rows[9]
    if color == "red":
        # Draw streaks from pole to pole, in which the paler color below shows through, mostly on the side away from the
        # sun.
        shadow = np.clip(1.3 * np.abs(x[0] / width - 0.62) - 0.12, 0.0, 1.0) * blush
        weight = np.clip(0.15 + shadow, 0.0, 0.6)
        for _ in range(46):
            at, thick = uniforms(rng, (0.0, width), (0.0004, 0.0012))
            low, high = sorted(rng.uniform(0.18 * whole, 0.80 * whole, 2).tolist())
            rows = (y[:, 0] > low) & (y[:, 0] < high)
            canvas.paint_rectangle(rows, np.abs(x[0] - at) < thick, weight, (0.86, 0.50, 0.18))
    else:
        u, v, du, dv = (0.68, 0.60, 0.17, 0.20) if color == "yellow" else (0.35, 0.62, 0.22, 0.22)
        sun = np.exp(-(((x - u * width) / (du * width)) ** 2 + ((y - v * whole) / (dv * whole)) ** 2))
        canvas.paint(sun, (0.86, 0.30, 0.12) if color == "yellow" else (0.70, 0.72, 0.22), strength=0.55 * blush)
    canvas.grain(rng, cells=(14, 8), amount=0.04)
    pore = mixed(skin, (0.96, 0.90, 0.66), 0.62) if color != "yellow" else shaded(skin, 0.72)
    canvas.spots(rng, 150, pore, radius=(0.00035, 0.00075), rows=(0.16 * whole, 0.78 * whole))
    rays = 0.0045 * np.sin(2.0 * math.pi * x / width * 7.0) + 0.002 * np.sin(2.0 * math.pi * x / width * 17.0)
    canvas.paint(np.clip((y + rays - shoulder + 0.002) / 0.010, 0.0, 1.0), _APPLES[color][1], strength=0.85)
    canvas.paint(np.clip((y - cavity) / 0.012, 0.0, 1.0), (0.30, 0.20, 0.08), strength=0.75)
    canvas.paint(np.clip(1.0 - y / solid.rows[2], 0.0, 1.0), (0.25, 0.17, 0.08), strength=0.8)
    canvas.brighten(0.84, 0.45 * whole)
    return canvas


@generator("orange", colors=("orange",))
def orange(rng: np.random.Generator, _color: str) -> Draft:
    """Make an orange with a dimpled peel and a green scar where the stalk was.

    A small orange of 70 mm weighs 0.16 to 0.2 kg.
    """
    radius = 0.035 * rng.uniform(0.93, 1.01)
    height, neck = (
        2.0 * radius * rng.uniform(0.88, 0.985),
        rng.uniform(0.0, 0.0016),
    )  # the neck is the rim around the stalk
    peel = jittered(mixed(PALETTE["orange"], (0.95, 0.52, 0.03), 1.3 * rng.random()), rng)
    leafy = rng.random() < 0.3
    angles = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 12).tolist()
    raised = (0.0004, *(0.0,) * 9, neck, -0.0006)
    z = [0.5 * height * (1.0 + math.sin(a)) + up for a, up in zip(angles, raised, strict=True)]
    radii = [0.0, *(radius * max(math.cos(a), 0.0) for a in angles[1:-1]), 0.0]
    solid = Turned(radii, z, 20, 80.0, phase=math.pi / 2)
    canvas = solid.canvas(peel, (192, 192), width=math.pi * radius)
    whole = canvas.height
    canvas.grain(rng, cells=(6, 6), amount=0.04)
    canvas.grain(rng, cells=(64, 62), amount=0.075)
    canvas.paint(canvas.y > whole - 0.0095, shaded(peel, 0.80), strength=0.45)
    rays = 0.0010 * np.sin(2.0 * math.pi * 5.0 * canvas.x / canvas.width)
    canvas.paint(canvas.y > whole - 0.0062 + rays, (0.34, 0.42, 0.12))
    canvas.paint(canvas.y > whole - 0.0028, (0.62, 0.54, 0.30))
    canvas.paint(canvas.y < 0.004, (0.50, 0.30, 0.08), strength=0.7)
    canvas.brighten(0.86, 0.4 * whole)
    parts = [part("peel", solid.mesh(), canvas, specular=0.45, shininess=0.45)]
    if leafy:
        leaf = _leaf(rng, 0.026, 0.013, 0.05, height - 0.0005)
        parts.append(part("leaf", leaf, jittered((0.16, 0.38, 0.10), rng), specular=0.4))
    return Draft(
        shape="round",
        description="An orange.",
        tags=("orange", "fruit", "citrus", "food"),
        traits=("food",),
        mass_kg=round(960.0 * 4.0 / 3.0 * math.pi * radius**2 * 0.5 * height, 4),
        material="fruit",
        parts=(*parts, *_round_collision(radius, height)),
        grasps=(grip_across(0.5 * height, radius),),
        regions=(disc("base", 0.4 * radius),),
        parameters={"radius_m": radius, "height_m": height, "leaf": str(leafy)},
    )


@generator("lemon", colors=("yellow",))
def lemon(rng: np.random.Generator, _color: str) -> Draft:
    """Make a lemon that lies on its side along x, with its nipple at +x.

    A lemon is 50 to 60 mm wide and 75 to 90 mm long, and weighs about 0.1 kg.
    """
    radius, half = 0.029 * rng.uniform(0.90, 1.02), 0.040 * rng.uniform(0.92, 1.06)
    nipple, full = rng.uniform(0.0065, 0.0095), rng.uniform(0.0, 0.06)  # full: how far the ends are filled out
    peel = jittered(mixed((0.96, 0.76, 0.06), (0.95, 0.84, 0.16), rng.random()), rng, amount=0.06)
    near, far = (0.0, 0.13, 0.20, 0.43 + full, 0.76 + 0.5 * full, 0.96, 1.0, 0.93), (0.70 + 0.5 * full, 0.37 + full)
    middle = [level * half for level in (-0.80, -0.52, -0.20, 0.04, 0.30, 0.58)]
    tip = (half - nipple - 0.001, half - 0.45 * nipple, half - 0.0008, half)
    z = (-half + 0.0012, -half, -half + 0.0030, *middle, *tip)
    solid = Turned([share * radius for share in (*near, *far, 0.24, 0.14, 0.0)], z, 18, 80.0, phase=math.pi / 2)
    canvas = solid.canvas(peel, (128, 192), width=math.pi * radius)
    canvas.grain(rng, cells=(5, 7), amount=0.035)
    canvas.grain(rng, cells=(48, 72), amount=0.065)
    green = mixed(peel, (0.62, 0.64, 0.12), 0.45)
    canvas.paint(np.clip((canvas.y - canvas.height + 0.016) / 0.014, 0.0, 1.0), green, strength=0.75)
    canvas.paint(np.clip((0.012 - canvas.y) / 0.010, 0.0, 1.0), green, strength=0.6)
    canvas.paint(canvas.y < 0.0042, (0.40, 0.34, 0.14))
    # The mesh is turned so that its axis points along +x and the seams of the mirrored texture are at the sides.
    mesh = creased(solid.facing_front(0.0, radius), 80.0)
    lying = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
    return Draft(
        shape="round",
        description="A lemon lying on its side.",
        tags=("lemon", "fruit", "citrus", "food"),
        traits=("food",),
        mass_kg=round(950.0 * 4.0 / 3.0 * math.pi * radius**2 * 0.88 * half, 4),
        material="fruit",
        densities=(1.0, 1.0),
        parts=(
            part("peel", mesh.moved(z=-float(mesh.vertices[:, 2].min())), canvas, specular=0.45, shininess=0.45),
            solid_box((-0.013, -0.008, 0.0), (0.013, 0.008, 0.006)),
            CollisionPart("ellipsoid", (0.90 * half, radius, radius - 0.00025), (0.0, 0.0, radius + 0.00025)),
            CollisionPart("capsule", (0.0055, half - 0.0055, 0.0), (0.0, 0.0, radius), lying),
        ),
        grasps=(grip("body", radius, 2.0 * radius, clearance=0.010),),
        regions=(zone("base", 0.013, 0.008),),
        parameters={"radius_m": radius, "length_m": 2.0 * half, "nipple_m": nipple},
    )


@generator("mangosteen", colors=("purple",))
def mangosteen(rng: np.random.Generator, _color: str) -> Draft:
    """Make a mangosteen: a dark purple rind under four thick green sepals and a short stalk.

    The fruit is 4 to 7 cm wide and weighs 0.05 to 0.15 kg.
    """
    radius, flat = 0.0265 * rng.uniform(0.94, 1.04), rng.uniform(0.84, 0.93)
    height, stalk, turn = 2.0 * radius * flat, rng.uniform(0.004, 0.007), rng.uniform(0.0, 0.5 * math.pi)
    rind = jittered(mixed((0.200, 0.045, 0.095), (0.150, 0.055, 0.120), rng.random()), rng, amount=0.12)
    sepal = jittered(mixed((0.36, 0.46, 0.16), (0.50, 0.48, 0.22), rng.random()), rng)
    angles = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 12).tolist()
    z = [0.5 * height * (1.0 + math.sin(a)) for a in angles]
    solid = Turned([0.0, *(radius * math.cos(a) for a in angles[1:-1]), 0.0], z, 20, 80.0, phase=math.pi / 2)
    canvas = solid.canvas(rind, (192, 192), width=math.pi * radius)
    canvas.grain(rng, cells=(10, 10), amount=0.12)
    canvas.grain(rng, cells=(50, 50), amount=0.05)
    # Dried latex leaves pale specks and scratches.
    rows = (0.10 * canvas.height, 0.80 * canvas.height)
    canvas.spots(rng, 34, (0.46, 0.33, 0.22), radius=(0.0003, 0.0008), rows=rows, stretch=1.8)
    canvas.paint(canvas.y < 0.0045, (0.24, 0.16, 0.10), strength=0.8)
    canvas.brighten(0.80, 0.4 * canvas.height)
    sizes = [rng.uniform(0.90, 1.06) for _ in range(4)]
    lobes = [_sepal(radius, height, size).rotated("z", turn + k * 0.5 * math.pi) for k, size in enumerate(sizes)]
    stem_z = (height - 0.001, height + 0.5 * stalk, height + stalk)
    stem = sweep((0.0, 0.0003, 0.0010), stem_z, tube_section(0.0034, 8), crease_degrees=60.0)
    return Draft(
        shape="round",
        description="A mangosteen.",
        tags=("mangosteen", "fruit", "tropical fruit", "food"),
        traits=("food", "purple"),
        mass_kg=round(1000.0 * 4.0 / 3.0 * math.pi * radius**2 * 0.5 * height, 4),
        material="fruit",
        parts=(
            part("rind", solid.mesh(), canvas, specular=0.35, shininess=0.4),
            part("sepals", merge(lobes), sepal, specular=0.2),
            part("stalk", stem, shaded(sepal, 0.72), specular=0.1),
            *_round_collision(radius, height),
        ),
        grasps=(grip_across(0.48 * height, radius),),
        regions=(disc("base", 0.4 * radius),),
        parameters={"radius_m": radius, "height_m": height},
    )


def _sepal(radius: float, height: float, size: float) -> Mesh:
    """Return one sepal, a thick rounded lobe that follows the top of the fruit along +x and curls up at its edge."""
    across = [0.0, 0.62, 0.92, 0.88, 0.52, 0.0]
    along = [0.02, 0.16, 0.40, 0.66, 0.84, 0.90]
    points = [(x, -y) for x, y in zip(along, across, strict=True)] + [
        (x, y) for x, y in zip(along[-2:0:-1], across[-2:0:-1], strict=True)
    ]
    low = []
    for x, y in points:
        at = np.array([size * 0.80 * radius * x, 0.44 * size * radius * y])
        reach = min(float(np.hypot(*at)) / radius, 0.98)
        surface = 0.5 * height * (1.0 + math.sqrt(1.0 - reach**2))
        low.append((*at, surface - 0.0004 + 0.0030 * max(x - 0.55, 0.0) / 0.35))
    base = np.array(low)
    return prism([base, base + np.array([0.0, 0.0, 0.0019])], crease_degrees=70.0)
