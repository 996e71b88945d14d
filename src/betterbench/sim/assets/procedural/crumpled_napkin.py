"""Generator of crumpled paper napkins."""

import itertools
import math

import numpy as np

from betterbench.sim.assets.authoring import Draft, centered, disc, generator, grip_across, merge, part, solid_box
from betterbench.sim.assets.authoring.mesh import Mesh, creased, loft
from betterbench.sim.assets.authoring.paint import Canvas, Rgb, jittered, mixed, shaded, uniforms
from betterbench.sim.assets.authoring.solids import upright_cylinder

_INKS: tuple[Rgb, ...] = ((0.16, 0.34, 0.72), (0.76, 0.16, 0.16), (0.16, 0.52, 0.26), (0.90, 0.52, 0.10))


@generator("crumpled_napkin", colors=("white", "cream"))
def crumpled_napkin(rng: np.random.Generator, color: str) -> Draft:
    """Make a paper napkin that is crumpled into a loose ball, from which paper corners stick out.

    A dinner napkin of 0.40 x 0.40 m with two to three plies of 18 to 35 g/m^2 weighs 12 to 18 g. The mass here is 77
    kg/m^3 times the volume of the bounding box. The napkin does not roll, because its collision shape has corners at
    the bottom and at the top.
    """
    wide, deep, high = uniforms(rng, (0.067, 0.071), (0.064, 0.068), (0.046, 0.057))
    ink, printed = _INKS[int(rng.integers(len(_INKS)))], rng.random() < 0.6
    roughness, corners = rng.uniform(0.11, 0.19), int(rng.integers(2, 5))
    paper = jittered((0.95, 0.95, 0.95) if color == "white" else (0.92, 0.85, 0.68), rng, amount=0.02)
    ball = _crumpled(rng, (0.5 * wide, 0.5 * deep, 0.5 * high), roughness=roughness)
    flaps = [_corner(rng, (0.5 * wide, 0.5 * deep, 0.5 * high), k, corners) for k in range(corners)]
    x, y, z = centered(ball)
    ball, flaps = ball.moved(x, y, z), [flap.moved(x, y, z) for flap in flaps]
    top = float(ball.vertices[:, 2].max())
    radius = 0.25 * (wide + deep) - 0.0030
    foot = 0.75 * radius  # its corners stick out of the round center
    picture = _paper(rng, paper, ink=ink if printed else None)
    edge = Canvas(1.0, 1.0, (16, 32), paper)
    if printed:
        edge.paint(edge.between(0.45, 0.72), ink)
    edge.brighten(0.72, 0.5)
    return Draft(
        shape="irregular",
        description=f"A crumpled {color} paper napkin.",
        tags=("napkin", "paper", "crumpled paper", "paper ball", "trash"),
        traits=(
            "trash",
            "paper",
        ),
        mass_kg=round(77.0 * wide * deep * high, 4),
        material="paper",
        parts=(
            part("paper", ball, picture, specular=0.02, shininess=0.05),
            part("corners", merge(flaps), edge, specular=0.02, shininess=0.05),
            solid_box((-foot, -foot, 0.0), (foot, foot, 0.34 * top)),
            upright_cylinder(radius, 0.24 * top, 0.76 * top),
            solid_box((-foot, -foot, 0.66 * top), (foot, foot, top - 0.004)),
        ),
        grasps=(grip_across(0.026, radius, clearance=0.006),),
        regions=(disc("base", 0.5 * deep),),
        parameters={"wide_m": wide, "deep_m": deep, "height_m": top, "roughness": roughness},
    )


