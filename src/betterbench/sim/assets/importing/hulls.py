"""Collision shape of an object, made of convex hulls.

A solid object has a single hull or a convex decomposition. A hollow object has separate hulls for its floor and for
sectors of its wall, so that the hollow stays open.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import vhacdx
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError, cKDTree

from betterbench.sim.assets.importing.appearance import reduced
from betterbench.sim.assets.importing.cavity import Cavity, columns_box
from betterbench.sim.assets.importing.solid import Solid, spread_points

SECTORS = 12
"""Number of sectors of a wall. The flat outside of a sector is at most 1.4 mm inside a circle of radius 4 cm."""
MOST_HULLS = 48
_CORNERS = 40
"""Maximum number of vertices of a hull. Each vertex costs time in MuJoCo's narrow phase."""
_VHACD_HULLS, _VHACD_CELLS, _VHACD_FACES = 20, 60_000, 1_500
_CLOSE_M, _CLOSE_SHARE, _CLOSE_MIDDLE_SHARE = 0.002, 0.03, 0.06
"""Length [m], fraction of the longest side and fraction of the second-longest side. A single hull suffices if its
deviation from the surface is at most the length, or at most the smaller of the two fractions. The second-longest side
matters for slim objects: a fork is 3 cm wide and 28 cm long."""
_THICK_FLOOR = 0.25
"""Minimum height of a hollow's floor for which a solid base below the floor is tried, as a fraction of the object's
height.
"""
_MOSTLY_FREE = 0.3
"""Maximum fraction of a hollow that a decomposition may fill."""
_LITTLE_FILLED = 0.1
"""Maximum fraction of a hollow that the hulls of the floor and the walls may fill. Above it, a different division is
tried."""
_CLOSE_RINGS_M, _OUTLINE = 0.004, 25
"""Deviation from the surface above which the wall is also divided into rings [m], and the number of heights at which
the outline of the wall is sampled to find the rings."""
_RECTANGULAR = 0.9
_MANY = 1_000
_LEAST_THICK_M = 0.0005
"""Minimum thickness of a hull [m]. MuJoCo rejects meshes with coplanar vertices, and misses contacts with nearly flat
ones."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Distances between the collision shapes and the visible surface, as 95th percentiles over points [m].

    Attributes:
        outside_m: Distance of points on the collision shapes from the visible surface. If it is large, other objects
            collide with visibly empty space.
        inside_m: Distance of points on the visible surface from the collision shapes. If it is large, other objects
            pass through visible parts.
    """

    outside_m: float
    inside_m: float


def convex_hulls(
    solid: Solid, surface: tuple[np.ndarray, np.ndarray], cavity: Cavity | None
) -> tuple[list[np.ndarray], Fit]:
    """Return convex shapes that together approximate the object, and a measure of how well they fit its surface.

    Args:
        solid: Cells of the object and points on its surface.
        surface: (n, 3) vertices [m] and (m, 3) faces.
        cavity: Hollow of the object, or None if the object has none. The shapes leave the hollow open.

    Returns:
        The vertices of each convex shape as an (n, 3) array [m], and the fit of all shapes together.
    """
    sides = np.sort(np.ptp(solid.points, axis=0))
    size = float(sides[2])
    if cavity is None:
        whole = None if is_flat(solid.points) else hull_corners(solid.points)
        if whole is None:
            return [], fit_of([], solid)
        best = [whole], fit_of([whole], solid)
        if best[1].outside_m <= max(_CLOSE_M, min(_CLOSE_SHARE * size, _CLOSE_MIDDLE_SHARE * float(sides[1]))):
            return best
        options = [_decomposed(*surface), _halved(solid.points, solid, most=_VHACD_HULLS)]
        fitted = [best, *((hulls, fit_of(hulls, solid)) for hulls in options if hulls)]
        return min(fitted, key=lambda option: _misfit(option[1]))
    hulls, fit = _hollow_hulls(solid, cavity)
    if len(hulls) > MOST_HULLS or fit.outside_m > max(0.004, 0.05 * size):
        decomposed = _decomposed(*surface)
        other = fit_of(decomposed, solid)
        if other.outside_m < fit.outside_m and filled_share(decomposed, solid, cavity) < _MOSTLY_FREE:
            return decomposed, other
    if len(hulls) > MOST_HULLS:
        hulls = hulls[:MOST_HULLS]
        fit = fit_of(hulls, solid)
    return hulls, fit


