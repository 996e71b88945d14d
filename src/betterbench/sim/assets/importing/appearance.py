"""Visual mesh of an imported object: few triangles, and one texture baked from the textures and colors in the file."""

from __future__ import annotations

from dataclasses import replace

import fast_simplification
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from betterbench.errors import InvalidInputError
from betterbench.sim.assets.asset import Texture, VisualPart
from betterbench.sim.assets.importing.raw import RawMesh, RawPart
from betterbench.sim.assets.importing.solid import spread, spread_points

FACE_BUDGET = 600
"""Maximum number of triangles per asset, limited because of the cost in software rendering."""
THIN_FACE_BUDGET = 1_200
"""Maximum number of triangles of a thin-walled asset. With only 600, it would have dents."""
WIRES_FACE_BUDGET = 2_400
"""Maximum number of triangles of an object that would lose parts, such as the hoops of a basket, with only 1,200."""
DENT_SHARE = 0.006
"""Distance between the reduced and the original surface above which dents are visible, as a fraction of the object's
longest side. At 600 triangles, YCB's plate, bowl, mug and sponge deviate visibly (by 0.7 to 1.9 %), whereas its apple,
can, banana and fork deviate by at most 0.5 %."""
LOST_SHARE = 0.02
"""Distance between the original and the reduced surface above which a part of the object (such as one bar of a wire
basket) counts as lost, as a fraction of the object's longest side."""
MOST_LOST = 0.1
"""Maximum fraction of the original surface that may be lost. Wire baskets and scans lose at most 0.1 %, whereas 320
loose blocks lose 66 %, and look like splinters."""
_BOX_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip
"""Triangles of a box with the corners of :func:`_box_of`, facing outward."""
ATLAS = 512
"""Side of the baked texture [pixel]."""
_PAINT_POINTS = 200_000
_MOST_POINTS = 300_000
_MOST_PLAIN_PARTS = 12
_SIDES_APART = 0.03
_AGGRESSION = 2.0
"""Growth rate of the tolerated error in the mesh reduction. The default of 7 crumples thin walls of scans."""


def visual_parts(mesh: RawMesh, where: str) -> tuple[VisualPart, ...]:
    """Return the visual parts of an object, reduced to a limited number of triangles.

    The limit is 600 triangles, 1,200 for thin-walled objects, and 2,400 for objects that would otherwise lose parts. If
    the mesh is below the limit and each of its parts has a single color, the parts are kept unchanged. Otherwise, the
    whole surface becomes one reduced part with a new texture, in which each triangle has its own area.

    Args:
        mesh: The object.
        where: Name of its file, for error messages.

    Raises:
        InvalidInputError: If the object has so many parts that most of its surface would be lost.
    """
    plain = all(part.is_plain() for part in mesh.parts)
    if plain and mesh.face_count <= FACE_BUDGET:
        looks: dict[tuple[float, ...], list[RawPart]] = {}
        for part in mesh.parts:
            looks.setdefault(part.rgba, []).append(part)
        if len(looks) <= _MOST_PLAIN_PARTS:
            return tuple(_plain(f"part{k}", parts) for k, parts in enumerate(looks.values()))
    if plain and len({part.rgba for part in mesh.parts}) == 1:
        vertices, faces = _reduced_enough(*mesh.surface(), where)
        return (replace(_plain("part0", [RawPart("all", vertices, faces, mesh.parts[0].rgba)]), smooth=True),)
    return (_painted(mesh, where),)


