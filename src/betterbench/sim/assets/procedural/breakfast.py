"""Generators of breakfast tableware: a bowl of cereal, a salt shaker, a jar of jam, and an egg in an egg cup."""

import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, grip_across, part, spheroid, standing
from betterbench.sim.assets.authoring.lettering import write_word
from betterbench.sim.assets.authoring.paint import PALETTE, Canvas, Rgb, jittered, mixed, scattered, shaded, uniforms

_PALE: Rgb = (0.92, 0.91, 0.87)
_GRAY_BLUE = mixed(PALETTE["blue"], PALETTE["gray"], 0.2)


@generator("cereal_bowl", colors=("white", "blue", "green"), keeps_upright=True)
def cereal_bowl(rng: np.random.Generator, color: str) -> Draft:
    """Make a bowl of cereal with milk.

    The smallest bowl weighs 0.25 kg and contains 0.2 kg of cereal and milk. The mass of a larger bowl is increased in
    proportion to its volume. The collision shape is solid, because the bowl is too wide for a gripper and filled to the
    rim.
    """
    size, stand, height, below = uniforms(rng, (0.92, 1.0), (0.027, 0.036), (0.0440, 0.0540), (0.007, 0.011))
    radius, level = 0.060 * size, height - below
    cereal, striped = str(rng.choice(["rings", "flakes", "balls"])), str(rng.choice(["none", "two", "wide", "rim"]))
    belly, ink = rng.uniform(0.66, 0.86), ((0.55, 0.33, 0.16), (0.36, 0.37, 0.39), (0.30, 0.42, 0.30))[rng.integers(3)]
    glaze = jittered(mixed(PALETTE[color], (0.9, 0.9, 0.9), 0.10), rng)
    inside = radius - 0.0035 - 0.10 * (height - level)
    outer = (0.0, stand, stand + 0.001, belly * radius, (0.62 + 0.40 * belly) * radius, radius)
    edge, low = height - 0.0010, level - 0.002
    z = (0.0, 0.0, 0.0050, 0.0180, 0.0340, edge, height, edge, low, low)
    bowl = Turned((*outer, radius - 0.0012, radius - 0.0030, inside, 0.0), z, wrap=False)
    _, _, _, wall, _, rim, _, inner, _, _ = bowl.rows
    canvas = bowl.canvas(glaze, (8, 128))
    bands = {"two": ((0.50, 0.61), (0.70, 0.81)), "wide": ((0.35, 0.75),), "rim": ((0.84, 1.0),)}
    for low_edge, high_edge in bands.get(striped, ()):
        ink = _PALE if color != "white" else ink
        canvas.band(wall + low_edge * (rim - wall), wall + high_edge * (rim - wall), ink)
    canvas.brighten(0.80, rim)
    canvas.shade(np.where(canvas.y > inner, 0.88, 1.0))
    reach = inside + 0.0008
    milk = Turned((0.0, reach, reach, 0.0), (level - 0.003, level - 0.003, level, level), wrap=False)
    return Draft(
        shape="round",
        description=f"A {color} bowl of cereal with milk.",
        tags=("bowl", "cereal bowl", "cereal", "breakfast", "tableware"),
        traits=("breakfast",),
        mass_kg=round(0.45 * size**2 * height / 0.050, 4),
        material="ceramic",
        parts=(
            part("bowl", bowl.mesh(), canvas, specular=0.5, shininess=0.6),
            part("cereal", milk.mesh().seen_from_above(inside), _cereal(rng, kind=cereal), specular=0.25),
            *standing(0.68 * stand, (belly * radius, 0.018), (radius, height)),
        ),
        regions=(disc("base", stand), disc("top", radius, height)),
        parameters={"radius_m": radius, "height_m": height, "cereal": cereal},
    )