def _hollow_hulls(solid: Solid, cavity: Cavity) -> tuple[list[np.ndarray], Fit]:
    """Return the convex hulls of a hollow object. Its floor and walls are divided in the way that fits best.

    The default is a division into bands. A base with walls on it is also tried if the floor is thick (as in a plate
    with a foot) or if the bands fill the hollow (as in a wide shallow tray). Rings are also tried if the other hulls
    reach beyond the surface (as for a vase with a waist).
    """
    body = _body_of(solid, cavity)
    rest = solid.cells & ~body.near[:, :, None]
    attached = _attached(solid, rest) if rest.any() else []

    def fitted(hulls: list[np.ndarray]) -> tuple[float, list[np.ndarray], Fit]:
        hulls = hulls + attached
        fit, filled = fit_of(hulls, solid), filled_share(hulls, solid, cavity)
        return _misfit(fit) + cavity.depth_m * filled, hulls, fit

    options = [fitted(_walls(solid, cavity, body))]
    sides = np.sort(np.ptp(solid.points, axis=0))
    is_full = filled_share(options[0][1], solid, cavity) > _LITTLE_FILLED
    if is_full or cavity.floor_m > _THICK_FLOOR * float(np.ptp(solid.points[:, 2])):
        options.append(fitted(_base_and_walls(solid, cavity, body)))
    if min(fit.outside_m for _, _, fit in options) > max(_CLOSE_RINGS_M, _CLOSE_MIDDLE_SHARE * float(sides[1])):
        options.append(fitted(_rings(solid, cavity, body)))
    _, hulls, fit = min(options, key=lambda option: option[0])
    return hulls, fit


def _misfit(fit: Fit) -> float:
    """Return the cost of a fit [m]. A worse fit has a higher cost.

    Missing collision geometry has a higher cost than collision geometry outside the surface.
    """
    return fit.outside_m + 3.0 * fit.inside_m


def hull_corners(points: np.ndarray) -> np.ndarray | None:
    """Return at most 40 corners of the convex hull of points [m].

    The points of a flat sheet are thickened. Returns None if all points are on a line.
    """
    if len(points) < 3:
        return None
    points = with_thickness(points)
    try:
        # Only corners of the hull can be farthest in a direction, and Qhull finds the corners quickly.
        if len(points) > _MANY:
            points = points[ConvexHull(points).vertices]
        chosen = points[np.unique(np.argmax(points @ _directions().T, axis=0))]
        corners = chosen[ConvexHull(chosen).vertices]
    except (QhullError, ValueError):
        return None
    return np.ascontiguousarray(corners)


def with_thickness(points: np.ndarray) -> np.ndarray:
    """Return the points (n, 3) [m], thickened to half a millimeter if they lie nearly in a plane."""
    normal, thickness = _thinnest(points)
    lacking = _LEAST_THICK_M - thickness
    if lacking <= 0.0:
        return points
    return np.concatenate([points - 0.5 * lacking * normal, points + 0.5 * lacking * normal])


def is_flat(points: np.ndarray) -> bool:
    """Return whether points (n, 3) [m] lie in one plane, up to the rounding of hull corners (a micrometer)."""
    return _thinnest(points)[1] < 2e-6