def _sphere(parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit vectors (n, 3) and the faces (20 * parts**2, 3) of an icosahedron whose edges are subdivided."""
    golden = 0.5 * (1.0 + math.sqrt(5.0))
    points = []
    for a in (-1.0, 1.0):
        for b in (-golden, golden):
            points += [(0.0, a, b), (a, b, 0.0), (b, 0.0, a)]
    corners = np.array(points)
    # The edges of this icosahedron have the length 2.
    near = np.linalg.norm(corners[:, None] - corners[None], axis=2) < 2.0 + 1e-6
    soup = []
    for i, j, k in itertools.combinations(range(12), 3):
        if not (near[i, j] and near[j, k] and near[i, k]):
            continue
        o, p, q = corners[[i, j, k]]
        if np.cross(p - o, q - o) @ o < 0.0:
            p, q = q, p
        grid = {
            (s, t): o + (p - o) * s / parts + (q - o) * t / parts
            for s in range(parts + 1)
            for t in range(parts + 1 - s)
        }
        for (s, t), here in grid.items():
            if s + t < parts:
                soup += [here, grid[s + 1, t], grid[s, t + 1]]
            if s + t < parts - 1:
                soup += [grid[s + 1, t], grid[s + 1, t + 1], grid[s, t + 1]]
    unique, inverse = np.unique(np.round(np.array(soup), 6) + 0.0, axis=0, return_inverse=True)
    return unique / np.linalg.norm(unique, axis=1, keepdims=True), inverse.reshape(-1, 3)


def _corner(rng: np.random.Generator, half: tuple[float, float, float], number: int, count: int) -> Mesh:
    """Return a bent, pointed paper corner that sticks out of a ball with the given half extents [m]."""
    angle = 2.0 * math.pi * (number + rng.uniform(-0.3, 0.3)) / count
    rise, size, curl = rng.uniform(0.50, 1.15), rng.uniform(0.017, 0.024), rng.uniform(-0.5, 0.5)
    out = np.array([math.cos(angle) * math.cos(rise), math.sin(angle) * math.cos(rise), math.sin(rise)])
    side = np.array([-math.sin(angle), math.cos(angle), 0.0])
    lift = np.cross(out, side)
    root = 0.72 * out * np.array(half)
    rings = []
    for t, width in ((0.0, 1.0), (0.5, 0.62), (1.0, 0.06)):
        middle = root + out * size * t * 0.9 + lift * size * curl * t * t
        reach = side * size * 0.62 * width
        fold = lift * size * 0.22 * (1.0 - t)
        # The corner is a sheet 0.8 mm thick that is folded along its middle line.
        outline = [middle - reach, middle - fold, middle + reach, middle - fold + 0.0008 * lift]
        rings.append(np.array(outline))
    # A corner reaches at most 2.5 mm beyond the box of the ball.
    limit = np.array([half[0] + 0.0025, half[1] + 0.0025, half[2] + 0.001])
    points = [np.clip(ring, np.array([-limit[0], -limit[1], -half[2]]), limit) for ring in rings]
    return creased(loft(points, v=(0.0, 0.5, 1.0), caps=(False, True)), 30.0)


def _crumpled(rng: np.random.Generator, half: tuple[float, float, float], *, roughness: float) -> Mesh:
    """Return the mesh of the ball. It has flat areas between sharp folds, deep creases, and tips that stick out."""
    directions, faces = _sphere(5)
    n = len(directions)
    # Randomly placed planes cut off parts of the ball, which leaves flat areas.
    planes = rng.standard_normal((16, 3))
    planes /= np.linalg.norm(planes, axis=1, keepdims=True)
    distance = rng.uniform(0.84, 1.0, 16)
    cosine = directions @ planes.T
    share = np.min(np.where(cosine > 0.3, distance / np.maximum(cosine, 0.3), 1.15), axis=1)
    share = np.minimum(share, 1.12)
    # Creases are valleys along random small circles. Tips are single points that are pulled out or pushed in.
    for _ in range(9):
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        away = np.abs(directions @ axis - rng.uniform(-0.5, 0.5))
        share = share * (1.0 - roughness * np.clip(1.0 - away / 0.15, 0.0, 1.0))
    share = share * (1.0 + 0.22 * roughness * rng.uniform(-1.0, 1.0, n))
    spread = directions + 0.035 * rng.standard_normal((n, 3))
    points = spread * share[:, None]
    depth = share / float(share.max())
    # Fit the size, and press the underside flat where the napkin rests.
    low, top = points.min(axis=0), points.max(axis=0)
    rx, ry, rz = half
    points = (points - 0.5 * (low + top)) / (0.5 * (top - low)) * np.array([rx, ry, rz + 0.0025])
    points[:, 2] = np.maximum(points[:, 2], -rz)
    folds = np.clip((depth - 0.62) / 0.38, 0.0, 1.0)
    around = 0.5 + 0.5 * np.sin(np.arctan2(points[:, 1], points[:, 0]) + 2.0 * points[:, 2] / rx)
    return creased(Mesh(points, faces.astype(np.int32), np.stack([around, folds], axis=1)), 24.0)


def _paper(rng: np.random.Generator, paper: Rgb, *, ink: Rgb | None) -> Canvas:
    """Draw the paper.

    The rows of the texture correspond to the depth in a fold: it is gray at the bottom of a crease and bright on a
    ridge.
    """
    canvas = Canvas(1.0, 1.0, (64, 64), paper)
    canvas.grain(rng, cells=(20, 20), amount=0.015)
    if ink is not None:
        for at in (0.30, 0.40):
            canvas.paint(np.abs(canvas.x - at) < 0.028, mixed(paper, ink, 0.90))
    canvas.shade(0.62 + 0.38 * np.clip(canvas.y / 0.60, 0.0, 1.0))
    canvas.paint(canvas.y > 0.93, shaded(paper, 1.3), strength=0.5)
    return canvas
