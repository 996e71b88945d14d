"""Visual mesh of an imported object, with few triangles and one texture baked from the file's textures."""

from __future__ import annotations

from dataclasses import replace

import fast_simplification
import numpy as np
from scipy.spatial import cKDTree

from betterbench.sim.assets.asset import Texture, VisualPart
from betterbench.sim.assets.importing.raw import RawMesh, RawPart
from betterbench.sim.assets.importing.solid import spread

FACE_BUDGET = 600
"""Maximum number of triangles per asset, because each costs time in software rendering."""
THIN_FACE_BUDGET = 1_200
"""Maximum number of triangles of a thin-walled asset, which would be dented with only 600."""
DENT_SHARE = 0.006
"""Distance between the reduced and the original surface, as a share of the longest side, above which dents are visible.
Plate, bowl, mug and sponge of YCB have 0.7 to 1.9 % at 600 triangles and show it; apple, can, banana and fork at most
0.5 %."""
ATLAS = 512
"""Side of the painted picture [pixel]."""
_PAINT_POINTS = 200_000
_MOST_PLAIN_PARTS = 12
_SIDES_APART = 0.03
_AGGRESSION = 2.0
"""Growth of the tolerated error; the default of 7 crumples thin walls of scans."""


def visual_parts(mesh: RawMesh) -> tuple[VisualPart, ...]:
    """Return the visual parts of an object, at most 600 triangles, or 1,200 for thin walls.

    Parts with a single color each stay unchanged if they have few triangles in total. Otherwise the surface becomes one
    reduced part with a new texture, in which each triangle has its own area.
    """
    plain = all(part.is_plain() for part in mesh.parts)
    if plain and mesh.face_count <= FACE_BUDGET:
        looks: dict[tuple[float, ...], list[RawPart]] = {}
        for part in mesh.parts:
            looks.setdefault(part.rgba, []).append(part)
        if len(looks) <= _MOST_PLAIN_PARTS:
            return tuple(_plain(f"part{k}", parts) for k, parts in enumerate(looks.values()))
    if plain and len({part.rgba for part in mesh.parts}) == 1:
        vertices, faces = _reduced_enough(*mesh.surface())
        return (replace(_plain("part0", [RawPart("all", vertices, faces, mesh.parts[0].rgba)]), smooth=True),)
    return (_painted(mesh),)