def _thinnest(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the normal (3,) of the plane that fits the points best, and the points' extent along this normal [m]."""
    offsets = points - points.mean(axis=0)
    normal = np.linalg.eigh(offsets.T @ offsets)[1][:, 0]
    return normal, float(np.ptp(offsets @ normal))


@functools.cache
def _directions() -> np.ndarray:
    """Return unit vectors spread over the sphere, beginning with the axes and the diagonals of a cube."""
    cube = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], dtype=float)
    count = 3 * _CORNERS
    k = np.arange(count) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / count), np.pi * (1.0 + 5.0**0.5) * k
    ball = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)
    return np.concatenate([cube / np.linalg.norm(cube, axis=1, keepdims=True), ball])


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """The part of an object around its hollow, without attachments such as handles and spouts.

    Attributes:
        near: (nx, ny) columns of the hollow and of the wall around it.
        points: (k, 3) points on the surface in these columns [m].
        columns: (k, 2) column of each point.
        sector: (k,) index of the wall sector that each point belongs to.
        center: Middle of the hollow, x and y [m].
    """

    near: np.ndarray
    points: np.ndarray
    columns: np.ndarray
    sector: np.ndarray
    center: tuple[float, float]


def _body_of(solid: Solid, cavity: Cavity) -> _Body:
    x, y, half_x, half_y = columns_box(solid, cavity.mask)
    wall = _wall_cells(cavity.mask, np.isfinite(cavity.tops))
    near = ndimage.binary_dilation(cavity.mask, ndimage.generate_binary_structure(2, 2), iterations=wall)
    columns = solid.index(solid.points)[:, :2]
    of_body = near[tuple(columns.T)]
    points, columns = solid.points[of_body], columns[of_body]
    offset = points[:, :2] - (x, y)
    turn = np.arctan2(offset[:, 1], offset[:, 0])
    edges = _sector_edges(cavity.mask, half_x, half_y)
    sector = np.searchsorted(edges, np.mod(turn - edges[0], 2 * np.pi) + edges[0], side="right") - 1
    return _Body(near, points, columns, sector, (x, y))


def _walls(solid: Solid, cavity: Cavity, body: _Body) -> list[np.ndarray]:
    """Return the hulls of the floor and the walls of a hollow object.

    The surface is seen from a focal point in the middle of the opening. The angle between straight down and the
    direction to a surface point grows along the profile, from the floor to the rim. If the surface is divided into
    bands by this angle, each band is a nearly straight piece of the floor or the wall.
    """
    _, _, half_x, half_y = columns_box(solid, cavity.mask)
    radius = np.hypot(*(body.points[:, :2] - body.center).T)
    focus = cavity.rim_m + 0.05 * cavity.depth_m
    angle = np.arctan2(radius, focus - body.points[:, 2])
    corner = float(np.arctan2(0.8 * min(half_x, half_y), focus - cavity.floor_m))
    bands = _bands(body.points, angle, body.sector, corner, inner=_inner_points(solid, cavity))
    hulls: list[np.ndarray] = []
    for low, high, whole in bands:
        inside = (angle >= low - 1e-9) & (angle <= high)
        groups = [inside] if whole else [inside & (body.sector == k) for k in np.unique(body.sector)]
        hulls += [found for group in groups if (found := hull_corners(body.points[group])) is not None]
    return hulls


def _base_and_walls(solid: Solid, cavity: Cavity, body: _Body) -> list[np.ndarray]:
    """Return one hull for everything below the floor of the hollow, and one for each sector of the wall above it."""
    level = float(np.median(cavity.tops[cavity.mask]))
    heights = body.points[:, 2]
    hollow = ndimage.binary_fill_holes(cavity.mask)
    labels, _ = ndimage.label(~hollow | (cavity.tops > level + solid.pitch_m))
    # A raised column in the hollow is part of the wall if it touches the wall, and otherwise a piece of the filling.
    of_wall = np.isin(labels, np.unique(labels[~hollow]))
    wall = (heights > level - solid.pitch_m) & of_wall[tuple(body.columns.T)]
    groups = [heights <= level, *(wall & (body.sector == k) for k in np.unique(body.sector))]
    return [found for group in groups if (found := hull_corners(body.points[group])) is not None]