def _cereal(rng: np.random.Generator, *, kind: str) -> Canvas:
    """Draw milk with cereal floating in it, seen from above."""
    canvas = Canvas(2.0, 2.0, (192, 192), (0.95, 0.94, 0.90))
    canvas.shade(1.0 - 0.10 * np.clip((canvas.radius - 0.85) / 0.15, 0.0, 1.0))
    for x, y in scattered(rng, tries=700, gap=0.17 if kind == "flakes" else 0.20, reach=0.84):
        crust = jittered((0.80, 0.52, 0.17), rng, amount=0.16)
        turn = rng.uniform(0.0, math.pi)
        if kind == "flakes":
            size = rng.uniform(0.09, 0.13)
            canvas.ellipse((x + 0.015, y - 0.02), (size, 0.7 * size), (0.68, 0.60, 0.48), turn)
            canvas.ellipse((x, y), (size, 0.7 * size), crust, turn)
            canvas.ellipse((x, y), (0.55 * size, 0.3 * size), shaded(crust, 1.18), turn)
            continue
        if kind == "balls":
            crust = jittered((0.42, 0.22, 0.09), rng, amount=0.16)
        canvas.ellipse((x + 0.015, y - 0.02), (0.105, 0.105), (0.70, 0.63, 0.52))
        canvas.ellipse((x, y), (0.098, 0.098), crust)
        if kind == "rings":
            canvas.ellipse((x, y), (0.042, 0.042), (0.86, 0.80, 0.68))
        else:
            canvas.ellipse((x - 0.02, y + 0.025), (0.045, 0.04), shaded(crust, 1.3))
    return canvas


@generator("salt_shaker", colors=("white", "silver"))
def salt_shaker(rng: np.random.Generator, color: str) -> Draft:
    """Make a salt shaker of porcelain or brushed steel, with a large S on it and a chrome top with large holes.

    A half-full shaker of this size weighs 0.1 to 0.14 kg.
    """
    size, height, neck, waist = uniforms(rng, (0.92, 1.08), (0.070, 0.080), (0.016, 0.022), (0.72, 1.0))
    radius, shoulder, facets = 0.0205 * size, height - neck, rng.random() < 0.4
    swell, sides = rng.uniform(0.0, 0.10), int(rng.choice([6, 8, 12]))
    shade = jittered(PALETTE[color], rng, amount=0.05)
    if color == "white":
        shade = mixed(shade, (1.0, 1.0, 1.0), 0.75)
    narrow = 0.88 * waist * radius
    body = Turned(
        (0.0, radius - 0.0015, radius, (0.5 * (1.0 + waist) + swell) * radius, narrow, 0.0),
        (0.0, 0.0, 0.0020, 0.55 * shoulder, shoulder, shoulder),
        sides=sides if facets else 20,
        crease_degrees=22.0 if facets else 40.0,
        phase=-math.pi / 2 + (math.pi / sides if facets else 0.0),
    )
    cap = narrow + 0.0012
    low, high = (shoulder - 0.0010, shoulder - 0.0010, shoulder + 0.0070), (height - 0.0070, height - 0.0022)
    radii = (0.0, cap, cap, 0.93 * cap, 0.70 * cap, 0.36 * cap, 0.0)
    top = Turned(radii, (*low, *high, height - 0.0004, height), 18, 55.0, wrap=False)
    canvas = body.canvas(shade, (128, 128))
    canvas.brighten(0.94 if color == "white" else 0.84, body.rows[4])
    # Draw an S for salt on each half of the body.
    middle = (0.5 * canvas.width, body.rows[2] + 0.46 * shoulder)
    write_word(canvas, "S", middle, height=0.027, ink=(0.12, 0.14, 0.20), weight=0.19)
    picture = Canvas(2.0, 2.0, (96, 96), (0.60, 0.61, 0.64))
    picture.shade(1.0 - 0.30 * np.exp(-(((picture.radius - 0.80) / 0.08) ** 2)))
    holes = [(0.0, 0.0), *((0.40 * math.cos(math.pi * k / 3), 0.40 * math.sin(math.pi * k / 3)) for k in range(6))]
    for x, y in holes:
        picture.ellipse((1.0 + x, 1.0 + y), (0.125, 0.125), (0.05, 0.05, 0.06))
    return Draft(
        shape="cylinder",
        description=f"A {color} salt shaker with a pierced chrome top.",
        tags=("salt", "salt shaker", "shaker", "condiment", "tableware"),
        mass_kg=round(0.12 * size**2 * height / 0.075, 4),
        material="ceramic" if color == "white" else "steel",
        parts=(
            part("body", body.mesh(), canvas, specular=0.5, shininess=0.6),
            part("top", top.mesh().seen_from_above(cap), picture, specular=0.9, shininess=0.8),
            *standing(0.62 * radius, ((0.5 * (1.0 + waist) + swell) * radius, 0.72 * shoulder), (cap, height - 0.001)),
        ),
        grasps=(grip_across(0.45 * height, (0.5 * (1.0 + waist) + swell) * radius),),
        regions=(disc("base", radius), disc("top", 0.7 * cap, height)),
        parameters={"radius_m": radius, "height_m": height, "facets": str(facets)},
    )


