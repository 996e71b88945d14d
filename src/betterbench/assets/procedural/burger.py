"""Burgers and the painted round block that looks like one."""

import math

import numpy as np

from betterbench.assets.asset import Grasp
from betterbench.assets.authoring.draft import JAW_OPENS_ALONG_Y, Draft, disc, part
from betterbench.assets.authoring.mesh import Mesh, creased, lathe, loft
from betterbench.assets.authoring.paint import BUN, Canvas, Colour, jittered, mixed, shaded
from betterbench.assets.authoring.registry import generator
from betterbench.assets.authoring.solids import foot, upright_cylinder
from betterbench.geometry import Pose
from betterbench.state import Region

_CRUMB: Colour = (0.90, 0.74, 0.46)


@generator("burger", colours=("brown",))
def burger(rng: np.random.Generator, _colour: str) -> Draft:
    """Make a burger: bun, patty, cheese, tomato, lettuce, bun with sesame.

    A small hamburger is 65 to 70 mm wide before it is bitten and weighs about 0.15 to 0.2 kg; this one fits an 80 mm
    jaw.
    """
    radius, height = rng.uniform(0.0325, 0.0340), rng.uniform(0.0490, 0.0545)
    bun = jittered(BUN, rng, amount=0.14)
    seeds = int(rng.choice([0, 18, 26, 34]))
    lettuce_below, with_tomato = rng.random() < 0.4, rng.random() < 0.75

    base = rng.uniform(0.0125, 0.0150)
    patty_top = base + rng.uniform(0.0095, 0.0120)
    bun_low = patty_top + (0.0085 if with_tomato else 0.0055)
    lettuce_z = base + 0.0006 if lettuce_below else bun_low - 0.0012
    tomato_z = patty_top + 0.0022

    parts = [
        part("bottom_bun", _bottom_bun(radius, base), shaded(mixed(bun, _CRUMB, 0.25), 0.97), specular=0.08),
        part("patty", _patty(rng, 0.965 * radius, base, patty_top), jittered((0.29, 0.14, 0.07), rng), specular=0.15),
        part("cheese", _cheese(rng, radius, patty_top), jittered((0.98, 0.68, 0.08), rng, amount=0.05), specular=0.3),
        part("lettuce", _lettuce(rng, radius, lettuce_z), jittered((0.33, 0.62, 0.12), rng, amount=0.15), specular=0.2),
        part(
            "top_bun", _top_bun(radius, bun_low, height), _crust(rng, bun, seeds=seeds), specular=0.22, shininess=0.35
        ),
    ]
    if with_tomato:
        slice_ = lathe([(0, tomato_z), (0.93 * radius, tomato_z), (0.93 * radius, bun_low), (0, bun_low)], 12)
        parts.append(part("tomato", slice_, jittered((0.80, 0.13, 0.08), rng), specular=0.4))

    shoulder = bun_low + 0.45 * (height - bun_low)
    collision = (
        foot(0.021),
        upright_cylinder(radius, 0.0005, shoulder),
        upright_cylinder(0.80 * radius, shoulder, height - 0.0035),
        upright_cylinder(0.45 * radius, height - 0.0035, height - 0.0005),
    )
    return Draft(
        shape="round",
        description="A cheeseburger in a golden brown bun.",
        tags=("burger", "hamburger", "cheeseburger", "food", "bun"),
        mass_kg=0.18,
        parts=(*parts, *collision),
        grasps=_round_grasps(radius, 0.47 * height),
        regions=_round_regions(radius, height),
        parameters={"radius_m": radius, "height_m": height, "seeds": seeds, "lettuce_below": str(lettuce_below)},
    )


def _round_grasps(radius: float, height: float) -> tuple[Grasp, ...]:
    """Return the grasp across the diameter."""
    pose = Pose((0.0, 0.0, height), JAW_OPENS_ALONG_Y)
    return (Grasp("body", pose, 2.0 * radius, clearance_m=0.005, symmetric_yaw=True),)


def _round_regions(radius: float, height: float) -> tuple[Region, ...]:
    """Return the discs on which it stands and on which something could be put."""
    return (disc("base", radius), disc("top", 0.5 * radius, height))


def _bottom_bun(radius: float, top: float) -> Mesh:
    """Return the lower half of the bun."""
    profile = [(0, 0), (0.90 * radius, 0), (radius, 0.45 * top), (0.985 * radius, top), (0, top)]
    return lathe(profile, 16, crease_degrees=55.0)


