"""Find the scale and orientation of an imported mesh: its up axis, its unit of length, and its origin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull

from betterbench.errors import InvalidInputError
from betterbench.sim.assets.importing.cavity import Cavity, cavity_of
from betterbench.sim.assets.importing.hulls import hull_corners
from betterbench.sim.assets.importing.kinds import FLAT_SHARE, TALL_SHARE, Kind
from betterbench.sim.assets.importing.measures import depth_in_hull
from betterbench.sim.assets.importing.raw import RawMesh
from betterbench.sim.assets.importing.solid import GRID, Solid, mass_of_cells, solid_of
from betterbench.tasks.words import with_article

# Usual units of mesh files [m]: meters, decimeters, centimeters, millimeters, inches, feet.
UNITS_M = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "foot": 0.3048}
LEAST_M, MOST_M = 0.01, 0.6
"""Allowed range for the longest side of an object [m], so that it fits on a table and is visible to a camera."""

_TRIAL_GRID = 36
"""Number of cells along the longest side when only the orientation is needed."""
_LEAST_MARGIN_M = 0.001
"""Minimum distance of the center of mass from the edge of a stable support face [m]."""
_MOST_TURNS = 6
_LEAST_TILT, _MOST_TILT = np.radians(2.0), np.radians(20.0)
MOST_STANDING_LEAN_DEGREES = 10.0
"""Maximum angle by which an object of a standing kind, such as a can, is turned to reach its stable pose. A can that
leans further, for example on a spike below its base, stays in the pose of its file. The asset certificate then reports
that the can tips over."""

_TURNS = {
    "z": np.eye(3),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "y": np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]),
    "-y": np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]),
    "x": np.array([[0, 0, -1.0], [0, 1.0, 0], [1.0, 0, 0]]),
    "-x": np.array([[0, 0, 1.0], [0, 1.0, 0], [-1.0, 0, 0]]),
}
"""Rotations that turn an axis of the file to +z."""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Upright mesh in meters. The origin is at the center of the bottom of its bounding box.

    Attributes:
        mesh: The mesh.
        solid: Cells that the object occupies.
        cavity: Hollow of the object, or None if the object has none.
        up: Axis of the file that now points up, such as "y" or "-z".
        scale: Length of one unit of the file [m].
        notes: What was decided about size and orientation, and why.
    """

    mesh: RawMesh
    solid: Solid
    cavity: Cavity | None
    up: str
    scale: float
    notes: tuple[str, ...]


def place(
    mesh: RawMesh, kind: Kind | None, where: str, *, up: str | None = None, size_m: float | None = None
) -> Placed:
    """Scale a mesh to meters and set it upright.

    Args:
        mesh: The mesh in the frame of its file.
        kind: Kind of the object, or None if the kind is not known.
        where: Name of the file, for messages.
        up: Axis of the file's frame that points up. If None, the axis is determined from the file format, the hollow of
            an open object, the usual pose of its kind (bottles stand, forks lie), or the most stable pose.
        size_m: Longest side [m]. If None, the unit of the file format is used if the resulting size is plausible for
            this kind. Otherwise, for a format without a unit, a common unit with a plausible size is used. If there is
            none, the object gets the typical size of its kind.

    Raises:
        InvalidInputError: If the size cannot be determined, or is not that of a tabletop object.
    """
    scale, said = _scale(mesh, kind, where, size_m)
    sized = mesh.moved(np.diag([scale, scale, scale, 1.0]))
    axis, notes = _up_axis(sized, kind, up)
    standing = _standing(sized.moved(_turn(_TURNS[axis])))
    most = np.radians(MOST_STANDING_LEAN_DEGREES) if kind is not None and kind.stands else _MOST_TILT
    moved, solid, cavity, tilt = _at_rest(*standing, most)
    if tilt > 0.0:
        notes = (*notes, f"turned by {np.degrees(tilt):.2g} degrees, to lie as it comes to rest")
    return Placed(moved, solid, cavity, axis, scale, (said, *notes))


def _up_axis(sized: RawMesh, kind: Kind | None, up: str | None) -> tuple[str, tuple[str, ...]]:
    """Return the axis of the file's frame that points up, and notes explaining the choice."""
    if up is not None:
        return up, ()
    axis, cavity, notes = _by_rule_or_hollow(sized, kind)
    needed = None if cavity is not None else _axis_of_kind(sized, kind, axis)
    if kind is None or needed is None:
        return axis, notes
    use = "stands" if kind.is_tall else "lies flat"
    return needed, (f"turned: {needed} of the file points up, since a {kind.name} {use}",)


