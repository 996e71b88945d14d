"""Generators of the layers of a cheeseburger, and of a kitchen sponge that looks like the cheese.

Each layer has a flat top and a round or square body, and stands on four corners that are a fraction of a millimeter
lower than the body. A stack of layers therefore has few contacts and stays still. The layers are thicker than real
food: the gripper reaches 12 mm below the center of its pads, so it cannot grasp objects lower than 10 mm from a table.
The visual shape may extend beyond the collision shape, because the corners of cheese and the edges of a leaf are soft.
"""

import math

import numpy as np

from betterbench.sim.assets.asset import Grasp
from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, grip, grip_across, part, zone
from betterbench.sim.assets.authoring.mesh import Mesh, creased, loft, merge
from betterbench.sim.assets.authoring.paint import BUN, Canvas, Rgb, jittered, mixed, scattered, shaded, uniforms
from betterbench.sim.assets.authoring.solids import solid_box, spheroid, standing

FILLING_M = 0.014
"""Thickness of patty, cheese and lettuce, from their base to the region "top", in every variant [m].

An object that is placed on any of these fillings is therefore released at the same height."""

BOTTOM_M = 0.026
"""Height of the cut face of the bun's lower half in every variant [m]."""

_CRUMB: Rgb = (0.98, 0.93, 0.79)
_GRIP = 0.0125
"""Height of the center of the finger pads when they grasp a filling [m]. The pads then end half a millimeter above the
table."""


def _square_grasps(length: float, width: float) -> tuple[Grasp, ...]:
    """Return one grasp across each pair of sides. The grasp across the narrower side comes first."""
    return (
        grip("body", _GRIP, width, clearance=0.007),
        grip("long", _GRIP, length, across="x", clearance=0.006, preference=1),
    )


def _outline(half_x: float, half_y: float, n: int, *, roundness: float) -> np.ndarray:
    """Return (n, 2) points [m] on a rounded rectangle around the origin, at equally spaced angles.

    A ``roundness`` of 2 gives an ellipse. Larger values give a more rectangular shape.
    """
    angle = 2.0 * math.pi * np.arange(n) / n
    c, s = np.cos(angle), np.sin(angle)
    reach = (np.abs(c / half_x) ** roundness + np.abs(s / half_y) ** roundness) ** (-1.0 / roundness)
    return np.column_stack([reach * c, reach * s])


def _slab(outline: np.ndarray, low: float, high: float, *, bevel: float, crease: float = 50.0) -> Mesh:
    """Return a slab with beveled edges.

    Each ray from the origin must cross the outline [m] exactly once. The texture is projected from above.
    """
    reach = np.linalg.norm(outline, axis=1, keepdims=True)
    rings = []
    for z, inset in ((low, bevel), (low + bevel, 0.0), (high - bevel, 0.0), (high, bevel)):
        rings.append(np.column_stack([outline * (1.0 - inset / reach), np.full(len(outline), z)]))
    return creased(loft(rings), crease)


