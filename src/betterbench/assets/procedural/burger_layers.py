"""The layers of a cheeseburger one by one, and the kitchen sponge that looks like its cheese.

Every layer stands on four fixed corners a fraction of a millimeter below its round or square body and ends in a flat
top, so that a stack has few contacts and keeps still. Layers are thicker than food would be: a jaw reaches 12 mm below
its center and cannot take anything lower than 10 mm from a table.
"""

import math

import numpy as np

from betterbench.assets.asset import Grasp
from betterbench.assets.authoring import Draft, Turned, disc, generator, grip, grip_across, part, zone
from betterbench.assets.authoring.mesh import Mesh, creased, loft, merge, prism, rectangle
from betterbench.assets.authoring.paint import BUN, Canvas, Rgb, jittered, mixed, scattered, shaded
from betterbench.assets.authoring.solids import solid_box, spheroid, standing

_CRUMB: Rgb = (0.95, 0.82, 0.56)
# Height of the jaw's center for slices [m].
_SLICE_GRIP = 0.010


def _square_grasps(side: float) -> tuple[Grasp, ...]:
    """Return the grasps across both pairs of sides."""
    return (
        grip("body", _SLICE_GRIP, side, clearance=0.007),
        grip("long", _SLICE_GRIP, side, across="x", clearance=0.007, preference=1),
    )


def _slab(side: float, low: float, high: float, *, corner: float, bevel: float, crease: float) -> Mesh:
    """Return a square slab with rounded corners and bevelled edges."""
    steps, half = ((low, bevel), (low + bevel, 0.0), (high - bevel, 0.0), (high, bevel)), 0.5 * side
    rings = [rectangle(half - e, half - e, z, corner=corner - e, steps=4) for z, e in steps]
    return prism(rings, crease_degrees=crease)


@generator("bun_bottom", colors=("brown",))
def bun_bottom(rng: np.random.Generator, _color: str) -> Draft:
    """Make the lower half of a bun, its cut face up.

    Half a bun of 80 mm weighs 30 g; 60 g let it stand still while a burger is built on it.
    """
    radius, height = 0.040 * rng.uniform(0.985, 1.0), 0.020
    belly, toast = rng.uniform(0.35, 0.55), rng.uniform(0.0, 0.8)
    crust = jittered(mixed(BUN, _CRUMB, 0.08), rng, amount=0.12)
    radii = (0.0, 0.86 * radius, 0.97 * radius, radius, 0.985 * radius, 0.97 * radius, 0.0)
    z = (0.0, 0.0, 0.22 * height, belly * height, height - 0.0015, height, height)
    bun = Turned(radii, z, crease_degrees=55.0, wrap=False)
    mesh = bun.mesh().seen_from_above(radius)
    # The side is seen under the crust at the picture's edge, the cut face in its middle.
    side = (mesh.vertices[:, 2] < height - 0.001)[:, None]
    mesh = Mesh(mesh.vertices, mesh.faces, np.where(side, 0.5 + 0.985 * (mesh.uv - 0.5), 0.92 * mesh.uv + 0.04))
    canvas = Canvas(2.0, 2.0, (160, 160), crust)
    r, crumb = canvas.radius, jittered(_CRUMB, rng, amount=0.05)
    canvas.paint(r < 0.885, crumb)
    canvas.paint(np.exp(-(((r - 0.70) / 0.16) ** 2)) * (r < 0.885), (0.80, 0.55, 0.24), strength=0.55 * toast)
    canvas.grain(rng, cells=(26, 26), amount=0.030)
    for u, v, size in rng.uniform(0.0, 1.0, (110, 3)).tolist():
        distance, angle = 0.85 * math.sqrt(u), 2.0 * math.pi * v
        center = (1.0 + distance * math.cos(angle), 1.0 + distance * math.sin(angle))
        pore = (0.010 + 0.022 * size * size, 0.010 + 0.014 * size * size)
        canvas.ellipse(center, pore, shaded(crumb, 0.80), 3.0 * v)
    return Draft(
        shape="round",
        description="The lower half of a burger bun, cut face up.",
        tags=("bun", "bottom bun", "burger bun", "bread", "food"),
        mass_kg=0.06,
        parts=(part("bun", mesh, canvas, specular=0.12), *bun.filled(0.66 * radius)),
        regions=(disc("base", radius), disc("top", 0.97 * radius, height)),
        parameters={"radius_m": radius, "height_m": height, "toast": toast},
    )


