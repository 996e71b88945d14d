"""Volume that an object occupies, represented by a grid of small cells.

The volume is defined even if the surface of the object is not closed. Object meshes are seldom closed: their parts
intersect, their bottoms are missing, or their walls are single sheets. Therefore a cell is solid if the surface passes
through it, or if no path of empty cells leads from it to the outside. As a result, a mug is hollow, a closed bottle is
full, and a sheet is one cell thick.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

GRID = 72
"""Number of cells along the longest side. For an object 12 cm long, a cell has a side of 1.7 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Grid of cells, some of which an object occupies.

    Attributes:
        cells: (nx, ny, nz) bool, True for the cells that the object occupies. The outermost layer of cells is empty.
        surface: (nx, ny, nz) bool, True for the cells that the surface passes through.
        origin: Corner of the first cell [m].
        pitch_m: Side of a cell [m].
        points: (k, 3) points spread evenly over the surface [m].
        highest: (nx, ny) height of the highest surface point in each column of cells [m]. Empty columns have -inf.
    """

    cells: np.ndarray
    surface: np.ndarray
    origin: np.ndarray
    pitch_m: float
    points: np.ndarray
    highest: np.ndarray

    def centers(self, cells: np.ndarray) -> np.ndarray:
        """Return the (k, 3) centers of the cells that are True in the given mask [m]."""
        return np.asarray(self.origin + (np.argwhere(cells) + 0.5) * self.pitch_m)

    def index(self, points: np.ndarray) -> np.ndarray:
        """Return the (k, 3) cell indices of points [m]. For a point outside the grid, the nearest cell is returned."""
        at = np.floor((points - self.origin) / self.pitch_m).astype(int)
        return np.asarray(np.clip(at, 0, np.asarray(self.cells.shape) - 1))


def spread(vertices: np.ndarray, faces: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spread points over triangles in a regular pattern, without random numbers.

    Args:
        vertices: (n, 3) positions.
        faces: (m, 3) vertex indices.
        spacing: Maximum distance between neighboring points on a triangle.

    Returns:
        The (k, 3) points, the (k,) index of each point's triangle, and the (k, 3) barycentric coordinates of the
        points.
    """
    patterns = list(_patterns(vertices[faces], spacing))
    owners = np.concatenate([np.repeat(which, len(w)) for which, w in patterns])
    weights = np.concatenate([np.tile(w, (len(which), 1)) for which, w in patterns])
    return spread_points(vertices, faces, spacing), owners, weights


def spread_points(vertices: np.ndarray, faces: np.ndarray, spacing: float, *, most: int | None = None) -> np.ndarray:
    """Return the same (k, 3) points as :func:`spread`, but without their triangles and barycentric coordinates.

    Args:
        vertices: (n, 3) positions.
        faces: (m, 3) vertex indices.
        spacing: Maximum distance between neighboring points on a triangle.
        most: Approximate maximum number of points. If there are more, only every n-th point is returned.
    """
    return np.stack(_columns(vertices[faces], spacing, most=most), axis=1)