_LIDS: dict[str, Rgb] = {"gingham": (0.93, 0.92, 0.88), "gold": (0.80, 0.62, 0.20), "white": (0.92, 0.92, 0.91)}


@generator("jam_jar", colors=("red", "orange"))
def jam_jar(rng: np.random.Generator, color: str) -> Draft:
    """Make a jar of jam with a screw lid and a label. The color word is the color of the jam.

    A full 0.12 l jar weighs about 0.25 kg. For other sizes, the mass is proportional to the volume.
    """
    size, height, lid_height = uniforms(rng, (0.86, 1.0), (0.060, 0.074), (0.012, 0.017))
    radius, low, kind = 0.030 * size, height - lid_height, str(rng.choice(list(_LIDS)))
    jam = jittered({"red": (0.50, 0.03, 0.05), "orange": (0.86, 0.38, 0.03)}[color], rng, amount=0.10)
    neck, faces = rng.uniform(0.78, 0.92) * radius, int(rng.choice([22, 22, 6, 8]))
    wide = rng.uniform(0.90, 1.0)  # width of the foot relative to the body; below 1 if the jar widens upward
    radii = (0.0, wide * radius - 0.004, wide * radius, radius, 0.95 * radius, neck, neck, 0.0)
    z = (0.0, 0.0, 0.0045, low - 0.0090, low - 0.0040, low - 0.0010, low + 0.001, low + 0.001)
    crease = 40.0 if faces > 12 else 25.0
    jar = Turned(radii, z, faces, crease, phase=math.pi / 2 + (0.0 if faces > 12 else math.pi / faces))
    cap, inner = min(neck + 0.0045, 0.97 * radius), height - 0.0010
    lid_radii = (0.0, cap, cap, cap - 0.0020, 0.82 * cap, 0.78 * cap, 0.0)
    top = Turned(lid_radii, (low, low, height - 0.0020, height, height, inner, inner), 22, 50.0, wrap=False)
    held = radius if faces > 12 else 0.5 * (1.0 + math.cos(math.pi / faces)) * radius
    return Draft(
        shape="cylinder",
        description=f"A glass jar of {color} jam with a lid and a label.",
        tags=("jam", "jam jar", "marmalade", "jar", "breakfast"),
        traits=("breakfast",),
        mass_kg=round(0.25 * size**2 * height / 0.070, 4),
        material="glass",
        parts=(
            part("jar", jar.mesh(), _jam(rng, jar, jam), specular=0.8, shininess=0.8),
            part("lid", top.mesh().seen_from_above(cap), _lid(kind, color, jam), specular=0.4, shininess=0.5),
            *standing(0.58 * radius, (held, low - 0.005), (cap, height)),
        ),
        grasps=(grip_across(0.45 * height, held),),
        regions=(disc("base", radius), disc("top", 0.7 * cap, height)),
        parameters={"radius_m": radius, "height_m": height, "lid": kind},
    )


def _jam(rng: np.random.Generator, jar: Turned, jam: Rgb) -> Canvas:
    """Draw jam in a glass jar, with a label that shows a fruit."""
    canvas = jar.canvas(jam, (192, 128))
    x, y, width = canvas.x, canvas.y, canvas.width
    low, high = jar.rows[2], jar.rows[3]
    glass = mixed(jam, (0.90, 0.95, 0.95), 0.60)
    canvas.paint(y > high + 0.001, glass)
    canvas.paint(y < low, glass, strength=0.5)
    canvas.grain(rng, cells=(14, 9), amount=0.10)
    for at in (0.06 * width, 0.94 * width):
        canvas.paint((np.abs(x - at) < 0.0016) & canvas.between(low, high), (1.0, 0.95, 0.9), strength=0.45)
    across, middle, tall = 0.5 * width, 0.5 * (low + high), 0.62 * 0.5 * (high - low)
    label = canvas.near(across, middle, 0.27 * width, tall)
    canvas.paint(label, (0.95, 0.93, 0.86))
    canvas.paint(label & (np.abs(y - middle) > 0.84 * tall), jam)
    canvas.ellipse((across, middle + 0.22 * tall), (0.0062, 0.0062), jam)
    canvas.ellipse((across + 0.003, middle + 0.22 * tall + 0.0068), (0.0042, 0.0018), (0.18, 0.45, 0.14), 0.5)
    for drop, share in ((-0.38, 0.15), (-0.60, 0.11)):
        canvas.paint(canvas.near(across, middle + drop * tall, share * width, 0.0010), (0.25, 0.16, 0.12))
    return canvas