@generator("patty", colors=("brown",))
def patty(rng: np.random.Generator, _color: str) -> Draft:
    """Make a grilled patty of minced beef.

    A patty of 70 mm by 20 mm holds 75 cm^3 and weighs about 0.1 kg raw or 0.08 kg grilled.
    """
    radius, height = 0.034 * rng.uniform(0.985, 1.0), 0.020
    meat = jittered((0.30, 0.15, 0.08), rng, amount=0.12)
    marks = str(rng.choice(["stripes", "cross", "none"]))
    radii = (0.0, 0.90 * radius, radius, 0.995 * radius, 0.91 * radius, 0.0)
    disc_ = Turned(radii, (0.0, 0.0, 0.30 * height, 0.72 * height, height, height), crease_degrees=60.0, wrap=False)
    mesh = disc_.mesh()
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    swell = sum(np.sin(k * angle + rng.uniform(0.0, 2.0 * math.pi)) for k in (4, 7, 9))
    mesh = mesh.scaled_across(1.0 - 0.010 * (1.0 + swell / 3.0))
    # Unrolled a little at the edge, so that the meat's grain does not run down the side in streaks.
    below = (height - mesh.vertices[:, 2]) / height
    share = 0.40 * np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1]) / radius + 0.09 * below
    mesh = Mesh(mesh.vertices, mesh.faces, 0.5 + share[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    canvas = Canvas(2.0, 2.0, (160, 160), meat)
    canvas.grain(rng, cells=(30, 30), amount=0.20)
    canvas.grain(rng, cells=(60, 60), amount=0.14)
    for u, v, size in rng.uniform(0.0, 1.0, (90, 3)).tolist():
        tone = shaded(meat, 0.55) if size < 0.55 else mixed(meat, (0.62, 0.36, 0.20), 0.6)
        canvas.ellipse((2.0 * u, 2.0 * v), (0.012 + 0.03 * size, 0.012 + 0.02 * size), tone, 6.0 * u)
    turn = rng.uniform(-0.5, 0.5)
    for k in range({"stripes": 1, "cross": 2, "none": 0}[marks]):
        at = turn + 0.5 * math.pi * k
        across = (canvas.x - 1.0) * math.sin(at) + (canvas.y - 1.0) * math.cos(at)
        stripe = (canvas.radius < 0.76) & (np.abs((across + 0.13) % 0.30 - 0.13) < 0.045)
        canvas.paint(stripe, (0.07, 0.035, 0.02), strength=0.85)
    return Draft(
        shape="round",
        description="A grilled burger patty.",
        tags=("patty", "burger patty", "meat", "beef", "food"),
        mass_kg=0.10,
        parts=(part("patty", mesh, canvas, specular=0.35), *disc_.filled(0.66 * radius)),
        grasps=(grip_across(0.011, radius),),
        regions=(disc("base", radius), disc("top", 0.9 * radius, height)),
        parameters={"radius_m": radius, "height_m": height, "marks": marks},
    )


@generator("cheese_slice", colors=("yellow",))
def cheese_slice(rng: np.random.Generator, _color: str) -> Draft:
    """Make a thick square slice of cheese with rounded corners.

    Cheese of 62 by 62 by 12 mm weighs 45 g when solid; 30 g are used for one with holes.
    """
    side, height, corner = 0.062 * rng.uniform(0.985, 1.0), 0.012, rng.uniform(0.0060, 0.0100)
    half, holes = 0.5 * side, int(rng.choice([0, 3, 5, 7]))
    shade = jittered(mixed((0.98, 0.66, 0.06), (0.96, 0.78, 0.20), rng.random()), rng, amount=0.04)
    mesh = _slab(side, 0.0, height, corner=corner, bevel=0.0014, crease=55.0)
    mesh = Mesh(mesh.vertices, mesh.faces, 0.5 + 0.96 * mesh.vertices[:, :2] / side)
    canvas = Canvas(2.0, 2.0, (128, 128), shade)
    canvas.grain(rng, cells=(5, 5), amount=0.018)
    reach = np.maximum(np.abs(canvas.x - 1.0), np.abs(canvas.y - 1.0))
    canvas.paint(np.exp(-(((reach - 0.90) / 0.05) ** 2)), shaded(shade, 1.5), strength=0.5)
    placed: list[tuple[float, float]] = []
    for _ in range(200):
        if len(placed) == holes:
            break
        x, y = (float(e) for e in rng.uniform(0.38, 1.62, 2))
        if all(math.hypot(x - px, y - py) > 0.42 for px, py in placed):
            placed.append((x, y))
            size = rng.uniform(0.07, 0.15)
            canvas.ellipse((x, y), (size, 0.9 * size), shaded(shade, 0.62))
            canvas.ellipse((x, y - 0.18 * size), (0.82 * size, 0.70 * size), shaded(shade, 0.80))
    return Draft(
        shape="box",
        description="A thick square slice of yellow cheese.",
        tags=("cheese", "cheese slice", "slice", "food"),
        mass_kg=0.03,
        parts=(
            part("cheese", mesh, canvas, specular=0.45, shininess=0.5),
            solid_box((-half, -half, 0.0), (half, half, height)),
        ),
        grasps=_square_grasps(side),
        regions=(zone("base", half, half), zone("top", half, half, height)),
        parameters={"side_m": side, "height_m": height, "holes": float(holes)},
    )


@generator("sponge", colors=("yellow",))
def sponge(rng: np.random.Generator, _color: str) -> Draft:
    """Make a kitchen sponge with a green scouring underside, as wide and as yellow as the cheese slice.

    A cut cellulose sponge of this size weighs 5 g dry; damp as it lies beside a sink it weighs 20 g.
    """
    side, scour, corner = 0.064 * rng.uniform(0.98, 1.0), rng.uniform(0.0040, 0.0048), rng.uniform(0.0030, 0.0060)
    half, height = 0.5 * side, 0.0135  # the height of the cheese slice and an eighth
    shade = jittered(mixed((0.98, 0.72, 0.10), (0.95, 0.82, 0.28), rng.random()), rng, amount=0.04)
    pad = jittered((0.07, 0.34, 0.16), rng, amount=0.12)
    upper = _slab(side, scour, height, corner=corner, bevel=0.0008, crease=50.0)
    # The sides show a strip of the picture of their own height, next to the edge of the top.
    down = ((height - upper.vertices[:, 2]) / side)[:, None]
    toward = upper.vertices[:, :2] / half
    uv = 0.5 + 0.5 * toward * 0.80 + 0.5 * np.sign(toward) * (np.abs(toward) > 0.8) * 1.2 * down
    upper = Mesh(upper.vertices, upper.faces, np.clip(uv, 0.0, 1.0))
    lower = _slab(side, 0.0, scour, corner=corner, bevel=0.0006, crease=50.0)
    canvas = Canvas(2.0, 2.0, (192, 192), shade)
    canvas.grain(rng, cells=(40, 40), amount=0.05)
    for u, v, size, turn in rng.uniform(0.0, 1.0, (300, 4)).tolist():
        big = 0.012 + 0.045 * size**4
        canvas.ellipse((2.0 * u, 2.0 * v), (big, 0.75 * big), shaded(shade, 0.50 + 0.2 * turn), 3.0 * turn)
    return Draft(
        shape="box",
        description="A yellow kitchen sponge with a green scouring side.",
        tags=("sponge", "kitchen sponge", "scourer", "cleaning"),
        mass_kg=0.02,
        parts=(
            part("sponge", upper, canvas, specular=0.02),
            part("scourer", lower, pad, specular=0.02),
            solid_box((-half, -half, 0.0), (half, half, height)),
        ),
        grasps=_square_grasps(side),
        regions=(zone("base", half, half), zone("top", half, half, height)),
        parameters={"side_m": side, "height_m": height, "scourer_m": scour},
    )


@generator("lettuce_leaf", colors=("green",))
def lettuce_leaf(rng: np.random.Generator, _color: str) -> Draft:
    """Make a round frilly stack of lettuce leaves.

    A few leaves of 65 mm weigh 10 to 20 g. They touch as a flat disc of their own thickness.
    """
    radius, height = 0.034 * rng.uniform(0.985, 1.0), 0.0125
    solid, frills, frill = radius - 0.0015, int(rng.choice([9, 11, 13])), rng.uniform(0.0022, 0.0032)
    shade = jittered((0.36, 0.64, 0.14), rng, amount=0.14)
    angle = 2.0 * math.pi * np.arange(36) / 36
    wobble = rng.uniform(-0.5, 0.5, 3)
    leaves = []
    # Two leaves, the upper one turned by half a frill.
    for low, high, phase, size in ((0.0, 0.0085, 0.0, 1.0), (0.0048, height, math.pi, 0.965)):
        wave = np.cos(frills * angle + phase + float(wobble[0]))
        small = np.cos((2 * frills + 3) * angle + 6.0 * float(wobble[1]))
        edge = size * radius * (0.955 + 0.030 * wave + 0.015 * small)
        lift = 0.5 * (low + high) + frill * wave * (0.5 * (high - low) - 0.0012) / 0.0032
        level = ((0.60 * size * radius, low), (edge, lift - 0.0011), (edge, lift + 0.0011))
        levels = (*level, (0.62 * size * radius, high - 0.0006))
        rings = [np.column_stack([np.cos(angle) * r, np.sin(angle) * r, np.full(36, z)]) for r, z in levels]
        leaves.append(creased(loft(rings), 70.0))
    mesh = merge(leaves)
    mesh = mesh.moved(z=-float(mesh.vertices[:, 2].min())).seen_from_above(1.03 * radius)
    veins = _veins(rng, shade)
    return Draft(
        shape="round",
        description="A frilly round leaf of green lettuce.",
        tags=("lettuce", "lettuce leaf", "salad", "leaf", "food"),
        mass_kg=0.02,
        parts=(part("leaf", mesh, veins, specular=0.3, shininess=0.4), *standing(0.66 * solid, (solid, 0.012))),
        grasps=(grip_across(_SLICE_GRIP, solid),),
        regions=(disc("base", solid), disc("top", 0.9 * solid, 0.012)),
        parameters={"radius_m": radius, "height_m": height, "frills": float(frills)},
    )


def _veins(rng: np.random.Generator, shade: Rgb) -> Canvas:
    """Draw a leaf from above: pale in the middle, dark at the edge, with nine bent veins."""
    canvas = Canvas(2.0, 2.0, (160, 160), shade)
    r = canvas.radius
    canvas.paint(np.clip(1.0 - r / 0.75, 0.0, 1.0), (0.78, 0.88, 0.48), strength=0.75)
    canvas.paint(np.clip((r - 0.75) / 0.25, 0.0, 1.0), shaded(shade, 0.62), strength=0.6)
    start = rng.uniform(0.0, 6.0)
    for k in range(9):
        a = start + 2.0 * math.pi * k / 9 + rng.uniform(-0.2, 0.2)
        bend = a + rng.uniform(-0.25, 0.25)
        knee, tip = (0.45 * math.cos(a), 0.45 * math.sin(a)), (0.88 * math.cos(bend), 0.88 * math.sin(bend))
        points = [(1.0, 1.0), (1.0 + knee[0], 1.0 + knee[1]), (1.0 + tip[0], 1.0 + tip[1])]
        canvas.line(points, 0.035, (0.82, 0.90, 0.58), 0.7)
    canvas.grain(rng, cells=(18, 18), amount=0.07)
    return canvas


@generator("bun_top", colors=("brown",))
def bun_top(rng: np.random.Generator, _color: str) -> Draft:
    """Make the domed upper half of a bun, with sesame on most looks.

    Half a bun of 72 mm weighs 25 to 30 g; 50 g keep it where it is put.
    """
    radius, height = 0.036 * rng.uniform(0.985, 1.0), 0.034 * rng.uniform(0.97, 1.0)
    crust, seeds = jittered(BUN, rng, amount=0.14), int(rng.choice([0, 20, 28, 36]))
    shoulder = 0.0165
    rise = height - shoulder
    dome = (0.97 * radius, 0.84 * radius, 0.62 * radius, 0.32 * radius, 0.0)
    z = (shoulder, shoulder + 0.46 * rise, shoulder + 0.77 * rise, shoulder + 0.95 * rise, height)
    radii = (0.0, 0.955 * radius, radius, radius, *dome)
    bun = Turned(radii, (0.0, 0.0, 0.0045, 0.60 * shoulder, *z), 24, 50.0, wrap=False)
    mesh = bun.mesh().domed(radius, height, height)
    return Draft(
        shape="round",
        description="The domed upper half of a burger bun.",
        tags=("bun", "top bun", "burger bun", "bread", "food"),
        mass_kg=0.05,
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
    """Draw the crust from above: brown on the crown, pale toward the cut, strewn with seeds."""
    canvas = Canvas(2.0, 2.0, (160, 160), crust)
    r = canvas.radius
    canvas.paint(np.clip((r - 0.72) / 0.28, 0.0, 1.0), mixed(crust, _CRUMB, 0.7))
    canvas.paint(np.clip(1.0 - r / 0.62, 0.0, 1.0), shaded(crust, 0.66), strength=0.45)
    canvas.grain(rng, cells=(13, 13), amount=0.035)
    for x, y in scattered(rng, tries=30 * seeds, gap=0.165, reach=0.72, count=seeds):
        turn = rng.uniform(0.0, math.pi)
        canvas.ellipse((x + 0.010, y - 0.014), (0.062, 0.040), shaded(crust, 0.60), turn)
        canvas.ellipse((x, y), (0.058, 0.036), (0.97, 0.91, 0.72), turn)
    return canvas