def reduced(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a surface reduced to a number of triangles (quadric error, Garland and Heckbert, 1997)."""
    if len(faces) <= count:
        return vertices, faces
    points, triangles = fast_simplification.simplify(
        np.ascontiguousarray(vertices, dtype=np.float32),
        np.ascontiguousarray(faces, dtype=np.int32),
        target_count=count,
        agg=_AGGRESSION,
    )
    if len(triangles) > count:  # non-manifold edges stop the first pass early
        points, triangles = fast_simplification.simplify(points, triangles, target_count=count, agg=10)
    return np.asarray(points, dtype=np.float64), np.asarray(triangles, dtype=np.int64)


def _without_needles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the triangles that have an area: those thicker than a thousandth of their length."""
    corners = vertices[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    kept = faces[doubled > 2e-3 * longest * longest + 1e-13]
    return kept if len(kept) else faces


def _plain(name: str, parts: list[RawPart]) -> VisualPart:
    vertices = np.concatenate([part.vertices for part in parts])
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    faces = _without_needles(vertices, faces)
    r, g, b, a = (round(v, 4) for v in parts[0].rgba)
    return VisualPart(name, _single(vertices), _index(faces), (r, g, b, max(a, 0.05)), smooth=False)


def _painted(mesh: RawMesh) -> VisualPart:
    vertices, faces = _reduced_enough(*mesh.surface())
    faces = _without_needles(vertices, faces)
    points, normals, colors = _colored_points(mesh)
    where, owners, weights, uv = _atlas(len(faces))
    at = np.einsum("kc,kcd->kd", weights, vertices[faces[owners]])
    # A point takes the color of its own side of a wall: differing normals are penalized by two wall thicknesses.
    apart = _SIDES_APART * float(np.ptp(points, axis=0).max())
    tree = cKDTree(np.hstack([points, apart * normals]))
    _, nearest = tree.query(np.hstack([at, apart * normals_of(vertices, faces)[owners]]), k=3)
    picture = np.zeros((ATLAS, ATLAS, 3))
    picture[tuple(where.T)] = colors[nearest].mean(axis=1)
    pixels = np.ascontiguousarray(np.clip(np.rint(picture * 255.0), 0, 255).astype(np.uint8))
    # Every corner of a triangle has its own texture coordinate; positions are shared, for smooth shading.
    corners = np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3)
    texture = Texture(pixels, uv.astype(np.float32), corners)
    alpha = min((part.rgba[3] for part in mesh.parts), default=1.0)
    return VisualPart("body", _single(vertices), _index(faces), (1.0, 1.0, 1.0, alpha), texture=texture)


def _reduced_enough(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a surface of 600 triangles, or of 1,200 if it would be dented."""
    points, triangles = reduced(vertices, faces, FACE_BUDGET)
    if len(triangles) == len(faces):
        return points, triangles
    size = float(np.ptp(vertices, axis=0).max())
    before, after = (spread(*surface, size / 120.0)[0] for surface in ((vertices, faces), (points, triangles)))
    dent = max(_farthest(before, after), _farthest(after, before))
    if dent - size / 240.0 <= DENT_SHARE * size:  # points are half a spacing apart
        return points, triangles
    return reduced(vertices, faces, THIN_FACE_BUDGET)


def _farthest(points: np.ndarray, others: np.ndarray) -> float:
    """Return the 99th percentile of the distances to other points."""
    return float(np.percentile(cKDTree(others).query(points[:: max(1, len(points) // 5_000)])[0], 99))


def normals_of(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the unit normals (m, 3) of triangles, or zeros for triangles without an area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None])


def _colored_points(mesh: RawMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points spread over the surface (k, 3), their normals (k, 3) and their colors (k, 3) in [0, 1]."""
    areas = 0.0
    for part in mesh.parts:
        a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
        areas += float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    spacing = max((2.0 * areas / _PAINT_POINTS) ** 0.5, 1e-9)
    points, normals, colors = [], [], []
    for part in mesh.parts:
        found, owners, weights = spread(part.vertices, part.faces, spacing)
        points.append(found)
        normals.append(normals_of(part.vertices, part.faces)[owners])
        colors.append(part.colors_at(owners, weights))
    return np.concatenate(points), np.concatenate(normals), np.concatenate(colors)


def _atlas(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Lay out triangles in a square texture, two in each cell of a regular grid.

    Returns:
        (k, 2) painted pixels (row, column), (k,) the triangle of each, (k, 3) barycentric coordinates there, and
        (3 * count, 2) texture coordinates of the corners.
    """
    across = int(np.ceil(np.sqrt((count + 1) // 2)))
    cell = ATLAS // across
    # Keep the corners two pixels inside each triangle's half of the cell, so that interpolation does not mix in the
    # colors of neighboring triangles.
    low, far = 2.0, cell - 4.0
    corners = np.array(
        [[(low, low), (far, low), (low, far)], [(cell - 2.0, cell - 2.0), (4.0, cell - 2.0), (cell - 2.0, 4.0)]]
    )
    rows, columns = np.meshgrid(np.arange(cell), np.arange(cell), indexing="ij")
    centers = np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5], axis=1)
    lower = centers.sum(axis=1) <= cell
    where, owners, weights, uv = [], [], [], []
    for k in range(count):
        half = k % 2
        origin = np.array([(k // 2) % across, (k // 2) // across]) * cell
        mine = lower if half == 0 else ~lower
        spots = centers[mine]
        a, b, c = corners[half]
        shares = np.linalg.solve(np.stack([b - a, c - a], axis=1), (spots - a).T).T
        # A pixel beyond an edge takes the color of the edge.
        s = np.clip(shares, 0.0, 1.0)
        s = s / np.maximum(s.sum(axis=1, keepdims=True), 1.0)
        weights.append(np.column_stack([1.0 - s.sum(axis=1), s]))
        pixels = np.floor(spots).astype(int) + origin
        where.append(pixels[:, ::-1])
        owners.append(np.full(len(spots), k))
        at = (corners[half] + origin) / ATLAS
        uv.append(np.column_stack([at[:, 0], 1.0 - at[:, 1]]))
    return np.concatenate(where), np.concatenate(owners), np.concatenate(weights), np.concatenate(uv)


def _single(vertices: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray((np.round(vertices, 7) + 0.0).astype(np.float32))


def _index(faces: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(faces.astype(np.int32))