@generator("bun_bottom", colors=("brown",))
def bun_bottom(rng: np.random.Generator, _color: str) -> Draft:
    """Make the lower half of a bun with its white cut face up. It looks like a thick, bulging roll that was cut in two.

    Half a bun with a diameter of 80 mm weighs 30 to 40 g. Here it weighs 60 to 70 g, so that it stays still while a
    burger is built on it.
    """
    radius, belly, bulge = uniforms(rng, (0.0375, 0.0405), (0.40, 0.58), (0.050, 0.100))
    toast, sole = str(rng.choice(["plain", "golden", "rim"])), rng.uniform(0.58, 0.70)
    crust = shaded(jittered((0.72, 0.38, 0.10), rng, amount=0.16), 0.95)
    face, height = radius * (1.0 - bulge), BOTTOM_M
    radii = (0.0, sole * radius, 0.88 * radius, radius, 0.5 * (radius + face) + 0.0008, face, face - 0.0015, 0.0)
    z = (0.0, 0.0, 0.20 * height, belly * height, 0.84 * height, height - 0.0012, height, height)
    bun = Turned(radii, z, 26, crease_degrees=55.0, wrap=False)
    mesh = bun.mesh().seen_from_above(radius)
    # The side shows the outer ring of the texture. Its upper edge shows the part of the ring next to the cut face.
    level = mesh.vertices[:, 2:] / height
    turned = mesh.uv - 0.5
    outward = turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-9)
    uv = np.where(level < 0.96, 0.5 + (0.49 - 0.06 * level) * outward, 0.5 + turned * 0.84 * radius / face)
    mesh = Mesh(mesh.vertices, mesh.faces, uv)
    canvas = Canvas(2.0, 2.0, (128, 128), crust)
    r, crumb = canvas.radius, jittered(_CRUMB, rng, amount=0.06)
    canvas.paint(np.clip((0.93 - r) / 0.06, 0.0, 1.0), mixed(crust, (0.93, 0.68, 0.32), 0.30))
    canvas.paint(r < 0.84, crumb)
    brown: Rgb = (0.78, 0.52, 0.22)
    if toast == "golden":
        canvas.paint(np.clip((0.80 - r) / 0.12, 0.0, 1.0), brown, strength=0.15)
    elif toast == "rim":
        canvas.paint(np.clip((r - 0.50) / 0.34, 0.0, 1.0) * (r < 0.84), shaded(brown, 0.9), strength=0.60)
    # Fluffy crumb looks softly clouded. Sharp holes would make it look like a biscuit.
    canvas.grain(rng, cells=(7, 7), amount=0.045)
    canvas.grain(rng, cells=(20, 20), amount=0.025)
    canvas.paint((r > 0.80) & (r < 0.86), mixed(crust, brown, 0.5))
    return Draft(
        shape="round",
        description="The lower half of a burger bun, cut face up.",
        tags=("bun", "bottom bun", "burger bun", "bread", "food"),
        traits=("food",),
        mass_kg=round(42.0 * radius**2, 4),
        material="bread",
        parts=(part("bun", mesh, canvas, specular=0.10), *standing(0.60 * radius, (face, height))),
        regions=(disc("base", radius), disc("top", face, height)),
        parameters={"radius_m": radius, "height_m": height, "toast": toast},
    )


@generator("patty", colors=("brown",))
def patty(rng: np.random.Generator, _color: str) -> Draft:
    """Make a grilled patty of minced beef, which is dark and rough and has an uneven edge.

    A grilled patty of 70 mm by 14 mm has a volume of 54 cm^3 and weighs 60 g.
    """
    radius, ragged, shoulder = uniforms(rng, (0.0333, 0.0357), (0.02, 0.06), (0.86, 0.96))
    meat = jittered(mixed((0.40, 0.19, 0.10), (0.29, 0.14, 0.08), rng.random()), rng, amount=0.15)
    marks, height = str(rng.choice(["stripes", "cross", "seared", "charred"])), FILLING_M
    radii = (0.0, 0.92 * radius, radius, 0.99 * radius, shoulder * radius, 0.0)
    disc_ = Turned(radii, (0.0, 0.0, 0.30 * height, 0.68 * height, height, height), 26, 60.0, wrap=False)
    mesh = disc_.mesh()
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    swell = sum(np.sin(k * angle + rng.uniform(0.0, 2.0 * math.pi)) for k in (3, 5, 8))
    mesh = mesh.scaled_across(1.0 - 0.5 * ragged * (1.0 + swell / 3.0)).seen_from_above(1.02 * radius)
    canvas = Canvas(2.0, 2.0, (128, 128), meat)
    canvas.grain(rng, cells=(26, 26), amount=0.22)
    canvas.grain(rng, cells=(50, 50), amount=0.14)
    for u, v, size in rng.uniform(0.0, 1.0, (70, 3)).tolist():
        tone = shaded(meat, 0.5) if size < 0.5 else mixed(meat, (0.74, 0.46, 0.26), 0.7)
        canvas.ellipse((2.0 * u, 2.0 * v), (0.016 + 0.04 * size, 0.014 + 0.03 * size), tone, 6.0 * u)
    turn, pitch = rng.uniform(-0.8, 0.8), rng.uniform(0.30, 0.44)
    for k in range({"stripes": 1, "cross": 2}.get(marks, 0)):
        at = turn + 0.5 * math.pi * k
        across = (canvas.x - 1.0) * math.sin(at) + (canvas.y - 1.0) * math.cos(at)
        stripe = (canvas.radius < 0.86) & (np.abs((across + 0.5 * pitch) % pitch - 0.5 * pitch) < 0.055)
        canvas.paint(stripe, (0.06, 0.03, 0.02), strength=0.9)
    if marks == "charred":
        canvas.paint(np.clip((canvas.radius - 0.45) / 0.5, 0.0, 1.0), (0.07, 0.04, 0.03), strength=0.8)
    return Draft(
        shape="round",
        description="A grilled burger patty.",
        tags=("patty", "burger patty", "meat", "beef", "food"),
        traits=(
            "beef",
            "food",
        ),
        mass_kg=round(1060.0 * math.pi * radius**2 * height, 4),
        material="meat",
        parts=(part("patty", mesh, canvas, specular=0.35), *standing(0.62 * radius, (0.985 * radius, height))),
        grasps=(grip_across(_GRIP, 0.985 * radius, clearance=0.0038),),
        regions=(disc("base", radius), disc("top", 0.9 * radius, height)),
        parameters={"radius_m": radius, "height_m": height, "marks": marks},
    )


