"""Measurements of a finished asset, such as gaps between its parts, or how much back-facing surface is visible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

from betterbench.geometry import rotate
from betterbench.sim.assets.asset import Asset, CollisionPart
from betterbench.sim.assets.importing.cavity import Cavity
from betterbench.sim.assets.importing.hulls import distances_to, inside_hull, surface_points
from betterbench.sim.assets.importing.solid import Solid, solid_of, spread

_TURNS = 32
"""Number of sides of the prism that replaces a cylinder. With 32, the sides deviate from the circle by 0.5 % of its
radius."""
_RAYS = 48
"""Width of the images used to find back-facing surfaces [pixel]."""
_VIEWS = 8
_MOST_POINTS = 12_000
"""Maximum number of points on the visible surface whose distances are measured. This is enough for a percentile."""


_LINK_CELLS = 2.5
"""Maximum distance between neighboring points of a patch [cells]."""


@dataclass(frozen=True, slots=True)
class Distances:
    """Distances between the collision parts and the visible surface, as 95th percentiles over points [m].

    Attributes:
        outside_m: Distance of points on the collision parts from the visible surface. If it is large, other objects
            collide with visibly empty space.
        inside_m: Distance of points on the visible surface from the collision parts. If it is large, other objects pass
            through visible parts.
        bare_share: Size of the largest connected patch of visible points that are far from all collision parts. The
            size is the volume of the patch's convex hull, as a fraction of the convex hull of the whole object.
    """

    outside_m: float
    inside_m: float
    bare_share: float


def visual_surface(asset: Asset) -> tuple[np.ndarray, np.ndarray]:
    """Return the visual parts of an asset as one surface: (n, 3) vertices [m] and (m, 3) vertex indices."""
    starts = np.cumsum([0, *(len(part.vertices) for part in asset.visual)])
    vertices = np.concatenate([np.asarray(part.vertices, dtype=np.float64) for part in asset.visual])
    faces = np.concatenate([part.faces + start for part, start in zip(asset.visual, starts, strict=False)])
    return vertices, np.asarray(faces, dtype=np.int64)


def corners_of(part: CollisionPart) -> np.ndarray:
    """Return (n, 3) points in the object's frame [m] whose convex hull is approximately the given collision part."""
    a, b, c = part.size
    if part.shape == "hull":
        if part.vertices is None:
            raise ValueError("a collision hull has no vertices")
        points = np.asarray(part.vertices, dtype=np.float64)
    elif part.shape == "box":
        points = np.array([(x, y, z) for x in (-a, a) for y in (-b, b) for z in (-c, c)])
    elif part.shape == "cylinder":
        turn = np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False)
        ring = np.stack([a * np.cos(turn), a * np.sin(turn)], axis=1)
        points = np.concatenate([np.column_stack([ring, np.full(_TURNS, z)]) for z in (-b, b)])
    else:
        ball = _ball()
        radii = (a, b, c) if part.shape == "ellipsoid" else (a, a, a)
        points = ball * radii
        if part.shape == "capsule":
            points = np.concatenate([np.add(points, (0.0, 0.0, b)), np.subtract(points, (0.0, 0.0, b))])
    turned = np.array([rotate(part.quaternion, axis) for axis in np.eye(3).tolist()])
    return np.asarray(points @ turned + part.position)


def _ball() -> np.ndarray:
    k = np.arange(200) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / 200), np.pi * (1.0 + 5.0**0.5) * k
    return np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)


