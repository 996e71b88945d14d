"""Mesh decimation that keeps closed meshes closed, and shading normals that follow the edges of a mesh.

Edges are collapsed in the order of the quadric error metric, the cheapest first (M. Garland, P. S. Heckbert, "Surface
Simplification Using Quadric Error Metrics", SIGGRAPH 1997). Collapses that would flip a triangle, create a sliver, or
connect separate sheets are skipped, which avoids flaps and holes. Open borders are held in place by additional planes
perpendicular to the border triangles. The order of collapses depends only on the arrays, so every machine creates the
same mesh from the same input.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

import numpy as np

Point = tuple[float, float, float]
Quadric = list[float]

_BORDER_WEIGHT = 30.0
"""Weight of the border planes relative to the face planes.

Because of this high weight, a vertex can move along the border but hardly away from it.
"""

_LEAST_COSINE = 0.35
"""Cosine of the largest angle by which one collapse may rotate a triangle, about 70 degrees."""

_LEAST_SHAPE = 0.02
"""Minimum shape quality of a triangle.

The quality is the area of the triangle divided by the area of an equilateral triangle with the same longest side.
"""


def welded(vertices: np.ndarray, faces: np.ndarray, tolerance_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Merge all vertices that lie in the same cell of a grid, and drop degenerate and duplicate triangles.

    Returns:
        Vertices (n, 3) float64 [m], all of which are used, and faces (m, 3) int64.
    """
    cells = np.round(np.asarray(vertices, dtype=np.float64) / tolerance_m).astype(np.int64)
    _, first, inverse = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    joined = inverse.reshape(-1)[faces]
    a, b, c = joined.T
    joined = joined[(a != b) & (b != c) & (c != a)]
    _, once = np.unique(np.sort(joined, axis=1), axis=0, return_index=True)
    joined = joined[np.sort(once)]
    used, renumbered = np.unique(joined, return_inverse=True)
    return np.asarray(vertices, dtype=np.float64)[first][used], renumbered.reshape(-1, 3).astype(np.int64)


def creased(vertices: np.ndarray, faces: np.ndarray, degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """Split vertices at which faces meet at an angle larger than ``degrees``.

    A renderer that averages the normals of the faces around a vertex then draws sharp edges and smooth round surfaces.
    """
    a, b, c = vertices[faces].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)
    limit = math.cos(math.radians(degrees))
    fans: list[list[int]] = [[] for _ in vertices]
    for number, triangle in enumerate(faces.tolist()):
        for vertex in triangle:
            fans[vertex].append(number)
    corners = [set(triangle) for triangle in faces.tolist()]
    result = faces.copy()
    source: list[int] = []
    for vertex, fan in enumerate(fans):
        groups: list[list[int]] = []
        for face in fan:
            near = [
                group
                for group in groups
                if any(len(corners[face] & corners[o]) >= 2 and normals[face] @ normals[o] > limit for o in group)
            ]
            groups = [group for group in groups if group not in near] + [[face, *(f for g in near for f in g)]]
        for group in groups:
            for face in group:
                result[face][faces[face] == vertex] = len(source)
            source.append(vertex)
    return vertices[source], result