@generator("cheese_slice", colors=("yellow",))
def cheese_slice(rng: np.random.Generator, _color: str) -> Draft:
    """Make a thick slice of smooth, glossy cheese with a few large round holes. Some holes are at its edge.

    A solid piece of cheese of 64 x 62 x 14 mm weighs 60 g (1080 kg/m^3). Holes make up a fifth of this slice.
    """
    length, width, roundness = uniforms(rng, (0.0640, 0.0680), (0.0620, 0.0655), (7.0, 16.0))
    shade = jittered(mixed((0.99, 0.66, 0.05), (1.00, 0.80, 0.22), rng.random()), rng, amount=0.03)
    bites, holes, height = int(rng.integers(2, 5)), int(rng.integers(3, 6)), FILLING_M
    outline = _outline(0.5 * length, 0.5 * width, 52, roundness=roundness)
    angle = np.arctan2(outline[:, 1], outline[:, 0])
    start = rng.uniform(0.0, 2.0 * math.pi)
    for k in range(bites):
        at, size = start + 2.0 * math.pi * (k + rng.uniform(-0.2, 0.2)) / bites, rng.uniform(0.16, 0.24)
        off = np.abs((angle - at + math.pi) % (2.0 * math.pi) - math.pi) / size
        outline = outline * (1.0 - 0.26 * size / 0.2 * np.sqrt(np.clip(1.0 - off * off, 0.0, 1.0)))[:, None]
    mesh = _slab(outline, 0.0, height, bevel=0.0012).seen_from_above(0.52 * length)
    canvas = Canvas(2.0, 2.0, (128, 128), shade)
    canvas.grain(rng, cells=(4, 4), amount=0.015)
    canvas.paint(np.clip((canvas.radius - 0.9) / 0.3, 0.0, 1.0), shaded(shade, 1.25), strength=0.5)
    for x, y in scattered(rng, tries=80, gap=0.56, reach=0.62, count=holes):
        size = rng.uniform(0.13, 0.22)
        canvas.ellipse((x, y), (size, 0.94 * size), mixed(shaded(shade, 0.52), (0.55, 0.22, 0.0), 0.35))
        canvas.ellipse((x + 0.25 * size, y), (0.62 * size, 0.66 * size), shaded(shade, 0.74))
    half_x, half_y = 0.5 * length, 0.5 * width
    return Draft(
        shape="box",
        description="A thick square slice of yellow cheese with large holes.",
        tags=("cheese", "cheese slice", "slice", "food"),
        traits=("food",),
        mass_kg=round(0.8 * 1080.0 * length * width * height, 4),
        material="cheese",
        parts=(
            part("cheese", mesh, canvas, specular=0.55, shininess=0.6),
            solid_box((-half_x, -half_y, 0.0), (half_x, half_y, height)),
        ),
        grasps=_square_grasps(length, width),
        regions=(zone("base", half_x, half_y), zone("top", half_x, half_y, height)),
        parameters={"length_m": length, "width_m": width, "height_m": height, "holes": float(holes + bites)},
    )