def reduced(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Reduce a surface to at most ``count`` triangles, using quadric error metrics (Garland and Heckbert, 1997)."""
    if len(faces) <= count:
        return vertices, faces
    points, triangles = fast_simplification.simplify(
        np.ascontiguousarray(vertices, dtype=np.float32),
        np.ascontiguousarray(faces, dtype=np.int32),
        target_count=count,
        agg=_AGGRESSION,
    )
    if len(triangles) > count:  # non-manifold edges may end the first pass early
        points, triangles = fast_simplification.simplify(points, triangles, target_count=count, agg=10)
    return np.asarray(points, dtype=np.float64), np.asarray(triangles, dtype=np.int64)


def _without_needles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Remove needle-shaped triangles, i.e. triangles that are thinner than a thousandth of their length."""
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


def _painted(mesh: RawMesh, file: str) -> VisualPart:
    vertices, faces = _reduced_enough(*mesh.surface(), file)
    faces = _without_needles(vertices, faces)
    points, normals, colors = _colored_points(mesh)
    where, owners, weights, uv = _atlas(len(faces))
    at = np.einsum("kc,kcd->kd", weights, vertices[faces[owners]])
    # Add a penalty for differing normals to the distance, so that a point gets the color of its own side of a wall.
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


def _reduced_enough(vertices: np.ndarray, faces: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Reduce a surface to 600 triangles, to 1,200 if 600 would leave dents, or to 2,400 if parts would be lost."""
    if len(faces) <= FACE_BUDGET:
        return vertices, faces
    points, triangles = vertices, faces
    size = float(np.ptp(vertices, axis=0).max())
    before = spread_points(vertices, faces, size / 120.0, most=_MOST_POINTS)
    of_before: cKDTree | None = None
    lossy: cKDTree | None = None  # points of the reduced surface, if parts are lost
    for budget in (FACE_BUDGET, THIN_FACE_BUDGET):
        points, triangles = reduced(vertices, faces, budget)
        if len(triangles) == len(faces):
            return points, triangles
        after = spread_points(points, triangles, size / 120.0, most=_MOST_POINTS)
        of_after = _tree_of(after)
        lossy = of_after if _is_lost(before, of_after, size) else None
        if lossy is None:
            of_before = of_before or _tree_of(before)
            dent = max(_farthest(before, of_after), _farthest(after, of_before))
            if dent - size / 240.0 <= DENT_SHARE * size:  # subtract half the spacing of the sampled points
                return points, triangles
    if lossy is not None:
        for budget in (THIN_FACE_BUDGET, WIRES_FACE_BUDGET):
            whole = _reduced_parts(vertices, faces, budget)
            if whole is None:
                continue
            points, triangles = whole
            lossy = _tree_of(spread_points(points, triangles, size / 120.0, most=_MOST_POINTS))
            if not _is_lost(before, lossy, size):
                break
        lost = float(np.mean(lossy.query(before)[0] > LOST_SHARE * size))
        if lost > MOST_LOST:
            problem = (
                f"it has too many parts: of its {len(faces):,} triangles, {WIRES_FACE_BUDGET:,} may be kept, and "
                f"{round(100.0 * lost)} % of its surface would be missing"
            )
            raise InvalidInputError(
                where, problem, "Use a mesh editor to join its parts and remove the surfaces inside it"
            )
    return points, triangles


def _is_lost(before: np.ndarray, after: cKDTree, size: float) -> bool:
    """Return whether any point of the original surface is far from every point of the reduced surface."""
    # the search stops at the bound and returns infinity for larger distances
    bound = np.nextafter(LOST_SHARE * size, np.inf)
    return any(  # test a few points first, which suffice to find most lost parts
        np.isinf(after.query(some, distance_upper_bound=bound)[0]).any() for some in (before[::16], before)
    )


def _tree_of(points: np.ndarray) -> cKDTree:
    # An unbalanced tree is built in a third of the time and gives the same distances.
    return cKDTree(points, balanced_tree=False, compact_nodes=False)


def _reduced_parts(vertices: np.ndarray, faces: np.ndarray, budget: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Reduce the separate parts of a surface, such as the wires of a basket, one by one.

    A part that almost fills its bounding box is replaced by the box. The remaining triangles are divided among the
    other parts in proportion to their areas. Returns None if the surface has only one part, or so many parts that each
    would get too few triangles.
    """
    links = coo_array((np.ones(len(faces)), (faces[:, 0], faces[:, 1])), shape=(len(vertices), len(vertices)))
    links = links + coo_array((np.ones(len(faces)), (faces[:, 1], faces[:, 2])), shape=links.shape)
    label = connected_components(links, directed=False)[1][faces[:, 0]]
    numbers = np.unique(label)
    if not 1 < len(numbers) <= budget // len(_BOX_FACES):
        return None
    close = DENT_SHARE * float(np.ptp(vertices, axis=0).max())
    pieces: list[tuple[np.ndarray, np.ndarray]] = []
    others: list[tuple[float, np.ndarray, np.ndarray]] = []
    for number in numbers.tolist():
        used, own = np.unique(faces[label == number], return_inverse=True)
        points, triangles = vertices[used], own.reshape(-1, 3)
        box = _box_of(points)
        if len(triangles) <= len(_BOX_FACES):
            pieces.append((points, triangles))
        elif _depth_below(points, box) <= close:
            pieces.append((box, _BOX_FACES))
        else:
            a, b, c = (points[triangles[:, k]] for k in range(3))
            others.append((float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()), points, triangles))
    left = budget - sum(len(triangles) for _, triangles in pieces) - len(_BOX_FACES) * len(others)
    total = sum(area for area, _, _ in others)
    if left < 0:
        return None
    for area, points, triangles in others:
        pieces.append(reduced(points, triangles, len(_BOX_FACES) + int(left * area / max(total, 1e-300))))
    starts = np.cumsum([0, *(len(points) for points, _ in pieces)])
    joined_faces = [triangles + start for (_, triangles), start in zip(pieces, starts, strict=False)]
    return np.concatenate([points for points, _ in pieces]), np.concatenate(joined_faces)


def _box_of(points: np.ndarray) -> np.ndarray:
    """Return the corners (8, 3) of the bounding box that is aligned with the principal axes of the points."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    if np.linalg.det(axes) < 0.0:
        axes[2] *= -1.0
    along = (points - middle) @ axes.T
    ends = np.stack([along.min(axis=0), along.max(axis=0)])
    corners = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    return np.asarray(corners @ axes + middle)


def _depth_below(points: np.ndarray, box: np.ndarray) -> float:
    """Return how far the deepest of the points is below the surface of a box with the corners (8, 3).

    For points on the surface of a wire, this depth shows how rounded the edges of the wire are.
    """
    origin = box[0]
    sides = np.stack([box[4] - origin, box[2] - origin, box[1] - origin])
    lengths = np.maximum(np.linalg.norm(sides, axis=1), 1e-300)
    along = (points - origin) @ (sides / lengths[:, None]).T
    inward = np.minimum(along, lengths - along)
    # also require points near the corners of the box: a ring touches all sides of its box, but not the corners
    corners = cKDTree(points).query(box)[0].max()
    return float(max(inward.min(axis=1).max(), corners))


def _farthest(points: np.ndarray, others: cKDTree) -> float:
    """Return the 99th percentile of the distance from each of ``points`` to the nearest of ``others``."""
    return float(np.percentile(others.query(points[:: max(1, len(points) // 5_000)])[0], 99))


def normals_of(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the unit normals of triangles as an (m, 3) array. For a triangle without an area, the normal is zero."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None])


def _colored_points(mesh: RawMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (k, 3) points spread over the surface, their (k, 3) normals, and their (k, 3) colors in [0, 1]."""
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
    """Lay out triangles in a square texture. Each cell of a regular grid contains two triangles.

    Returns:
        The (k, 2) painted pixels (row, column), the (k,) index of the triangle that each pixel belongs to, the (k, 3)
        barycentric coordinates of each pixel in its triangle, and the (3 * count, 2) texture coordinates of the
        triangles' corners.
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
    halves = []
    for (a, b, c), mine in zip(corners, (lower, ~lower), strict=True):
        spots = centers[mine]
        shares = np.linalg.solve(np.stack([b - a, c - a], axis=1), (spots - a).T).T
        # A pixel beyond an edge takes the color of the edge.
        s = np.clip(shares, 0.0, 1.0)
        s = s / np.maximum(s.sum(axis=1, keepdims=True), 1.0)
        halves.append((np.floor(spots).astype(int), np.column_stack([1.0 - s.sum(axis=1), s])))
    where, owners, weights, uv = [], [], [], []
    for k in range(count):
        half = k % 2
        origin = np.array([(k // 2) % across, (k // 2) // across]) * cell
        spots, share = halves[half]
        weights.append(share)
        where.append((spots + origin)[:, ::-1])
        owners.append(np.full(len(spots), k))
        at = (corners[half] + origin) / ATLAS
        uv.append(np.column_stack([at[:, 0], 1.0 - at[:, 1]]))
    return np.concatenate(where), np.concatenate(owners), np.concatenate(weights), np.concatenate(uv)


def _single(vertices: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray((np.round(vertices, 7) + 0.0).astype(np.float32))


def _index(faces: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(faces.astype(np.int32))
