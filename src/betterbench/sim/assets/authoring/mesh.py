"""Triangle meshes made from rings of points. All procedural shapes are built from such meshes.

A loft connects rings of points by strips of triangles. Solids of revolution, beveled boxes, swept tubes and takeaway
boxes are all lofts. Vertices are shared on round surfaces and duplicated at edges. A renderer that averages normals
over shared vertices therefore shows both correctly. All lengths are in meters, and all coordinates are in the object's
frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

FRONT = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Directions of a texture's columns and rows for :func:`mapped`, if the texture is on the front of an object, which
faces +x."""

ABOVE = ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
"""Directions of a texture's columns and rows for :func:`mapped`, if the texture is on the top of an object whose front
faces +x."""

# vertices that agree to this number of decimals [m] are merged, so that rounding errors do not matter
_DECIMALS = 7


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangle mesh with texture coordinates.

    Attributes:
        vertices: (n, 3) float64 positions [m].
        faces: (m, 3) int32 vertex indices, counterclockwise when seen from outside.
        uv: (n, 2) float64 texture coordinates, with the origin at the lower left of the texture.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Mesh:
        """Return the mesh translated by (x, y, z) [m]."""
        return Mesh(self.vertices + np.array([x, y, z]), self.faces, self.uv)

    def scaled_across(self, factor: np.ndarray) -> Mesh:
        """Return the mesh with the x and y coordinates of each vertex multiplied by ``factor`` (n,)."""
        return Mesh(self.vertices * np.stack([factor, factor, np.ones_like(factor)], axis=1), self.faces, self.uv)

    def seen_from_above(self, radius: float, share: np.ndarray | float = 0.5) -> Mesh:
        """Return the mesh with a texture that is projected from above. The edge of the texture is at ``radius`` [m].

        ``share`` (n,) stretches the texture at each vertex: a vertex at horizontal distance r from the axis is shown at
        the distance ``share * r / radius`` from the center of the texture. At 0.5, the texture is not stretched.
        """
        return Mesh(self.vertices, self.faces, 0.5 + np.reshape(share, (-1, 1)) * self.vertices[:, :2] / radius)

    def domed(self, radius: float, top: float, rise: float) -> Mesh:
        """Return the mesh of a dome with a texture projected from above, stretched outward where the dome is steep.

        The highest point of the dome is at height ``top``, and its edge is lower by ``rise`` [m].
        """
        distance = np.hypot(self.vertices[:, 0], self.vertices[:, 1])
        below = np.clip((top - self.vertices[:, 2]) / rise, 0.0, 1.0)
        reach = np.hypot(distance / radius, 0.75 * below) / math.hypot(1.0, 0.75)
        return self.seen_from_above(1.0, 0.5 * reach / np.maximum(distance, 1e-9))

    def hinged(self, angle: float, x: float, z: float) -> Mesh:
        """Return a mesh opened about its hinge by ``angle`` [rad], and moved so that the hinge is at (x, z) [m].

        Before the move, the hinge is at the origin and parallel to the y axis. A positive angle lifts the part of the
        mesh at +x.
        """
        return self.rotated("y", -angle).moved(x, 0.0, z)

    def rotated(self, axis: str, angle: float) -> Mesh:
        """Return the mesh rotated by ``angle`` [rad] about the object's "x", "y" or "z" axis."""
        c, s = math.cos(angle), math.sin(angle)
        matrices = {
            "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }
        return Mesh(self.vertices @ np.array(matrices[axis], dtype=float).T, self.faces, self.uv)


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """Combine several meshes into one mesh with all their triangles."""
    offsets = np.cumsum([0, *(len(m.vertices) for m in meshes[:-1])])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + o for m, o in zip(meshes, offsets, strict=True)]).astype(np.int32),
        np.concatenate([m.uv for m in meshes]),
    )


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the outward normals of triangles as an (m, 3) array.

    The length of a normal is twice the triangle's area [m^2].
    """
    a, b, c = vertices[faces].transpose(1, 2, 0)
    (ux, uy, uz), (vx, vy, vz) = b - a, c - a
    # # This is ten times as fast as numpy.cross for a hundred triangles and gives bit-identical results.
    return np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=-1)


def _welded(mesh: Mesh) -> tuple[Mesh, np.ndarray]:
    """Merge vertices with equal positions and texture coordinates, and drop triangles that then have zero area.

    Returns:
        The merged mesh and its :func:`face_normals`.
    """
    # numpy.unique with an axis takes three times as long as this sort, with the same result
    key = np.round(np.hstack([mesh.vertices, mesh.uv]), _DECIMALS) + 0.0
    order = np.lexsort(key.T[::-1])
    key = key[order]
    first = np.ones(len(key), dtype=bool)
    (key[1:] != key[:-1]).any(axis=1, out=first[1:])
    unique, inverse = key[first], np.empty(len(key), dtype=np.intp)
    inverse[order] = np.cumsum(first) - 1
    faces = inverse[mesh.faces]
    normals = face_normals(unique[:, :3], faces)
    kept = np.linalg.norm(normals, axis=1) > 1e-10
    faces, normals = faces[kept], normals[kept]
    used, faces = _renumbered(faces, len(unique))
    return Mesh(unique[used, :3], faces.astype(np.int32), unique[used, 3:]), normals


def _renumbered(numbers: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Renumber the integers in an array without gaps. All of them must be below ``count``.

    Returns:
        The sorted unique elements, and an array of the same shape with the rank of each element among them.
    """
    used = np.zeros(count, dtype=bool)
    used[numbers] = True
    return np.flatnonzero(used), (np.cumsum(used) - 1)[numbers]