def _lid(kind: str, color: str, jam: Rgb) -> Canvas:
    """Draw a lid from above, either covered with checked cloth or made of metal with a ring."""
    canvas = Canvas(2.0, 2.0, (128, 128), _LIDS[kind])
    if kind == "gingham":
        for along in (canvas.x, canvas.y):
            canvas.paint((along % 0.36) < 0.18, jam if color == "red" else (0.20, 0.42, 0.26), strength=0.55)
    else:
        canvas.paint((canvas.radius > 0.50) & (canvas.radius < 0.58), shaded(_LIDS[kind], 0.75))
    return canvas


@generator("egg_cup", colors=("white", "yellow"))
def egg_cup(rng: np.random.Generator, color: str) -> Draft:
    """Make a footed egg cup with a boiled egg in it. The color word is the color of the cup.

    A hen's egg and a porcelain egg cup weigh 60 g each. The egg cannot be taken out.
    """
    size, share, lip = uniforms(rng, (0.92, 1.0), (0.78, 1.0), (0.037, 0.044))
    height, stem = uniforms(rng, (0.0660, 0.0725), (0.30, 0.62))
    radius, banded = 0.026 * size, rng.random() < 0.5
    stand, glaze = radius * share, jittered(PALETTE[color], rng, amount=0.05)
    shell = mixed((0.95, 0.91, 0.84), (0.80, 0.54, 0.34), 0.25 + 0.75 * rng.random())
    stem_r, edge, floor = stem * radius, lip - 0.0008, lip - 0.0030
    low = (0.0, stand, stand, stem_r, stem_r, 0.78 * radius, 0.97 * radius)
    z = (0.0, 0.0, 0.0030, 0.0090, 0.0140, 0.0220, 0.0320, edge, lip, floor, floor)
    cup = Turned((*low, radius, radius - 0.0012, radius - 0.0035, 0.0), z, 20, 50.0, wrap=False)
    rows, canvas = cup.rows, cup.canvas(glaze, (8, 128))
    if banded:
        ink = _GRAY_BLUE if color == "white" else (0.93, 0.92, 0.88)
        canvas.band(rows[7] - 0.0075, rows[7] - 0.0035, ink)
        canvas.band(rows[1], rows[2] + 0.001, ink)
    canvas.shade(np.where(canvas.y > rows[8], 0.75, 1.0))
    inner, middle = radius - 0.0042, lip - 0.001
    angles = np.linspace(-0.15 * math.pi, 0.5 * math.pi, 7).tolist()
    up = [middle + (height - middle) * math.sin(a) for a in angles]
    egg = Turned([0.0, *(inner * max(math.cos(a), 0.0) for a in angles)], [up[0], *up], 16, 80.0, wrap=False)
    spots = Canvas(2.0, 2.0, (96, 96), jittered(shell, rng, amount=0.04))
    spots.grain(rng, cells=(20, 20), amount=0.035)
    spots.spots(rng, 26, shaded(shell, 0.82), radius=(0.010, 0.024), rows=(0.0, 2.0))
    return Draft(
        shape="irregular",
        description=f"A boiled egg in a {color} egg cup.",
        tags=("egg cup", "egg", "boiled egg", "breakfast", "tableware"),
        traits=("breakfast",),
        mass_kg=round(0.06 + 0.06 * size**2 * lip / 0.040, 4),
        material="ceramic",
        parts=(
            part("cup", cup.mesh(), canvas, specular=0.5),
            part("egg", egg.mesh().seen_from_above(inner), spots),
            *standing(0.66 * stand, (stand, 0.020), (radius, lip)),
            spheroid(inner, height - middle, middle),
        ),
        grasps=(grip_across(0.031, radius, clearance=min(0.012, 0.039 - radius)),),
        regions=(disc("base", stand),),
        parameters={"radius_m": radius, "height_m": height, "banded": str(banded)},
    )
