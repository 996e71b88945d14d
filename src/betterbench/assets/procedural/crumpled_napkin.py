"""Crumpled paper napkins."""

import itertools
import math

import numpy as np

from betterbench.assets.asset import CollisionPart
from betterbench.assets.authoring import Draft, centered, disc, generator, grip_across, part
from betterbench.assets.authoring.mesh import Mesh, creased
from betterbench.assets.authoring.paint import Canvas, Rgb, jittered, mixed, shaded
from betterbench.assets.authoring.solids import foot_square, upright_cylinder

# Paper on rubber and paper on wood hold better than smooth plastic does.
_FRICTION = (0.9, 0.01, 0.001)


@generator("crumpled_napkin", colors=("white", "cream"))
def crumpled_napkin(rng: np.random.Generator, color: str) -> Draft:
    """Make a paper napkin crumpled to a ball.

    A dinner napkin of 0.40 x 0.40 m and two to three plies of 18 to 35 g/m^2 weighs about 15 g.
    """
    across, high, printed = rng.uniform(0.0660, 0.0690), rng.uniform(0.050, 0.056), rng.random() < 0.45
    ink = ((0.30, 0.45, 0.72), (0.72, 0.28, 0.26), (0.36, 0.58, 0.38))[int(rng.integers(3))]
    roughness = rng.uniform(0.11, 0.16)
    paper = jittered((0.93, 0.93, 0.92) if color == "white" else (0.90, 0.83, 0.66), rng, amount=0.03)
    ball = _crumpled(rng, 0.5 * across, high, roughness=roughness)
    ball = ball.moved(*centered(ball))
    radius, top = 0.5 * across - 0.0015, float(ball.vertices[:, 2].max())
    return Draft(
        shape="irregular",
        description=f"A crumpled {color} paper napkin.",
        tags=("napkin", "paper", "crumpled paper", "paper ball", "trash"),
        mass_kg=0.015,
        parts=(
            part("paper", ball, _paper(rng, paper, ink=ink if printed else None), specular=0.02, shininess=0.05),
            _rough(foot_square(0.013, height=0.006)),
            _rough(upright_cylinder(0.66 * radius, 0.0010, top - 0.003)),
            _rough(upright_cylinder(radius, 0.26 * top, 0.74 * top)),
        ),
        grasps=(grip_across(0.028, radius, clearance=0.006),),
        regions=(disc("base", 0.5 * across),),
        parameters={"across_m": across, "height_m": top, "roughness": roughness},
    )


def _rough(solid: CollisionPart) -> CollisionPart:
    """Return the solid with the friction of paper."""
    return CollisionPart(solid.shape, solid.size, solid.position, friction=_FRICTION)


def _sphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Return unit vectors (n, 3) and faces (20 * 4**subdivisions, 3) of a subdivided icosahedron."""
    golden = 0.5 * (1.0 + math.sqrt(5.0))
    points = []
    for a in (-1.0, 1.0):
        for b in (-golden, golden):
            points += [(0.0, a, b), (a, b, 0.0), (b, 0.0, a)]
    vertices = np.array(points)
    edge = 2.0 + 1e-6  # length of the edges of this icosahedron
    near = np.linalg.norm(vertices[:, None] - vertices[None], axis=2) < edge
    triangles = []
    for i, j, k in itertools.combinations(range(12), 3):
        if near[i, j] and near[j, k] and near[i, k]:
            normal = np.cross(vertices[j] - vertices[i], vertices[k] - vertices[i])
            triangles.append((i, j, k) if normal @ vertices[i] > 0.0 else (i, k, j))
    faces = np.array(triangles)
    for _ in range(subdivisions):
        corners = vertices[faces]
        middles = [0.5 * (corners[:, a] + corners[:, b]) for a, b in ((0, 1), (1, 2), (2, 0))]
        soup = np.concatenate([corners.reshape(-1, 3), *middles])
        n = len(faces)
        p, q, r = 3 * np.arange(n), 3 * np.arange(n) + 1, 3 * np.arange(n) + 2
        pq, qr, rp = 3 * n + np.arange(n), 4 * n + np.arange(n), 5 * n + np.arange(n)
        split = np.concatenate([np.stack(t, axis=1) for t in ((p, pq, rp), (q, qr, pq), (r, rp, qr), (pq, qr, rp))])
        unique, inverse = np.unique(np.round(soup, 6) + 0.0, axis=0, return_inverse=True)
        vertices, faces = unique, inverse.reshape(-1)[split]
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces


def _crumpled(rng: np.random.Generator, radius: float, high: float, *, roughness: float) -> Mesh:
    """Return the ball: flats between sharp folds, creases that cut in, and tips of paper that stand out."""
    directions, faces = _sphere(2)
    n = len(directions)
    # Flats: the ball lies within randomly placed planes.
    planes = rng.standard_normal((16, 3))
    planes /= np.linalg.norm(planes, axis=1, keepdims=True)
    distance = rng.uniform(0.84, 1.0, 16)
    cosine = directions @ planes.T
    share = np.min(np.where(cosine > 0.3, distance / np.maximum(cosine, 0.3), 1.15), axis=1)
    share = np.minimum(share, 1.12)
    # Creases: valleys along random small circles; tips: single points pulled out or pushed in.
    for _ in range(7):
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        away = np.abs(directions @ axis - rng.uniform(-0.5, 0.5))
        share = share * (1.0 - roughness * np.clip(1.0 - away / 0.17, 0.0, 1.0))
    share = share * (1.0 + 0.55 * roughness * rng.uniform(-1.0, 1.0, n))
    spread = directions + 0.05 * rng.standard_normal((n, 3))
    points = spread * share[:, None]
    depth = share / float(share.max())
    # Fit the size, and press the underside flat where it lies.
    low, top = points.min(axis=0), points.max(axis=0)
    points = (points - 0.5 * (low + top)) / (0.5 * (top - low)) * np.array([radius, radius, 0.5 * high + 0.0025])
    points[:, 2] = np.maximum(points[:, 2], -0.5 * high)
    folds = np.clip((depth - 0.62) / 0.38, 0.0, 1.0)
    around = 0.5 + 0.5 * np.sin(np.arctan2(points[:, 1], points[:, 0]) + 2.0 * points[:, 2] / radius)
    return creased(Mesh(points, faces.astype(np.int32), np.stack([around, folds], axis=1)), 14.0)


def _paper(rng: np.random.Generator, paper: Rgb, *, ink: Rgb | None) -> Canvas:
    """Draw paper whose row is the depth of the fold: gray at the bottom of a crease, bright on a ridge."""
    canvas = Canvas(1.0, 1.0, (64, 64), paper)
    canvas.grain(rng, cells=(20, 20), amount=0.015)
    if ink is not None:
        for at in (0.30, 0.38):
            canvas.paint(np.abs(canvas.x - at) < 0.022, mixed(paper, ink, 0.75))
    canvas.shade(0.66 + 0.34 * np.clip(canvas.y / 0.7, 0.0, 1.0))
    canvas.paint(canvas.y > 0.93, shaded(paper, 1.3), strength=0.5)
    return canvas