def decimated(
    pieces: Sequence[tuple[np.ndarray, np.ndarray]], weights: Sequence[float], target: int
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Decimate meshes to ``target`` triangles in total, or to more triangles if no further edge may be collapsed.

    Pieces with more detail keep more triangles, because the edges of all pieces share one queue.

    Args:
        pieces: Welded vertex positions (n, 3) [m] and vertex indices of the triangles (m, 3), for each piece.
        weights: Relative weight of shape errors in each piece.
        target: Number of triangles at which to stop.

    Returns:
        The decimated pieces, in the same form.
    """
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in pieces)])
    owner = np.repeat(np.arange(len(pieces)), np.diff(starts))
    faces = np.concatenate([f + start for (_, f), start in zip(pieces, starts, strict=False)])
    mesh = _Collapsing(np.concatenate([v for v, _ in pieces]), faces, np.asarray(weights, dtype=float)[owner])
    mesh.run(target)
    points, left = mesh.arrays()
    results = []
    for number in range(len(pieces)):
        used, renumbered = np.unique(left[owner[left[:, 0]] == number], return_inverse=True)
        results.append((points[used], renumbered.reshape(-1, 3)))
    return results


class _Collapsing:
    """Mesh during the collapse of its edges."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, weights: np.ndarray) -> None:
        # Coordinates are in millimeters here, so that squared lengths do not become too small.
        self._points: list[Point] = [(x, y, z) for x, y, z in (1e3 * np.asarray(vertices, dtype=float)).tolist()]
        self._faces: list[list[int] | None] = [list(f) for f in np.asarray(faces).tolist()]
        self._count = len(self._faces)
        self._around: list[set[int]] = [set() for _ in self._points]
        for number, face in enumerate(self._faces):
            for vertex in face or ():
                self._around[vertex].add(number)
        self._quadrics = _quadrics(np.array(self._points), np.asarray(faces), weights)
        self._stamp = [0] * len(self._points)
        self._heap: list[tuple[float, int, int, int, int, Point]] = []
        edges = {
            (min(a, b), max(a, b)) for f in np.asarray(faces).tolist() for a, b in zip(f, f[1:] + f[:1], strict=True)
        }
        for a, b in sorted(edges):
            self._push(a, b)

    def run(self, target: int) -> None:
        """Collapse the cheapest edges until the target number of triangles is reached or no edge is left."""
        while self._count > target and self._heap:
            _, a, b, stamp_a, stamp_b, place = heapq.heappop(self._heap)
            if self._stamp[a] == stamp_a and self._stamp[b] == stamp_b and self._allowed(a, b, place):
                self._collapse(a, b, place)

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Return all vertices [m], including unused ones, and the remaining faces."""
        faces = np.array([f for f in self._faces if f is not None], dtype=np.int64).reshape(-1, 3)
        return 1e-3 * np.array(self._points), faces

    def _push(self, a: int, b: int) -> None:
        """Add an edge to the queue, with the best position for the vertex that would replace it."""
        q = [s + t for s, t in zip(self._quadrics[a], self._quadrics[b], strict=True)]
        pa, pb = self._points[a], self._points[b]
        middle = (0.5 * (pa[0] + pb[0]), 0.5 * (pa[1] + pb[1]), 0.5 * (pa[2] + pb[2]))
        places = [pa, pb, middle]
        best = _minimum(q)
        if best is not None and math.dist(best, middle) <= math.dist(pa, pb):
            places.append(best)
        costs = [_error(q, place) for place in places]
        # Among edges without cost, which occur on flat faces, the shorter edge is collapsed first.
        cost = min(costs)
        entry = (max(cost, 0.0) + 1e-6 * math.dist(pa, pb) ** 2, a, b, self._stamp[a], self._stamp[b])
        heapq.heappush(self._heap, (*entry, places[costs.index(cost)]))

    def _neighbors(self, vertex: int) -> set[int]:
        """Return the vertices that share an edge with the given vertex."""
        found: set[int] = set()
        for number in self._around[vertex]:
            found.update(self._faces[number] or ())
        found.discard(vertex)
        return found

    def _allowed(self, a: int, b: int, place: Point) -> bool:
        """Return whether collapsing the edge keeps the surface manifold and does not flip a triangle."""
        shared = self._around[a] & self._around[b]
        if not 1 <= len(shared) <= 2:
            return False
        # Link condition: the ends of the edge have no common neighbors except in the triangles to be removed.
        if len(self._neighbors(a) & self._neighbors(b)) != len(shared):
            return False
        if len(shared) == 2 and self._on_border(a) and self._on_border(b):
            return False
        for vertex in (a, b):
            for number in self._around[vertex] - shared:
                face = self._faces[number] or [0, 0, 0]
                before = [self._points[v] for v in face]
                after = [place if v == vertex else self._points[v] for v in face]
                if not _keeps(before, after):
                    return False
        return True

    def _on_border(self, vertex: int) -> bool:
        """Return whether a vertex is on a border, i.e. has an edge with only one triangle."""
        seen: dict[int, int] = {}
        for number in self._around[vertex]:
            for other in self._faces[number] or ():
                if other != vertex:
                    seen[other] = seen.get(other, 0) + 1
        return any(times == 1 for times in seen.values())

    def _collapse(self, a: int, b: int, place: Point) -> None:
        """Collapse the edge: move ``a`` to the new position, and replace ``b`` by ``a`` in all triangles."""
        for number in self._around[a] & self._around[b]:
            for vertex in self._faces[number] or ():
                self._around[vertex].discard(number)
            self._faces[number] = None
            self._count -= 1
        for number in self._around[b]:
            self._faces[number] = [a if v == b else v for v in self._faces[number] or ()]
        self._around[a] |= self._around[b]
        self._around[b] = set()
        self._points[a] = place
        self._quadrics[a] = [s + t for s, t in zip(self._quadrics[a], self._quadrics[b], strict=True)]
        self._stamp[a] += 1
        self._stamp[b] = -1
        for other in sorted(self._neighbors(a)):
            self._push(min(a, other), max(a, other))


def _quadrics(points: np.ndarray, faces: np.ndarray, weights: np.ndarray) -> list[Quadric]:
    """Return the quadric of each vertex (ten numbers), from the area-weighted planes of its faces and borders.

    Each quadric is multiplied by the weight of its vertex. ``weights`` has the shape (n,).
    """
    a, b, c = points[faces].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    double = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    normals /= double[:, None]
    total = np.zeros((len(points), 10))
    numbers = _plane(normals, a) * (0.5 * double)[:, None]
    for corner in range(3):
        np.add.at(total, faces[:, corner], numbers)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner = np.tile(np.arange(len(faces)), 3)
    _, inverse, times = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    lone = times[inverse.reshape(-1)] == 1
    start, end = points[edges[lone, 0]], points[edges[lone, 1]]
    across = np.cross(end - start, normals[owner[lone]])
    length = np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    numbers = _plane(across / length, start) * (_BORDER_WEIGHT * length**2)
    for corner in range(2):
        np.add.at(total, edges[lone, corner], numbers)
    quadrics: list[Quadric] = (total * weights[:, None]).tolist()
    return quadrics


def _plane(normals: np.ndarray, through: np.ndarray) -> np.ndarray:
    """Return the quadrics (n, 10) of planes with unit normals (n, 3) through points (n, 3)."""
    x, y, z = normals.T
    d = -np.einsum("ij,ij->i", normals, through)
    return np.stack([x * x, x * y, x * z, x * d, y * y, y * z, y * d, z * z, z * d, d * d], axis=1)


def _error(q: Quadric, p: Point) -> float:
    """Return the error of a quadric at a point."""
    x, y, z = p
    return (
        x * (q[0] * x + 2.0 * (q[1] * y + q[2] * z + q[3]))
        + y * (q[4] * y + 2.0 * (q[5] * z + q[6]))
        + z * (q[7] * z + 2.0 * q[8])
        + q[9]
    )


def _minimum(q: Quadric) -> Point | None:
    """Return the point at which a quadric has its smallest error.

    Return None if this point is poorly determined, because the surface is flat or straight there.
    """
    a, b, c, d, e, f, g, h, i, _ = q
    m0, m1, m2 = e * h - f * f, c * f - b * h, b * f - c * e
    determinant = a * m0 + b * m1 + c * m2
    scale = a + e + h
    if determinant <= 1e-4 * scale**3:
        return None
    k11, k12, k22 = a * h - c * c, b * c - a * f, a * e - b * b
    x = -(m0 * d + m1 * g + m2 * i) / determinant
    y = -(m1 * d + k11 * g + k12 * i) / determinant
    z = -(m2 * d + k12 * g + k22 * i) / determinant
    return (x, y, z)


def _keeps(before: list[Point], after: list[Point]) -> bool:
    """Return whether a triangle keeps its orientation and does not become a sliver when one of its corners moves."""
    n, m = _normal(before), _normal(after)
    size_n, size_m = math.hypot(*n), math.hypot(*m)
    longest = max(math.dist(after[0], after[1]), math.dist(after[1], after[2]), math.dist(after[2], after[0]))
    if size_m < _LEAST_SHAPE * longest * longest:
        # A sliver may stay a sliver, or improve.
        was = max(math.dist(before[0], before[1]), math.dist(before[1], before[2]), math.dist(before[2], before[0]))
        if size_n * longest * longest > size_m * was * was:
            return False
    if size_n < 1e-9:
        return True
    return n[0] * m[0] + n[1] * m[1] + n[2] * m[2] > _LEAST_COSINE * size_n * size_m


def _normal(corners: list[Point]) -> Point:
    """Return the normal of a triangle. Its length is twice the area of the triangle."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    return (uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx)