def _patty(rng: np.random.Generator, radius: float, low: float, high: float) -> Mesh:
    """Return the patty: a thick disc with an uneven edge."""
    z = (low - 0.0005, low + 0.5 * (high - low), high)
    profile = [(0, z[0]), (0.955 * radius, z[0]), (radius, z[1]), (0.96 * radius, z[2]), (0, z[2])]
    mesh = lathe(profile, 14, crease_degrees=60.0)
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    angle = np.arctan2(y, x)
    phases = rng.uniform(0.0, 2.0 * math.pi, 3)
    swell = sum(np.sin(k * angle + p) for k, p in zip((3, 5, 7), phases.tolist(), strict=True))
    factor = (1.0 - 0.012 * (1.0 + swell / 3.0))[:, None]
    return Mesh(mesh.vertices * np.hstack([factor, factor, np.ones_like(factor)]), mesh.faces, mesh.uv)


def _cheese(rng: np.random.Generator, radius: float, z: float) -> Mesh:
    """Return a square slice whose molten corners hang over the patty."""
    turn = rng.uniform(0.0, math.pi / 2.0)
    droop = rng.uniform(0.005, 0.008)
    angle = turn + 2.0 * math.pi * np.arange(16) / 16
    cornerness = np.tile([0.0, 0.42, 1.0, 0.42], 4)
    outer = radius * (0.93 + 0.12 * cornerness)
    inner = radius * 0.90
    thickness = 0.0022
    fall = np.where(cornerness > 0.9, droop, np.where(cornerness > 0.1, 0.25 * droop, 0.0))

    def ring(r: np.ndarray | float, height: np.ndarray | float) -> np.ndarray:
        flat = np.stack([np.cos(angle) * r, np.sin(angle) * r, np.zeros(16)], axis=1)
        flat[:, 2] = height
        return flat

    rings = [ring(outer, z - fall - 0.0002), ring(outer, z + thickness - fall), ring(inner, z + thickness)]
    return creased(loft(rings), 50.0)


def _lettuce(rng: np.random.Generator, radius: float, z: float) -> Mesh:
    """Return a leaf with a frilled edge."""
    n = 24
    frill = np.where(np.arange(n) % 2 == 0, 1.0, -1.0) * rng.uniform(0.6, 1.0, n)
    angle = 2.0 * math.pi * np.arange(n) / n
    r = radius * (1.030 + 0.020 * rng.uniform(-1.0, 1.0, n))
    low = np.stack([r * np.cos(angle), r * np.sin(angle), z - 0.0012 + 0.0019 * frill], axis=1)
    return creased(loft([low, low + np.array([0.0, 0.0, 0.0016])]), 75.0)


def _top_bun(radius: float, low: float, high: float) -> Mesh:
    """Return the domed half of the bun, mapped to its picture from above."""
    rise = high - low
    profile = [(0.0, low), (0.955 * radius, low)]
    profile += [
        (radius * share, low + rise * level)
        for share, level in ((1.0, 0.27), (0.92, 0.60), (0.66, 0.875), (0.32, 0.98))
    ]
    profile.append((0.0, high))
    mesh = lathe(profile, 18, crease_degrees=55.0)
    # Stretch the map outwards, where the dome is steep, so that the seeds keep their shape.
    distance = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    below = np.clip((high - mesh.vertices[:, 2]) / rise, 0.0, 1.0)
    reach = np.hypot(distance / radius, 0.75 * below) / math.hypot(1.0, 0.75)
    share = (0.5 * reach / np.maximum(distance, 1e-9))[:, None]
    return Mesh(mesh.vertices, mesh.faces, 0.5 + share * mesh.vertices[:, :2])


def _crust(rng: np.random.Generator, bun: Colour, *, seeds: int) -> Canvas:
    """Draw the crust of the bun from above: browned in the middle, pale at the edge, with sesame seeds."""
    canvas = Canvas(2.0, 2.0, (128, 128), bun)
    r = np.hypot(canvas.x - 1.0, canvas.y - 1.0)
    canvas.paint(np.clip((r - 0.70) / 0.30, 0.0, 1.0), mixed(bun, _CRUMB, 0.8))
    canvas.paint(np.clip(1.0 - r / 0.6, 0.0, 1.0) * 0.35, shaded(bun, 0.72))
    canvas.grain(rng, cells=(12, 12), amount=0.035)
    placed: list[tuple[float, float]] = []
    for _ in range(20 * seeds):
        if len(placed) == seeds:
            break
        angle, distance = rng.uniform(0.0, 2.0 * math.pi), 0.72 * math.sqrt(rng.random())
        x, y = 1.0 + distance * math.cos(angle), 1.0 + distance * math.sin(angle)
        if all(math.hypot(x - px, y - py) > 0.16 for px, py in placed):
            placed.append((x, y))
            turn = rng.uniform(0.0, math.pi)
            canvas.ellipse((x + 0.012, y - 0.016), (0.066, 0.042), shaded(bun, 0.62), turn)
            canvas.ellipse((x, y), (0.062, 0.038), (0.97, 0.90, 0.70), turn)
    return canvas