@generator("sponge", colors=("yellow",))
def sponge(rng: np.random.Generator, _color: str) -> Draft:
    """Make a kitchen sponge of yellow foam with pores and a waist, on a thick, dark green scouring pad.

    The sponge is as wide and as yellow as the slice of cheese, and nearly twice as high. Foam sponges of 65 x 60 mm are
    22 to 30 mm high. They weigh 5 g when dry and 20 to 30 g when damp.
    """
    length, width, height = uniforms(rng, (0.0640, 0.0690), (0.0600, 0.0650), (0.0230, 0.0270))
    scour, waist, roundness = height * rng.uniform(0.34, 0.44), rng.uniform(0.0, 0.12), rng.uniform(6.0, 14.0)
    shade = jittered(mixed((0.98, 0.74, 0.12), (0.96, 0.86, 0.32), rng.random()), rng, amount=0.03)
    pad, pores = jittered((0.05, 0.30, 0.13), rng, amount=0.15), int(rng.integers(60, 130))
    outline = _outline(0.5 * length, 0.5 * width, 36, roundness=roundness)
    outline[:, 1] *= 1.0 - waist * np.clip(1.0 - (outline[:, 0] / (0.36 * length)) ** 2, 0.0, 1.0)
    upper = _slab(outline, scour, height, bevel=0.0015).seen_from_above(0.70 * length)
    # The sides show the strip of the texture that is just outside the top face.
    down = np.clip((height - 0.0016 - upper.vertices[:, 2]) / 0.70 / length, 0.0, 1.0)[:, None]
    away = upper.uv - 0.5
    stretch = 1.0 + down / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-6)
    upper = Mesh(upper.vertices, upper.faces, 0.5 + away * stretch)
    lower = _slab(outline * 0.995, 0.0, scour, bevel=0.0006)
    canvas = Canvas(2.0, 2.0, (128, 128), shade)
    canvas.grain(rng, cells=(30, 30), amount=0.05)
    for u, v, size, turn in rng.uniform(0.0, 1.0, (pores, 4)).tolist():
        big = 0.022 + 0.060 * size**2
        canvas.ellipse((2.0 * u, 2.0 * v), (big, 0.75 * big), shaded(shade, 0.48 + 0.15 * turn), 3.0 * turn)
    half_x, half_y = 0.5 * length, 0.5 * width * (1.0 - waist)
    return Draft(
        shape="box",
        description="A yellow kitchen sponge with a green scouring side.",
        tags=("sponge", "kitchen sponge", "scourer", "cleaning"),
        traits=("cleaning",),
        mass_kg=round(240.0 * length * width * height, 4),
        material="sponge",
        parts=(
            part("sponge", upper, canvas, specular=0.02),
            part("scourer", lower, pad, specular=0.02),
            solid_box((-half_x, -half_y, 0.0), (half_x, half_y, height)),
        ),
        grasps=_square_grasps(2.0 * half_x, 2.0 * half_y),
        regions=(zone("base", half_x, half_y), zone("top", half_x, half_y, height)),
        parameters={"length_m": length, "width_m": width, "height_m": height, "scourer_m": scour},
    )