def _axis_of_kind(sized: RawMesh, kind: Kind | None, axis: str) -> str | None:
    """Return the axis that must point up so that a tall kind of object stands, or a flat kind of object lies flat.

    Returns None if this is already the case with the given axis, or if the kind is neither tall nor flat.
    """
    if kind is None or not (kind.is_tall or kind.is_flat):
        return None
    sides = dict(zip("xyz", np.ptp(sized.bounds(), axis=0).tolist(), strict=True))
    height = sides[axis[-1]]
    others = [side for name, side in sides.items() if name != axis[-1]]
    if kind.is_tall:
        if height >= TALL_SHARE * max(sides.values()):
            return None
        needed = max(sides, key=lambda name: sides[name])
    else:
        if height <= FLAT_SHARE * min(others):
            return None
        needed = min(sides, key=lambda name: sides[name])

    def rank(axis: str) -> tuple[float, ...]:
        _, solid, cavity = _tried(sized, axis)
        held = 0.0 if cavity is None or kind.is_tall else cavity.volume_m3  # a bottle may have a hollow bottom
        return held, round(footing(solid), 1), -len(axis)

    return max((needed, f"-{needed}"), key=rank)


def _by_rule_or_hollow(sized: RawMesh, kind: Kind | None) -> tuple[str, Cavity | None, tuple[str, ...]]:
    """Determine which axis points up, using the file format or the hollow of an object that is open at the top.

    Returns:
        The axis, the hollow (None if the object has none, or if the hollow does not affect the choice), and notes that
        explain the choice.
    """
    axes = [mesh_up] if (mesh_up := sized.up) is not None else ["z", "y"]
    may_turn = kind is not None and kind.is_open
    if len(axes) == 1 and not may_turn:
        return axes[0], None, ()
    tried = [_tried(sized, axis) for axis in axes]
    if may_turn and all(cavity is None for _, _, cavity in tried):
        tried += [_tried(sized, axis) for axis in _TURNS if axis not in axes]
    best = max(range(len(tried)), key=lambda k: _rank(tried[k][1], tried[k][2], kind, -k))
    axis, _, cavity = tried[best]
    hollow = cavity if may_turn else None
    if mesh_up is None:
        return axis, hollow, (f"{axis} of the file points up: the format has no rule, and it stands best so",)
    why = "it stands best so" if cavity is None else "it is open there"
    turned = () if axis == mesh_up else (f"turned: {axis} of the file points up, since {why}",)
    return axis, hollow, turned


def _tried(sized: RawMesh, axis: str) -> tuple[str, Solid, Cavity | None]:
    return (axis, *_standing(sized.moved(_turn(_TURNS[axis])), grid=_TRIAL_GRID)[1:])


def _turn(rotation: np.ndarray) -> np.ndarray:
    turn = np.eye(4)
    turn[:3, :3] = rotation
    return turn


def _at_rest(
    mesh: RawMesh, solid: Solid, cavity: Cavity | None, most: float
) -> tuple[RawMesh, Solid, Cavity | None, float]:
    """Turn an object to the nearest stable pose, if it is at most ``most`` [rad] away from the current pose.

    Without this rotation, scanned fruit would roll in every scene, because it keeps the pose in which it was held
    during the scan. If the nearest stable pose is farther away than ``most``, the object is not turned. The search is
    repeated after each rotation, because the simplified hull of the object then has different corners.

    Returns:
        The turned mesh, its solid, its hollow, and the angle by which it was turned [rad].
    """
    now, whole = (mesh, solid, cavity), np.eye(3)
    for _ in range(_MOST_TURNS):
        found = _nearest_face(now[1], most)
        if found is None:
            break
        angle, turn = found
        total = float(np.arccos(np.clip((turn @ whole)[2, 2], -1.0, 1.0)))
        if total > most:
            break
        if angle < _LEAST_TILT:
            return (*now, float(np.arccos(np.clip(whole[2, 2], -1.0, 1.0))))
        whole = turn @ whole
        now = _standing(now[0].moved(_turn(turn)))
    return mesh, solid, cavity, 0.0


def _nearest_face(solid: Solid, most: float) -> tuple[float, np.ndarray] | None:
    """Find the nearest face of the convex hull on which the object could stand without tipping over.

    Returns:
        The angle [rad] and the matrix of the rotation that turns this face down to the table. None if no such face is
        near enough.
    """
    middle, _ = mass_of_cells(solid, 1.0)
    corners = hull_corners(solid.points)
    if corners is None:
        return None
    hull = ConvexHull(corners)
    angles = np.arccos(np.clip(-hull.equations[:, 2], -1.0, 1.0))
    for k in np.argsort(angles):
        if angles[k] > most:
            return None
        normal = hull.equations[k, :3]
        face = np.abs(corners @ normal + hull.equations[k, 3]) < 1e-4
        base = corners[face] - np.outer(corners[face] @ normal, normal)
        if _is_over(middle - (middle @ normal) * normal, base, normal):
            return float(angles[k]), _rotation(normal, np.array([0.0, 0.0, -1.0]))
    return None