def _patterns(corners: np.ndarray, spacing: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Group the triangles by the number of points sampled on each.

    Yields:
        For each group, the indices of its triangles and the barycentric coordinates (k, 3) of the points on each of
        them.
    """
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.clip(np.ceil(longest / spacing), 1, 400).astype(int)
    for n in np.unique(steps):
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
        keep = i + j <= n
        b, c = i[keep] / n, j[keep] / n
        yield np.flatnonzero(steps == n), np.stack([1.0 - b - c, b, c], axis=1)


def _columns(corners: np.ndarray, spacing: float, *, most: int | None = None) -> list[np.ndarray]:
    """Return the x, y and z coordinates of points on triangles with corners (m, 3, 3), each as a (k,) array.

    The columns are multiplied and added one by one. This takes a quarter of the time of numpy.einsum, and gives the
    same bits on every CPU, unlike a matrix product.
    """
    patterns = list(_patterns(corners, spacing))
    count = sum(len(which) * len(w) for which, w in patterns)
    step = 1 if most is None else 1 + count // most
    found: list[list[np.ndarray]] = [[], [], []]
    first = 0  # index of the first point in the pattern that is kept
    for which, w in patterns:
        kept = np.arange(first, len(which) * len(w), step)
        first = (first - len(which) * len(w)) % step
        for axis, column in enumerate(found):
            own = corners[which, :, axis].T
            if step > 1:
                triangle, at = np.divmod(kept, len(w))
                column.append(_sum_of_products(w[at].T, own[:, triangle]))
            elif len(w) < len(which):  # the inner loop runs over the longer side
                column.append(_sum_of_products(w.T[:, :, None], own[:, None, :]).T.ravel())
            else:
                column.append(_sum_of_products(w.T[:, None, :], own[:, :, None]).ravel())
    return [np.concatenate(column) for column in found]


def _sum_of_products(weights: np.ndarray, values: np.ndarray) -> np.ndarray:
    found: np.ndarray = weights[0] * values[0]
    found += weights[1] * values[1]
    found += weights[2] * values[2]
    return found


def solid_of(vertices: np.ndarray, faces: np.ndarray, *, grid: int = GRID) -> Solid:
    """Return the solid bounded by a surface, on a grid with ``grid`` cells along the longest side.

    Args:
        vertices: (n, 3) positions [m].
        faces: (m, 3) vertex indices.
        grid: Number of cells along the longest side.
    """
    used = vertices[np.unique(faces)]
    low, high = used.min(axis=0), used.max(axis=0)
    pitch = float((high - low).max()) / grid
    origin = low - 1.5 * pitch
    shape = np.ceil((high - origin) / pitch).astype(int) + 2
    columns = _columns(vertices[faces], 0.6 * pitch)
    fine = [
        np.floor((column - start) / pitch * 2.0).astype(np.int64) for column, start in zip(columns, origin, strict=True)
    ]
    i, j, k = (np.clip(index >> 1, 0, count - 1) for index, count in zip(fine, shape.tolist(), strict=True))
    upright = i * shape[1] + j
    at = upright * shape[2] + k
    surface = np.zeros(shape, dtype=bool)
    surface.ravel()[at] = True
    cells = ndimage.binary_fill_holes(surface)
    # Use all points here: if a wall is thinner than a cell, the points kept below may be on its underside.
    highest = np.full(tuple(shape[:2]), -np.inf)
    np.maximum.at(highest.ravel(), upright, columns[2])
    # A few points per cell are enough for hulls and distances.
    first = _first_of_each((fine[0] * 2 * shape[1] + fine[1]) * 2 * shape[2] + fine[2], 8 * int(shape.prod()))
    # Drop points inside the object, such as between the layers of a burger. They are neither visible nor touchable.
    outside = ndimage.binary_dilation(~cells, ndimage.generate_binary_structure(3, 3))
    first = first[outside.ravel()[at[first]]]
    points = np.stack([column[first] for column in columns], axis=1)
    return Solid(np.asarray(cells, dtype=bool), surface, origin, pitch, points, highest)


def _first_of_each(keys: np.ndarray, count: int) -> np.ndarray:
    """Return the ascending indices (m,) of the first occurrence of each key in ``keys`` (n,).

    The keys must be integers below ``count``.
    """
    first = np.full(count, len(keys), dtype=np.int32)
    # Among equal keys, the value that is written last remains.
    first[keys[::-1]] = np.arange(len(keys) - 1, -1, -1, dtype=np.int32)
    return np.sort(first[first < len(keys)])


def mass_of_cells(solid: Solid, mass_kg: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the center of mass and the inertia of a solid, assuming uniform density.

    The center is a (3,) array [m]. The inertia is a (3, 3) tensor about the center of mass [kg m^2]. A cell that the
    surface passes through counts as half full.
    """
    centers = solid.centers(solid.cells)
    weights = np.where(solid.surface[solid.cells], 0.5, 1.0)
    weights = weights / weights.sum()
    middle = weights @ centers
    offset = centers - middle
    second = np.einsum("k,ki,kj->ij", weights, offset, offset) + np.eye(3) * solid.pitch_m**2 / 12.0
    return middle, mass_kg * (np.trace(second) * np.eye(3) - second)