@generator("lettuce_leaf", colors=("green",))
def lettuce_leaf(rng: np.random.Generator, _color: str) -> Draft:
    """Make two stacked leaves of lettuce, which are longer than wide and have a pale midrib and a wavy edge.

    Lettuce on a burger is 80 to 100 mm long and weighs 10 to 20 g. The collision shape of both leaves together is a
    flat box as thick as the other fillings. The soft edges extend beyond the box and are only visual.
    """
    half_x, half_y, wave = uniforms(rng, (0.043, 0.050), (0.033, 0.037), (0.0035, 0.0055))
    ruffles, pointed, height = int(rng.integers(6, 10)), rng.uniform(0.0, 0.16), FILLING_M
    shade = jittered(mixed((0.30, 0.58, 0.10), (0.44, 0.70, 0.16), rng.random()), rng, amount=0.10)
    under = _leaf(rng, (half_x, half_y), 0.002, 0.55 * height, wave, n=20, ruffles=ruffles, pointed=pointed)
    turned = under.rotated("z", rng.uniform(0.25, 0.5))
    over = _leaf(rng, (0.93 * half_x, 0.95 * half_y), 0.006, height, wave, n=36, ruffles=ruffles, pointed=pointed)
    mesh = merge([turned, over])
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    mesh = mesh.moved(-0.5 * float(low[0] + high[0]), -0.5 * float(low[1] + high[1]), -float(low[2]))
    mesh = mesh.seen_from_above(1.10 * half_x)
    touch_x, touch_y = 0.031, 0.0285
    veins = _veins(rng, shade, half_y / half_x, tip=shaded(shade, rng.uniform(0.5, 0.75)))
    return Draft(
        shape="irregular",
        description="A ruffled leaf of green lettuce.",
        tags=("lettuce", "lettuce leaf", "salad", "leaf", "food"),
        traits=(
            "salad",
            "food",
        ),
        mass_kg=round(9.0 * half_x * half_y, 4),
        material="leaf",
        parts=(
            part("leaf", mesh, veins, specular=0.3, shininess=0.4),
            solid_box((-touch_x, -touch_y, 0.0), (touch_x, touch_y, height)),
        ),
        grasps=_square_grasps(2.0 * touch_x, 2.0 * touch_y),
        regions=(zone("base", touch_x, touch_y), zone("top", touch_x, touch_y, height)),
        parameters={"length_m": 2.0 * half_x, "width_m": 2.0 * half_y, "height_m": height, "ruffles": float(ruffles)},
    )


def _leaf(
    rng: np.random.Generator,
    half: tuple[float, float],
    low: float,
    high: float,
    wave: float,
    *,
    n: int,
    ruffles: int,
    pointed: float,
) -> Mesh:
    """Return one leaf along x.

    ``half`` gives half its length and half its width. Its blade is between the two heights [m].

    The edge of the leaf swings by ``wave`` [m] about its middle height. ``pointed`` makes the leaf narrower toward -x.
    """
    outline = _outline(*half, n, roundness=2.2)
    angle = 2.0 * math.pi * np.arange(n) / n
    outline[:, 1] *= 1.0 - pointed * (1.0 - outline[:, 0] / half[0])
    phase = rng.uniform(0.0, 2.0 * math.pi)
    swing = np.sin(ruffles * angle + phase) + 0.45 * np.sin((2 * ruffles + 3) * angle + 2.0 * phase)
    edge = outline * (1.0 + 0.055 * np.cos(ruffles * angle + phase) + 0.05 * rng.uniform(-1.0, 1.0, n))[:, None]
    middle = 0.55 * low + 0.45 * high + wave * swing
    levels = (
        (0.45 * outline, np.full(n, low)),
        (edge, middle - 0.0009),
        (edge, middle + 0.0009),
        (0.72 * outline, high - 0.0018 + 0.25 * wave * swing),
        (0.10 * outline, np.full(n, high - 0.0010)),
    )
    rings = [np.column_stack([plan, np.maximum(z, 0.0)]) for plan, z in levels]
    return creased(loft(rings), 60.0)