def _rings(solid: Solid, cavity: Cavity, body: _Body) -> list[np.ndarray]:
    """Return one hull of everything below the floor of the hollow, and hulls of the wall above it, divided into rings.

    The boundaries between rings are where the outline of the wall bends most. Each ring is divided into sectors.
    """
    heights = body.points[:, 2]
    low, high = cavity.floor_m, float(heights.max())
    radius = np.hypot(*(body.points[:, :2] - body.center).T)
    levels = np.linspace(low, high, _OUTLINE)
    layer = np.clip(np.searchsorted(levels, heights) - 1, 0, _OUTLINE - 2)
    outline = np.array([radius[layer == k].max(initial=0.0) for k in range(_OUTLINE - 1)])
    cuts = levels[np.array(_bends(outline))]
    groups = [heights <= low + solid.pitch_m]
    for below, above in itertools.pairwise((low, *cuts, high)):
        ring = (heights >= below) & (heights <= above)
        groups += [ring & (body.sector == k) for k in np.unique(body.sector)]
    return [found for group in groups if (found := hull_corners(body.points[group])) is not None]


def _bends(outline: np.ndarray) -> tuple[int, ...]:
    """Return the two indices at which to split an outline (n,) so that three straight lines approximate it best."""

    def bulge(a: int, b: int) -> float:
        part = outline[a : b + 1]
        return float(np.abs(part - np.linspace(part[0], part[-1], len(part))).max())

    last = len(outline) - 1
    pairs = itertools.combinations(range(1, last), 2)
    return min(pairs, key=lambda pair: max(bulge(a, b) for a, b in itertools.pairwise((0, *pair, last))))


def filled_share(hulls: Sequence[np.ndarray], solid: Solid, cavity: Cavity) -> float:
    """Return the fraction of a hollow that the hulls fill."""
    columns = np.argwhere(cavity.mask)
    xy = solid.origin[:2] + (columns + 0.5) * solid.pitch_m
    low = cavity.tops[tuple(columns.T)] + min(1.5 * solid.pitch_m, 0.25 * cavity.depth_m)
    points = np.concatenate([np.column_stack([xy, low + share * (cavity.rim_m - low)]) for share in (0.1, 0.4, 0.7)])
    points = points[points[:, 2] < cavity.rim_m]
    inside = np.zeros(len(points), bool)
    for corners in hulls:
        inside |= inside_hull(ConvexHull(corners), points, min(0.5 * solid.pitch_m, 0.1 * cavity.depth_m))
    return float(inside.mean()) if len(points) else 0.0


def _wall_cells(mask: np.ndarray, footprint: np.ndarray) -> int:
    """Return the smallest wall thickness, in cells, for which the rim of the wall around a hollow is mostly closed."""
    structure = ndimage.generate_binary_structure(2, 2)
    grown = mask
    for thickness in range(1, 16):
        larger = ndimage.binary_dilation(grown, structure)
        ring = larger & ~grown
        if (ring & footprint).sum() < 0.35 * ring.sum():
            return max(thickness, 1)
        grown = larger
    return 15


def _sector_edges(mask: np.ndarray, half_x: float, half_y: float) -> np.ndarray:
    """Return the angles of the boundaries between wall sectors [rad], ascending over one turn.

    If the hollow is rectangular, there are boundaries at its corners. Otherwise, all sectors have the same size.
    """
    found = np.argwhere(mask)
    full = mask.sum() / np.prod(np.ptp(found, axis=0) + 1)
    if full < _RECTANGULAR:
        return np.linspace(-np.pi, np.pi, SECTORS + 1)
    corner = float(np.arctan2(half_y, half_x))
    corners = (-np.pi + corner, -corner, corner, np.pi - corner, np.pi + corner)
    return np.concatenate([[corners[0]], *(np.linspace(a, b, 4)[1:] for a, b in itertools.pairwise(corners))])


def _inner_points(solid: Solid, cavity: Cavity) -> np.ndarray:
    """Return (k, 3) points inside the hollow, at least one cell above its floor [m].

    These points must stay free of collision shapes.
    """
    columns = np.argwhere(ndimage.binary_erosion(cavity.mask, iterations=1))
    xy = solid.origin[:2] + (columns + 0.5) * solid.pitch_m
    low = cavity.tops[tuple(columns.T)] + 1.2 * solid.pitch_m
    heights = [np.maximum(low, cavity.floor_m + share * cavity.depth_m) for share in (0.0, 0.25, 0.5, 0.75)]
    return np.concatenate([np.column_stack([xy, z]) for z in heights])