def _is_over(foot: np.ndarray, base: np.ndarray, normal: np.ndarray) -> bool:
    """Return whether a point is well inside the convex hull of coplanar points (k, 3), when seen along the normal."""
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    axes = np.stack([first / np.linalg.norm(first), np.cross(normal, first / np.linalg.norm(first))], axis=1)
    return depth_in_hull(foot @ axes, base @ axes) >= _LEAST_MARGIN_M


def _rotation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the smallest rotation that turns direction ``a`` to direction ``b`` (Rodrigues).

    The directions must not be opposite.
    """
    v = np.cross(a, b)
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + a @ b))


def _scale(mesh: RawMesh, kind: Kind | None, where: str, size_m: float | None) -> tuple[float, str]:
    longest = float(np.ptp(mesh.bounds(), axis=0).max())
    if size_m is not None:
        return size_m / longest, f"longest side {100 * size_m:.3g} cm, as given"
    by_rule = mesh.unit_m
    low, high = (LEAST_M, MOST_M) if kind is None else (kind.low_m, kind.high_m)
    if by_rule is not None and low <= longest * by_rule <= high:
        return by_rule, f"longest side {100 * longest * by_rule:.3g} cm in the unit of the format"
    if kind is None:
        fits = [name for name, unit in UNITS_M.items() if 0.03 <= longest * unit <= 0.4]
        if by_rule is None and len(fits) == 1:
            unit = UNITS_M[fits[0]]
            return unit, f"longest side {100 * longest * unit:.3g} cm, read as {fits[0]}"
        problem = f"its longest side is {longest:.3g} units, and neither its name nor its format determines its size"
        raise InvalidInputError(where, problem, "Specify the size with --size-m, or a known kind with --kind")
    if by_rule is None:
        for name, unit in UNITS_M.items():
            if low <= longest * unit <= high:
                return unit, f"longest side {100 * longest * unit:.3g} cm, read as {name}"
    return (
        kind.middle_m / longest,
        f"longest side set to {100 * kind.middle_m:.3g} cm, usual for {with_article(kind.name)}",
    )


def _standing(moved: RawMesh, *, grid: int = GRID) -> tuple[RawMesh, Solid, Cavity | None]:
    """Move the origin of a rotated mesh to the middle of its bottom. Return the mesh, its solid and its hollow."""
    low, high = moved.bounds()
    shift = np.eye(4)
    shift[:3, 3] = [-0.5 * (low[0] + high[0]), -0.5 * (low[1] + high[1]), -low[2]]
    moved = moved.moved(shift)
    solid = solid_of(*moved.surface(), grid=grid)
    return moved, solid, cavity_of(solid)


def _rank(solid: Solid, cavity: Cavity | None, kind: Kind | None, order: int) -> tuple[float, ...]:
    """Return a sort key for poses. The pose that is most likely to be upright has the largest key.

    If objects of this kind have an opening at the top, the key compares the size of the hollow first. It then compares
    the stability of the pose.
    """
    water = 0.0
    if kind is not None and kind.is_open and cavity is not None:
        water = round(cavity.volume_m3 / max(float(np.prod(np.ptp(solid.points, axis=0))), 1e-12), 1)
    return water, round(footing(solid), 1), order


def footing(solid: Solid, *, upside_down: bool = False) -> float:
    """Return how stable a pose is: the tangent of the angle by which the object can be tilted before it falls over."""
    height = solid.points[:, 2]
    top = float(height.max())
    base = solid.points[height > top - solid.pitch_m if upside_down else height < solid.pitch_m][:, :2]
    if len(base) < 3:
        return 0.0
    middle = solid.centers(solid.cells).mean(axis=0)
    if upside_down:
        middle[2] = top - middle[2]
    turns = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    directions = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    reach = ((base - middle[:2]) @ directions.T).max(axis=0).min()
    return float(max(reach, 0.0) / max(middle[2], 1e-6))


def end_areas(solid: Solid, share: float) -> tuple[float, float]:
    """Return the mean cross-sectional areas of the lower and the upper end of an object [m^2]. Hollows count as filled.

    Args:
        solid: The object.
        share: Height of each end, as a fraction of the object's height.
    """
    layers = np.flatnonzero(solid.cells.any(axis=(0, 1)))
    count = max(1, round(share * len(layers)))
    areas = [
        np.mean([ndimage.binary_fill_holes(solid.cells[:, :, k]).sum() for k in end])
        for end in (layers[:count], layers[-count:])
    ]
    bottom, top = (float(area) * solid.pitch_m**2 for area in areas)
    return bottom, top