def _veins(rng: np.random.Generator, shade: Rgb, slender: float, *, tip: Rgb) -> Canvas:
    """Draw a leaf from above, with a broad pale midrib along x, bent side veins, and an edge in the color ``tip``."""
    canvas = Canvas(2.0, 2.0, (128, 128), shade)
    across, along = canvas.y - 1.0, canvas.x - 1.0
    reach = np.hypot(along / 0.90, across / 0.90 / slender)
    canvas.grain(rng, cells=(14, 14), amount=0.10)
    canvas.paint(np.clip((reach - 0.66) / 0.34, 0.0, 1.0), tip, strength=0.70)
    canvas.paint(np.clip((-along - 0.1) / 0.9, 0.0, 1.0), (0.86, 0.92, 0.62), strength=0.7)
    pale: Rgb = (0.88, 0.94, 0.70)
    for k in range(5):
        x = 0.35 + 0.27 * k + rng.uniform(-0.04, 0.04)
        for side in (1.0, -1.0):
            out = slender * rng.uniform(0.62, 0.80)
            points = [(x, 1.0), (x + 0.16, 1.0 + 0.45 * side * out), (x + 0.36, 1.0 + side * out)]
            canvas.line(points, 0.035, pale, 0.7)
    canvas.paint(np.abs(across) < 0.085 * np.clip(1.0 - 0.55 * (along + 1.0) / 2.0, 0.2, 1.0), pale)
    return canvas


@generator("bun_top", colors=("brown",))
def bun_top(rng: np.random.Generator, _color: str) -> Draft:
    """Make the domed upper half of a bun with sesame seeds.

    Half a bun of 72 mm weighs 25 to 30 g. Here it weighs 45 to 55 g, so that it stays where it is put.
    """
    radius, height, full = uniforms(rng, (0.0345, 0.0368), (0.0320, 0.0385), (0.0, 0.06))
    crust, seeds = jittered(BUN, rng, amount=0.20), int(rng.integers(14, 42))
    shoulder = height * rng.uniform(0.505, 0.545)  # the ellipsoid of the dome must not reach below the bun
    rise = height - shoulder
    dome = (0.97 * radius, (0.82 + full) * radius, (0.60 + full) * radius, (0.31 + full) * radius, 0.0)
    z = (shoulder, shoulder + 0.46 * rise, shoulder + 0.77 * rise, shoulder + 0.95 * rise, height)
    radii = (0.0, 0.955 * radius, radius, radius, *dome)
    bun = Turned(radii, (0.0, 0.0, 0.0045, 0.60 * shoulder, *z), 24, 50.0, wrap=False)
    mesh = bun.mesh().domed(radius, height, height)
    return Draft(
        shape="round",
        description="The domed upper half of a burger bun with sesame.",
        tags=("bun", "top bun", "burger bun", "bread", "food"),
        traits=("food",),
        mass_kg=round(1.4 * radius, 4),
        material="bread",
        parts=(
            part("bun", mesh, _sesame(rng, crust, seeds=seeds), specular=0.25, shininess=0.35),
            *standing(0.66 * radius, (radius, shoulder)),
            spheroid(0.985 * radius, rise, shoulder),
        ),
        grasps=(grip_across(0.014, radius),),
        regions=(disc("base", radius), disc("top", 0.5 * radius, height)),
        parameters={"radius_m": radius, "height_m": height, "seeds": float(seeds)},
    )


def _sesame(rng: np.random.Generator, crust: Rgb, *, seeds: int) -> Canvas:
    """Draw the crust of a bun with sesame seeds, seen from above. It is brown at the top and pale at the edge."""
    canvas = Canvas(2.0, 2.0, (160, 160), crust)
    r = canvas.radius
    canvas.paint(np.clip((r - 0.72) / 0.28, 0.0, 1.0), mixed(crust, _CRUMB, 0.6))
    canvas.paint(np.clip(1.0 - r / 0.62, 0.0, 1.0), shaded(crust, 0.66), strength=0.45)
    canvas.grain(rng, cells=(13, 13), amount=0.035)
    size = rng.uniform(0.058, 0.078)
    for x, y in scattered(rng, tries=30 * seeds, gap=0.165, reach=0.72, count=seeds):
        turn = rng.uniform(0.0, math.pi)
        canvas.ellipse((x + 0.010, y - 0.014), (1.07 * size, 0.69 * size), shaded(crust, 0.60), turn)
        canvas.ellipse((x, y), (size, 0.62 * size), (0.98, 0.93, 0.78), turn)
    return canvas