def _bands(
    points: np.ndarray, angle: np.ndarray, sector: np.ndarray, corner: float, *, inner: np.ndarray
) -> list[tuple[float, float, bool]]:
    """Divide the floor and the wall of a hollow object into bands of the viewing angle (see :func:`_walls`).

    The floor band is made smaller until its hull leaves the hollow open. The wall is divided into two or three bands if
    a single band would fill the hollow.

    Returns:
        The bands as (low, high, whole). ``whole`` is True if the band is a single disc rather than divided into
        sectors.
    """
    floor = corner
    for _ in range(5):
        hull = hull_corners(points[angle <= floor])
        if hull is None or _share_inside(hull, inner) < 0.01:
            break
        floor *= 0.7
    best: list[tuple[float, float, bool]] = []
    for count in (1, 2, 3):
        edges = (
            np.linspace(floor, np.pi, 2) if count == 1 else np.append(np.linspace(floor, 1.4, count + 1)[:-1], np.pi)
        )
        best = [(0.0, floor, True), *((float(a), float(b), False) for a, b in itertools.pairwise(edges))]
        filled = 0.0
        for low, high, _ in best[1:]:
            for k in np.unique(sector):
                hull = hull_corners(points[(angle >= low) & (angle <= high) & (sector == k)])
                filled += 0.0 if hull is None else _share_inside(hull, inner)
        if filled < 0.02:
            break
    return best


def _share_inside(corners: np.ndarray, points: np.ndarray) -> float:
    """Return the fraction of the points that are inside a convex hull."""
    if len(points) == 0:
        return 0.0
    return float(inside_hull(ConvexHull(corners), points, 0.0).mean())


def inside_hull(hull: ConvexHull, points: np.ndarray, depth: float) -> np.ndarray:
    """Return a mask (k,) of the points that are inside a convex hull, at a depth of more than ``depth`` [m]."""
    corners = hull.points[hull.vertices]
    inside = np.ones(len(points), dtype=bool)
    for axis in range(3):  # testing column by column is five times as fast as reducing rows of three elements
        column = points[:, axis]
        inside &= (column > corners[:, axis].min()) & (column < corners[:, axis].max())
    near = np.flatnonzero(inside)  # test the planes only for these points, which are few
    if not len(near):
        return inside
    equations = np.ascontiguousarray(hull.equations)
    inside[near] = (points[near] @ equations[:, :3].T + equations[:, 3]).max(axis=1) < -depth
    return np.asarray(inside)


def _attached(solid: Solid, rest: np.ndarray) -> list[np.ndarray]:
    """Return the hulls of the parts attached to the outside of a wall, such as handles, spouts and feet."""
    labels, count = ndimage.label(rest, ndimage.generate_binary_structure(3, 3))
    at = solid.index(solid.points)
    of = labels[tuple(at.T)]
    found: list[np.ndarray] = []
    for label in range(1, count + 1):
        points = solid.points[of == label]
        if (labels == label).sum() >= 8:
            found += _halved(points, solid, most=6)
    return found


def _halved(points: np.ndarray, solid: Solid, *, most: int) -> list[np.ndarray]:
    """Repeatedly cut a set of points where this reduces the volume of the hulls most.

    Return the convex hulls of the parts.
    """
    parts, gains = [points], [_best_cut(points)]
    while len(parts) < most:
        which = int(np.argmax([gain for gain, _ in gains]))
        gain, cut = gains[which]
        if cut is None or gain < 20.0 * solid.pitch_m**3:
            break
        parts[which : which + 1] = cut
        if len(parts) < most:
            gains[which : which + 1] = [_best_cut(side) for side in cut]
    return [found for part in parts if (found := hull_corners(part)) is not None]