def creased(mesh: Mesh, degrees: float = 40.0) -> Mesh:
    """Weld a mesh, and then split it along sharp edges, where two faces meet at an angle above ``degrees``."""
    mesh, normals = _welded(mesh)
    # corner c is vertex c % 3 of face c // 3; corners at one vertex are merged again if smooth edges connect them
    corners = mesh.faces.reshape(-1)
    joined = _last_joined(mesh, normals, math.cos(math.radians(degrees)))
    last, group = _renumbered(joined, len(corners))
    order = np.lexsort((last, corners[last]))
    number = np.empty(len(last), dtype=np.int32)
    number[order] = np.arange(len(last), dtype=np.int32)
    source = corners[last[order]]
    return Mesh(mesh.vertices[source], number[group].reshape(-1, 3), mesh.uv[source])


def _last_joined(mesh: Mesh, normals: np.ndarray, limit: float) -> np.ndarray:
    """Group the triangle corners at each vertex: corners that are connected by smooth edges belong to the same group.

    An edge is smooth if the cosine of the angle between the ``normals`` of its two faces is above ``limit``.

    Returns:
        For each of the 3 m triangle corners, the index of the last corner in its group, as a (3 m,) array.
    """
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    # each face edge is a pair of corners, smaller vertex first; sorting makes equal edges adjacent
    corners = np.arange(mesh.faces.size).reshape(-1, 3)
    here, there = corners.reshape(-1), corners[:, [1, 2, 0]].reshape(-1)
    vertices = mesh.faces.reshape(-1).astype(np.int64)
    one, other = vertices[here], vertices[there]
    ends = np.where(one <= other, (here, there), (there, here))
    edge = np.minimum(one, other) * len(mesh.vertices) + np.maximum(one, other)
    order = np.argsort(edge, kind="stable")
    ends, edge = ends[:, order], edge[order]
    joined = [np.empty((2, 0), dtype=int)]
    for away in range(1, len(edge)):
        equal = np.flatnonzero(edge[:-away] == edge[away:])
        if not equal.size:
            break
        a, b = ends[:, equal], ends[:, equal + away]
        smooth = np.sum(normals[a[0] // 3] * normals[b[0] // 3], axis=1) > limit
        joined += [np.stack([a[0, smooth], b[0, smooth]]), np.stack([a[1, smooth], b[1, smooth]])]
    first, second = np.concatenate(joined, axis=1)
    last = np.arange(mesh.faces.size)
    while True:
        one, other = last[first], last[second]
        if (one == other).all():
            return last
        np.maximum.at(last, np.minimum(one, other), np.maximum(one, other))
        while ((further := last[last]) != last).any():
            last = further


def loft(
    rings: Sequence[np.ndarray] | np.ndarray,
    *,
    u: np.ndarray | None = None,
    v: Sequence[float] | None = None,
    caps: tuple[bool, bool] = (True, True),
) -> Mesh:
    """Connect closed rings of points by strips of triangles. The resulting mesh is neither welded nor creased.

    Args:
        rings: Arrays (n, 3) of points [m], all of the same length. The cross product of the direction along a ring and
            the direction to the next ring must point outward.
        u: (n,) horizontal texture coordinate of each point of a ring. If None, it is 0.5 everywhere.
        v: Vertical texture coordinate of each ring. If None, it is 0.5 everywhere.
        caps: Whether to close the first and the last ring by a fan of triangles around its center.
    """
    points = np.asarray(rings, dtype=float)
    n_rings, n = points.shape[:2]
    columns = np.full(n, 0.5) if u is None else np.asarray(u, dtype=float)
    rows = np.full(n_rings, 0.5) if v is None else np.asarray(v, dtype=float)
    vertices = [points.reshape(-1, 3)]
    uv = [np.stack([np.tile(columns, n_rings), np.repeat(rows, n)], axis=1)]
    i = np.arange(n)
    j = (i + 1) % n
    strip = np.array([(i, j, n + j), (i, n + j, n + i)]).transpose(0, 2, 1).reshape(-1, 3)
    faces = [(n * np.arange(n_rings - 1)[:, None, None] + strip).reshape(-1, 3)]
    count = n_rings * n
    for ring, wanted in ((0, caps[0]), (n_rings - 1, caps[1])):
        if not wanted:
            continue
        vertices.append(points[ring].mean(axis=0, keepdims=True))
        uv.append(np.array([[columns.mean(), rows[ring]]]))
        edge = ring * n
        fan = [np.full(n, count), edge + j, edge + i] if ring == 0 else [np.full(n, count), edge + i, edge + j]
        faces.append(np.stack(fan, axis=1))
        count += 1
    return Mesh(np.concatenate(vertices), np.concatenate(faces).astype(np.int32), np.concatenate(uv))


def mirrored_u(n: int, *, start: int = 0) -> np.ndarray:
    """Return texture coordinates that rise from 0 to 1 along one half of a ring, and fall back to 0 along the other.

    A print that is painted on one half of the circumference then appears on both halves, without a visible seam. The
    number of points ``n`` must be even.
    """
    index = (np.arange(n) - start) % n
    return 1.0 - np.abs(index / (n / 2) - 1.0)


def circle(radius: float, z: float, segments: int, *, phase: float = 0.0) -> np.ndarray:
    """Return (segments, 3) points on a horizontal circle, counterclockwise from the x axis."""
    points: np.ndarray = _circles([(radius, z)], segments, phase)[0]
    return points


def _circles(profile: Sequence[tuple[float, float]], segments: int, phase: float) -> np.ndarray:
    """Return one :func:`circle` for each point (radius, height) of a profile, as an (n, segments, 3) array."""
    angle = phase + 2.0 * math.pi * np.arange(segments) / segments
    radii, heights = np.asarray(profile, dtype=float).T[:, :, None]
    points = np.empty((len(profile), segments, 3))
    points[..., 0], points[..., 1], points[..., 2] = radii * np.cos(angle), radii * np.sin(angle), heights
    return points


def lathe(
    profile: Sequence[tuple[float, float]],
    segments: int,
    *,
    crease_degrees: float = 40.0,
    wrap: bool = False,
    phase: float = 0.0,
) -> Mesh:
    """Return the creased mesh of a profile that is revolved about the vertical axis (see :class:`Turned`).

    The vertical texture coordinate is the distance along the profile (see :func:`profile_length`) as a fraction of the
    whole length. If ``wrap`` is True, the horizontal texture coordinates are those of :func:`mirrored_u`.
    """
    length = profile_length(profile)
    rings = _circles(profile, segments, phase)
    u = mirrored_u(segments) if wrap else None
    return creased(loft(rings, u=u, v=length / length[-1], caps=(False, False)), crease_degrees)


def profile_length(profile: Sequence[tuple[float, float]]) -> np.ndarray:
    """Return the distance along the profile [m] from its first point to each of its points."""
    steps = np.linalg.norm(np.diff(np.asarray(profile, dtype=float), axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def rectangle(half_x: float, half_y: float, z: float, *, corner: float = 0.0, steps: int = 1) -> np.ndarray:
    """Return the (n, 3) points [m] of a horizontal rectangle at height ``z``, in counterclockwise order.

    If ``corner`` is above 0, each corner is rounded with this radius, using ``steps`` segments. A single segment gives
    a chamfer.
    """
    if corner <= 0.0:
        corners = [(half_x, -half_y), (half_x, half_y), (-half_x, half_y), (-half_x, -half_y)]
        return np.array([(x, y, z) for x, y in corners])
    points = []
    for quarter, (sx, sy) in enumerate(((1, -1), (1, 1), (-1, 1), (-1, -1))):
        for step in range(steps + 1):
            angle = math.pi / 2.0 * (quarter - 1 + step / steps)
            x, y = sx * (half_x - corner), sy * (half_y - corner)
            points.append((x + corner * math.cos(angle), y + corner * math.sin(angle), z))
    return np.array(points)


def box(
    size: tuple[float, float, float],
    center: tuple[float, float, float],
    *,
    bevel: float = 0.0,
    corner: float = 0.0,
    steps: int = 1,
) -> Mesh:
    """Return a creased box.

    Its horizontal edges are beveled by ``bevel`` [m], and its vertical edges are rounded with the radius ``corner``
    [m], in ``steps`` segments each.
    """
    hx, hy, hz = (0.5 * s for s in size)
    heights = [(-hz, bevel), (-hz + bevel, 0.0), (hz - bevel, 0.0), (hz, bevel)] if bevel > 0.0 else [(-hz, 0), (hz, 0)]
    rings = [rectangle(hx - e, hy - e, z, corner=max(corner - e, 0.3 * corner), steps=steps) for z, e in heights]
    return creased(_flat_caps(rings), 50.0 if bevel > 0.0 or corner > 0.0 else 30.0).moved(*center)


def span(
    x: tuple[float, float],
    half_y: float,
    z: tuple[float, float],
    *,
    bevel: float = 0.0,
    corner: float = 0.0,
    steps: int = 1,
) -> Mesh:
    """Return a :func:`box` that is symmetric about y = 0.

    It extends between the two given positions in x and between the two given heights in z [m].
    """
    size, center = (x[1] - x[0], 2.0 * half_y, z[1] - z[0]), (0.5 * (x[0] + x[1]), 0.0, 0.5 * (z[0] + z[1]))
    return box(size, center, bevel=bevel, corner=corner, steps=steps)


def _flat_caps(rings: Sequence[np.ndarray]) -> Mesh:
    """Loft convex rings, and close both ends without adding a center point."""
    side = loft(rings, caps=(False, False))
    n = len(rings[0])
    last = (len(rings) - 1) * n
    i = np.arange(1, n - 1)
    bottom = np.stack([np.zeros_like(i), i + 1, i], axis=1)
    top = np.stack([np.full_like(i, last), last + i, last + i + 1], axis=1)
    return Mesh(side.vertices, np.concatenate([side.faces, bottom, top]).astype(np.int32), side.uv)


def prism(rings: Sequence[np.ndarray], *, crease_degrees: float = 40.0) -> Mesh:
    """Return the creased loft of convex rings. Both ends are closed with as few triangles as possible."""
    return creased(_flat_caps(rings), crease_degrees)


def sweep(
    x: Sequence[float], z: Sequence[float], section: Sequence[tuple[float, float]], *, crease_degrees: float = 40.0
) -> Mesh:
    """Return the closed mesh that results from moving a cross section along a path in the plane y = 0.

    The path is given by the x coordinates and the heights of its points [m]. The points (a, b) of the cross section [m]
    are in counterclockwise order: a is measured along y, and b along the normal of the path within the plane.
    """
    points = np.column_stack([x, np.zeros(len(x)), z])
    normal = np.array([0.0, 1.0, 0.0])
    steps = np.diff(points, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    rings = []
    for index, point in enumerate(points):
        before, after = steps[max(index - 1, 0)], steps[min(index, len(steps) - 1)]
        tangent = (before + after) / np.linalg.norm(before + after)
        across = np.cross(tangent, normal)
        # widen the section at a corner, so that the tube has the same thickness on both sides
        stretch = 1.0 / max(float(tangent @ after), 0.5)
        rings.append(np.array([point + a * normal + b * stretch * across for a, b in section]))
    return creased(_flat_caps(rings), crease_degrees)


def chamfered(half_width: float, low: float, high: float, chamfer: float) -> list[tuple[float, float]]:
    """Return the eight points (across, up) of a rectangle with cut corners [m], counterclockwise when seen from +x."""
    w, c = half_width, chamfer
    right = [(w, low + c), (w, high - c), (w - c, high)]
    return [*right, (-w + c, high), (-w, high - c), (-w, low + c), (-w + c, low), (w - c, low)]


def rod(
    stations: Sequence[tuple[float, float, float, float]],
    *,
    chamfer: float = 0.0,
    y: float = 0.0,
    crease_degrees: float = 32.0,
) -> Mesh:
    """Return a rod along x, lofted from upright rectangles that are all centered at ``y`` [m]. Its ends are closed.

    Each station gives the x coordinate, half the width, the bottom and the top of one rectangle [m]. The corners of the
    rectangles are cut by ``chamfer``, or by less if the rectangle is small.
    """
    rings = []
    for x, w, low, high in stations:
        c = min(chamfer, 0.6 * w, 0.35 * (high - low))
        outline = chamfered(w, low, high, c) if c > 0.0 else [(w, low), (w, high), (-w, high), (-w, low)]
        rings.append(np.array([(x, y + a, b) for a, b in outline]))
    return prism(rings, crease_degrees=crease_degrees)


def slab(x: Sequence[float], z: Sequence[float], half_y: float, *, bevel: float) -> Mesh:
    """Return a plate with beveled rims, given the x and z coordinates of each point of its convex side view [m].

    The points are in counterclockwise order.
    """
    points = np.column_stack([x, z])
    center = points.mean(axis=0)
    away = points - center
    reach = np.linalg.norm(away, axis=1, keepdims=True)
    inner = center + away * np.maximum(1.0 - 1.2 * bevel / reach, 0.5)
    sides = ((half_y, inner), (half_y - bevel, points), (-half_y + bevel, points), (-half_y, inner))
    rings = [np.column_stack([flat[:, 0], np.full(len(flat), y), flat[:, 1]]) for y, flat in sides]
    return prism(rings, crease_degrees=35.0)


def tube_section(radius: float, sides: int) -> list[tuple[float, float]]:
    """Return the points of a circular cross section for :func:`sweep`."""
    angles = [2.0 * math.pi * k / sides for k in range(sides)]
    return [(radius * math.cos(a), radius * math.sin(a)) for a in angles]


def mapped(mesh: Mesh, right: tuple[float, float, float], up: tuple[float, float, float]) -> Mesh:
    """Project a texture onto a mesh, with the texture's columns along ``right`` and its rows along ``up``."""
    flat = np.stack([mesh.vertices @ np.array(right), mesh.vertices @ np.array(up)], axis=1)
    low, high = flat.min(axis=0), flat.max(axis=0)
    return Mesh(mesh.vertices, mesh.faces, (flat - low) / (high - low))
