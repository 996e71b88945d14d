"""Generator of burgers."""

import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, Turned, disc, generator, grip_across, part, standing
from betterbench.sim.assets.authoring.mesh import Mesh, creased, loft
from betterbench.sim.assets.authoring.paint import BUN, Canvas, Rgb, jittered, mixed, scattered, shaded

_CRUMB: Rgb = (0.90, 0.74, 0.46)


@generator("burger", colors=("brown",))
def burger(rng: np.random.Generator, _color: str) -> Draft:
    """Make a burger with patty, cheese, tomato and lettuce in a sesame bun.

    A small hamburger is 65 to 70 mm wide and weighs about 0.15 to 0.2 kg. This one is narrow enough for a gripper that
    opens to 80 mm.
    """
    radius, height = rng.uniform(0.0325, 0.0340), rng.uniform(0.0490, 0.0545)
    bun, seeds = jittered(BUN, rng, amount=0.14), int(rng.choice([0, 18, 26, 34]))
    lettuce_below, with_tomato = rng.random() < 0.4, rng.random() < 0.75
    base = rng.uniform(0.0125, 0.0150)
    patty = base + rng.uniform(0.0095, 0.0120)  # height of the patty's top [m]
    low = patty + (0.0085 if with_tomato else 0.0055)
    leaf = base + 0.0006 if lettuce_below else low - 0.0012
    radii = (0.0, 0.90 * radius, radius, 0.985 * radius, 0.0)
    bottom = Turned(radii, (0.0, 0.0, 0.45 * base, base, base), 16, 55.0, wrap=False)
    parts = [
        part("bottom_bun", bottom.mesh(), shaded(mixed(bun, _CRUMB, 0.25), 0.97), specular=0.08),
        part("patty", _patty(rng, 0.965 * radius, base, patty), jittered((0.29, 0.14, 0.07), rng), specular=0.15),
        part("cheese", _cheese(rng, radius, patty), jittered((0.98, 0.68, 0.08), rng, amount=0.05), specular=0.3),
        part("lettuce", _lettuce(rng, radius, leaf), jittered((0.33, 0.62, 0.12), rng, amount=0.15)),
        part("top_bun", _top_bun(radius, low, height), _crust(rng, bun, seeds=seeds), specular=0.22, shininess=0.35),
    ]
    if with_tomato:
        cut, under = 0.93 * radius, patty + 0.0022
        slice_ = Turned((0.0, cut, cut, 0.0), (under, under, low, low), 12, wrap=False)
        parts.append(part("tomato", slice_.mesh(), jittered((0.80, 0.13, 0.08), rng), specular=0.4))
    shoulder = low + 0.45 * (height - low)
    crown = ((0.80 * radius, height - 0.0035), (0.45 * radius, height - 0.0005))
    return Draft(
        shape="round",
        description="A cheeseburger in a golden brown bun.",
        tags=("burger", "hamburger", "cheeseburger", "food", "bun"),
        traits=("food",),
        mass_kg=round(0.18 * (radius / 0.0333) ** 2 * height / 0.052, 4),
        material="bread",
        parts=(*parts, *standing(0.021, (radius, shoulder), *crown)),
        grasps=(grip_across(0.47 * height, radius, clearance=0.005),),
        regions=(disc("base", radius), disc("top", 0.5 * radius, height)),
        parameters={"radius_m": radius, "height_m": height, "seeds": seeds, "lettuce_below": str(lettuce_below)},
    )


def _patty(rng: np.random.Generator, radius: float, low: float, high: float) -> Mesh:
    """Return the mesh of the patty, a thick disc with an uneven edge."""
    z = (low - 0.0005, low - 0.0005, low + 0.5 * (high - low), high, high)
    mesh = Turned((0.0, 0.955 * radius, radius, 0.96 * radius, 0.0), z, 14, 60.0, wrap=False).mesh()
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
    phases = rng.uniform(0.0, 2.0 * math.pi, 3)
    swell = sum(np.sin(k * angle + p) for k, p in zip((3, 5, 7), phases.tolist(), strict=True))
    return mesh.scaled_across(1.0 - 0.012 * (1.0 + swell / 3.0))


def _cheese(rng: np.random.Generator, radius: float, z: float) -> Mesh:
    """Return the mesh of a square slice of cheese with molten corners that hang over the patty."""
    turn, droop, thickness = rng.uniform(0.0, math.pi / 2.0), rng.uniform(0.005, 0.008), 0.0022
    angle = turn + 2.0 * math.pi * np.arange(16) / 16
    cornerness = np.tile([0.0, 0.42, 1.0, 0.42], 4)
    outer = radius * (0.93 + 0.12 * cornerness)
    fall = np.where(cornerness > 0.9, droop, np.where(cornerness > 0.1, 0.25 * droop, 0.0))
    levels = ((outer, z - fall - 0.0002), (outer, z + thickness - fall), (radius * 0.90, z + thickness))
    rings = [np.stack([np.cos(angle) * r, np.sin(angle) * r, np.broadcast_to(h, 16)], axis=1) for r, h in levels]
    return creased(loft(rings), 50.0)


def _lettuce(rng: np.random.Generator, radius: float, z: float) -> Mesh:
    """Return the mesh of a lettuce leaf with a frilled edge."""
    n = 24
    frill = np.where(np.arange(n) % 2 == 0, 1.0, -1.0) * rng.uniform(0.6, 1.0, n)
    angle = 2.0 * math.pi * np.arange(n) / n
    r = radius * (1.030 + 0.020 * rng.uniform(-1.0, 1.0, n))
    low = np.stack([r * np.cos(angle), r * np.sin(angle), z - 0.0012 + 0.0019 * frill], axis=1)
    return creased(loft([low, low + np.array([0.0, 0.0, 0.0016])]), 75.0)


def _top_bun(radius: float, low: float, high: float) -> Mesh:
    """Return the mesh of the domed half of the bun, with its texture projected from above."""
    rise = high - low
    radii = [share * radius for share in (0.0, 0.955, 1.0, 0.92, 0.66, 0.32, 0.0)]
    z = [low + level * rise for level in (0.0, 0.0, 0.27, 0.60, 0.875, 0.98)]
    return Turned(radii, (*z, high), 18, 55.0, wrap=False).mesh().domed(radius, high, rise)


def _crust(rng: np.random.Generator, bun: Rgb, *, seeds: int) -> Canvas:
    """Draw the crust of the bun from above, with sesame seeds.

    The crust is brown in the middle and pale at the edge.
    """
    canvas = Canvas(2.0, 2.0, (128, 128), bun)
    r = canvas.radius
    canvas.paint(np.clip((r - 0.70) / 0.30, 0.0, 1.0), mixed(bun, _CRUMB, 0.8))
    canvas.paint(np.clip(1.0 - r / 0.6, 0.0, 1.0) * 0.35, shaded(bun, 0.72))
    canvas.grain(rng, cells=(12, 12), amount=0.035)
    for x, y in scattered(rng, tries=20 * seeds, gap=0.16, reach=0.72, count=seeds):
        turn = rng.uniform(0.0, math.pi)
        canvas.ellipse((x + 0.012, y - 0.016), (0.066, 0.042), shaded(bun, 0.62), turn)
        canvas.ellipse((x, y), (0.062, 0.038), (0.97, 0.90, 0.70), turn)
    return canvas