def _best_cut(points: np.ndarray) -> tuple[float, tuple[np.ndarray, np.ndarray] | None]:
    """Find the axis-aligned cut through points that reduces the total volume of their convex hulls most.

    Returns:
        The saved volume [m^3], and the points on the two sides of the cut. If no cut saves volume, the saved volume is
        0 and None is returned instead of the points.
    """
    whole, best, sides = _volume(points), 0.0, None
    for axis in range(3):
        low, high = points[:, axis].min(), points[:, axis].max()
        for at in np.linspace(low, high, 9)[1:-1]:
            below = points[:, axis] <= at
            saved = whole - _volume(points[below]) - _volume(points[~below])
            if saved > best:
                best, sides = saved, (points[below], points[~below])
    return best, sides


def _volume(points: np.ndarray) -> float:
    corners = hull_corners(points)
    return 0.0 if corners is None else float(ConvexHull(corners).volume)


def _decomposed(vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Return the convex hulls of a surface, decomposed with V-HACD (Mamou, 2016)."""
    vertices, faces = reduced(vertices, faces, _VHACD_FACES)
    flat = np.column_stack([np.full(len(faces), 3), faces]).astype(np.uint32).ravel()
    made = vhacdx.compute_vhacd(
        np.ascontiguousarray(vertices, dtype=np.float64),
        flat,
        maxConvexHulls=_VHACD_HULLS,
        resolution=_VHACD_CELLS,
        maxNumVerticesPerCH=_CORNERS,
        asyncACD=False,
    )
    return [found for corners, _ in made if (found := hull_corners(np.asarray(corners))) is not None]


_MOST_POINTS = 400_000
"""Maximum number of points sampled on hulls. Usually, 30 hulls get 300,000 points. Without the limit, 60 hulls with
long, narrow triangles got four million."""


def surface_points(hulls: Sequence[np.ndarray], spacing: float) -> np.ndarray:
    """Return (k, 3) points spread over the outer surface of the union of the hulls [m]."""
    bodies = [ConvexHull(corners) for corners in hulls]
    low, high = (np.array([side(body.points, axis=0) for body in bodies]) for side in (np.min, np.max))
    kept = []
    for own, body in enumerate(bodies):
        points = spread_points(body.points, body.simplices, spacing)
        outside = np.ones(len(points), dtype=bool)
        for other in np.flatnonzero(((low < high[own]) & (low[own] < high)).all(axis=1)):  # boxes overlap
            if other != own:
                outside &= ~inside_hull(bodies[other], points, 1e-6)
        kept.append(points[outside])
    found = np.concatenate(kept)
    return found[:: max(1, len(found) // _MOST_POINTS)]


def fit_of(hulls: Sequence[np.ndarray], solid: Solid) -> Fit:
    """Return the distances between the collision shapes of a solid and its visible surface.

    A point of a collision shape that is hidden inside the solid has distance zero, because nothing can touch it.
    """
    if not hulls:
        return Fit(np.inf, np.inf)
    points = solid.points
    size = float(np.ptp(points, axis=0).max())
    theirs = surface_points(hulls, size / 60.0)
    hidden = (solid.cells & ~solid.surface)[tuple(solid.index(theirs).T)]
    to_visible = distances_to(points, theirs, ~hidden)
    seen = points[:: max(1, len(points) // 20_000)]
    held = np.zeros(len(seen), dtype=bool)
    for corners in hulls:  # points inside a shape have contact
        held |= inside_hull(ConvexHull(corners), seen, 0.0)
    to_shapes = distances_to(theirs, seen, ~held)
    # A distance below the spacing of the points is zero.
    free = size / 120.0
    return Fit(*(max(0.0, float(np.percentile(d, 95)) - free) for d in (to_visible, to_shapes)))


def distances_to(to: np.ndarray, points: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """Return the distance (k,) of each selected point to the nearest point in ``to`` [m].

    The distance of a point that is not selected is set to 0.
    """
    found = np.zeros(len(points))
    if not asked.any():
        return found
    # An unbalanced tree is built in a third of the time and gives the same distances.
    tree = cKDTree(to, balanced_tree=False, compact_nodes=False)
    found[asked], _ = tree.query(points[asked])
    return found