def convex_surface(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the surface of the convex hull of points as a triangle mesh.

    Returns:
        (n, 3) vertices and (m, 3) vertex indices, counterclockwise when seen from outside.
    """
    hull = ConvexHull(corners)
    faces = hull.simplices.copy()
    a, b, c = (hull.points[faces[:, k]] for k in range(3))
    inward = np.einsum("kd,kd->k", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return hull.points, faces


def surface_solid(hulls: Sequence[np.ndarray]) -> Solid:
    """Return the volume that convex parts occupy, as a grid of cells.

    Args:
        hulls: Corners of each convex part, (n, 3) [m].
    """
    bodies = [ConvexHull(corners) for corners in hulls]
    starts = np.cumsum([0, *(len(body.points) for body in bodies)])
    faces = np.concatenate([body.simplices + start for body, start in zip(bodies, starts, strict=False)])
    return solid_of(np.concatenate([body.points for body in bodies]), faces)


def collision_distances(
    hulls: Sequence[np.ndarray], solid: Solid, *, near_m: float, filled: Cavity | None = None
) -> Distances:
    """Measure the distances between the collision shape and the visual shape of an object.

    Args:
        hulls: Corners of each collision part, (n, 3) [m].
        solid: Solid of the visible surface.
        near_m: Distance from the collision parts above which a visible point counts as far from them [m].
        filled: Hollow that the collision parts may fill, because no task puts anything into the object. None if there
            is no such hollow.
    """
    size = float(np.ptp(solid.points, axis=0).max())
    touched = surface_points(hulls, size / 60.0)
    seen = solid.points[:: max(1, len(solid.points) // _MOST_POINTS)]
    i, j, k = solid.index(touched).T
    hidden = solid.cells[i, j, k]  # points inside the visual shape cause no visibly wrong contact
    if filled is not None:
        hidden |= filled.mask[i, j] & (touched[:, 2] < filled.rim_m + 2.0 * solid.pitch_m)
    outside = distances_to(solid.points, touched, ~hidden)
    held = np.zeros(len(seen), dtype=bool)
    for corners in hulls:  # points inside a part have contact
        held |= inside_hull(ConvexHull(corners), seen, 0.0)
    inside = distances_to(touched, seen, ~held)
    free = size / 120.0  # a distance below the spacing of the points is zero
    bare = _largest_patch(seen[inside > near_m + free], _LINK_CELLS * solid.pitch_m) / _hull_volume(seen)
    outside_m, inside_m = (max(0.0, float(np.percentile(d, 95)) - free) for d in (outside, inside))
    return Distances(outside_m, inside_m, bare)


def _largest_patch(points: np.ndarray, reach: float) -> float:
    """Return the volume of the convex hull of the largest patch of points [m^3].

    Points (k, 3) belong to the same patch if they are within ``reach`` of each other [m].
    """
    if len(points) == 0:
        return 0.0
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    links = sparse.coo_matrix((np.ones(len(pairs), dtype=np.int8), pairs.T), shape=(len(points), len(points)))
    count, patch_of = connected_components(links, directed=False)
    return max(_hull_volume(points[patch_of == patch]) for patch in range(count))


def _hull_volume(points: np.ndarray) -> float:
    """Return the volume of the convex hull of points (k, 3) [m^3], or zero if the points are flat."""
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def depth_in_hull(point: Sequence[float] | np.ndarray, points: np.ndarray) -> float:
    """Return how deep a point (d,) lies inside the convex hull of points (k, d) [m].

    The depth is negative outside the hull.
    """
    try:
        equations = ConvexHull(points).equations
    except (QhullError, ValueError):
        return -np.inf
    return -float((equations[:, :-1] @ np.asarray(point) + equations[:, -1]).max())


def largest_gap(vertices: np.ndarray, faces: np.ndarray, *, spacing: float) -> float:
    """Return the largest gap [m] between separate parts of a surface, or zero if the surface is connected.

    Distances between parts are measured between points on their surfaces that are ``spacing`` apart [m]. The largest
    gap is the longest edge of the minimum spanning tree of the parts.
    """
    points, owners, _ = spread(vertices, faces, spacing)
    _, merged = np.unique(np.round(vertices / 1e-6), axis=0, return_inverse=True)
    corners = merged.ravel()[faces]
    edges = np.concatenate([corners[:, (0, 1)], corners[:, (1, 2)]])
    count = int(merged.max()) + 1
    graph = sparse.coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
    parts, of_vertex = connected_components(graph, directed=False)
    if parts == 1:
        return 0.0
    of_point = of_vertex[corners[:, 0]][owners]
    # Points in the same cell of this size are closer than the spacing, so there is no gap between their parts. Joining
    # such parts first keeps the number of pairs small: a wire basket of 1,200 triangles has hundreds of parts.
    cells = np.floor((points - points.min(axis=0)) / (spacing / np.sqrt(3.0))).astype(np.int64)
    _, of_cell = np.unique(cells @ np.array([1, 1 << 20, 1 << 40]), return_inverse=True)
    size = parts + int(of_cell.max()) + 1
    graph = sparse.coo_matrix((np.ones(len(of_point)), (of_point, parts + of_cell)), shape=(size, size))
    of_point = connected_components(graph, directed=False)[1][of_point]
    trees = {k: cKDTree(points[of_point == k]) for k in np.unique(of_point)}
    names = list(trees)
    joined, gap = {names[0]}, 0.0
    nearest = {k: _between(trees[k], trees[names[0]]) for k in names[1:]}
    while nearest:
        best = min(nearest, key=lambda k: nearest[k])
        gap = max(gap, nearest.pop(best))
        joined.add(best)
        for k, distance in nearest.items():
            if distance > gap:  # a distance up to `gap` can no longer change the result
                nearest[k] = min(distance, _between(trees[k], trees[best]))
    return max(0.0, gap - spacing)


def _between(one: cKDTree, other: cKDTree) -> float:
    small, large = (one, other) if one.n < other.n else (other, one)
    return float(large.query(small.data)[0].min())


def share_from_behind(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Return the fraction of an object's image in which the nearest surface faces away and would not be drawn.

    The fraction is the mean over eight views around the object, from 35 degrees above the horizon. Cameras usually see
    objects on a table from similar angles.
    """
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    points, owners, _ = spread(vertices, faces, size / (2.5 * _RAYS))
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    offsets = points - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    behind = total = 0
    for turn in 2.0 * np.pi * (np.arange(_VIEWS) + 0.5) / _VIEWS:
        down = np.radians(35.0)
        toward = np.array([np.cos(down) * np.cos(turn), np.cos(down) * np.sin(turn), np.sin(down)])
        right = np.array([-np.sin(turn), np.cos(turn), 0.0])
        upward = np.cross(toward, right)
        facing = (normals @ toward)[owners]
        usable = np.flatnonzero(np.abs(facing) > 0.1)  # a surface seen edge-on covers no pixel
        front = facing[usable] > 0.0
        offset = offsets[usable]
        # The two sides of a sheet have the same depth. In this case, the front side counts as the nearer one.
        near = offset @ toward + np.where(front, 0.01 * size, 0.0)
        column, row = (((offset @ axis) / size + 0.5) * _RAYS for axis in (right, upward))
        pixel = column.astype(int) * (_RAYS + 1) + row.astype(int)
        nearest = np.full((_RAYS + 1) ** 2, -np.inf)
        np.maximum.at(nearest, pixel, near)
        is_nearest = near == nearest[pixel]
        behind += len(np.unique(pixel[is_nearest & ~front]))
        total += int(np.isfinite(nearest).sum())
    return behind / max(total, 1)


def degenerate_share(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Return the fraction of triangles that have practically no area.

    These are triangles with two equal corners, and triangles that are thinner than a thousandth of their length.
    """
    corners = vertices[faces]
    if not np.isfinite(corners).all():
        return 1.0
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    longest = sides.max(axis=1)
    return float((doubled <= 1e-3 * longest * longest + 1e-14).mean())
