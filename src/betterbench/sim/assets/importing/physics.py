"""Physical properties stated in a URDF or MJCF file. They are only used if they fit the visual shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from betterbench.sim.assets.importing.hulls import MOST_HULLS, filled_share, fit_of, hull_corners
from betterbench.sim.assets.importing.measures import depth_in_hull
from betterbench.sim.assets.importing.solid import mass_of_cells
from betterbench.sim.assets.importing.upright import Placed
from betterbench.wording import plural

_LIGHTEST_KG, _HEAVIEST_KG = 0.001, 20.0
"""Range of plausible masses [kg]. A stated mass outside this range is a placeholder, or the object is not a tabletop
object."""
_INERTIA_FACTOR = 5.0
"""Maximum ratio between a stated principal moment of inertia and that of a solid body of the same shape. For
comparison, a shell has up to 3 times the moment of a solid body of the same size."""
_CLOSE_M, _CLOSE_SHARE = 0.003, 0.03
"""Maximum distance between stated collision shapes and the visible surface: the larger of a length [m] and a fraction
of the object's longest side."""
_MOST_FILLED = 0.02
"""Maximum fraction of a hollow that stated collision shapes may fill."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Mass properties of an object, in the object's own frame.

    Attributes:
        mass_kg: Mass.
        center: (3,) center of mass [m].
        inertia: (3, 3) inertia tensor about the center of mass [kg m^2].
    """

    mass_kg: float
    center: np.ndarray
    inertia: np.ndarray


def stated_body(placed: Placed, wished_kg: float | None) -> tuple[Body | None, tuple[str, ...]]:
    """Return the mass, center of mass and inertia stated in the file, and notes about them.

    If the mass is missing or implausible, None is returned instead of mass properties. If the stated center of mass is
    outside the object or not above its base, the center and the inertia of a solid body of this shape are used instead.
    If only the stated inertia does not fit the shape, only the inertia is replaced.

    Args:
        placed: The object.
        wished_kg: Mass given by the user, which replaces the stated mass, or None to keep the stated mass.
    """
    stated = placed.mesh.stated
    if stated is None or stated.mass_kg is None or stated.center is None or stated.inertia is None:
        return None, ()
    if not (np.isfinite(stated.inertia).all() and _LIGHTEST_KG <= stated.mass_kg <= _HEAVIEST_KG):
        return None, (f"the stated mass of {1000 * stated.mass_kg:.3g} g is not that of an object on a table",)
    mass = wished_kg or stated.mass_kg
    said = f"mass {1000 * mass:.3g} g, {'as given' if wished_kg else 'as the file states'}"
    center, inertia = mass_of_cells(placed.solid, mass)
    low, high = placed.mesh.bounds()
    if not ((stated.center > low) & (stated.center < high)).all():
        return Body(mass, center, inertia), (
            said,
            "the stated center of mass is outside the object: that of a solid body is used",
        )
    if _is_over_base(center, placed) and not _is_over_base(stated.center, placed):
        return Body(mass, center, inertia), (
            said,
            "with the stated center of mass it would tip over: that of a solid body is used",
        )
    theirs = stated.inertia * (mass / stated.mass_kg)
    if not _is_plausible(theirs, inertia):
        return Body(mass, stated.center, inertia), (
            said,
            "the stated inertia does not fit the shape: that of a solid body is used",
        )
    return Body(mass, stated.center, theirs), (said,)


def _is_over_base(center: np.ndarray, placed: Placed) -> bool:
    """Return whether the center of mass is above the base of the object."""
    solid = placed.solid
    base = solid.points[solid.points[:, 2] < 1.5 * solid.pitch_m][:, :2]
    return depth_in_hull(center[:2], base) > 0.0


def _is_plausible(inertia: np.ndarray, of_solid: np.ndarray) -> bool:
    """Return whether an inertia tensor is physically possible, and plausible for a body with the size of the object."""
    moments, solid = np.linalg.eigvalsh(inertia), np.linalg.eigvalsh(of_solid)
    # No principal moment exceeds the sum of the other two.
    if moments[0] <= 0.0 or moments[2] > 1.001 * (moments[0] + moments[1]):
        return False
    ratio = moments / solid
    return bool(ratio.min() > 1.0 / _INERTIA_FACTOR and ratio.max() < _INERTIA_FACTOR)


def stated_hulls(placed: Placed) -> tuple[list[np.ndarray], tuple[str, ...]]:
    """Return the corners of the collision shapes in the file [m], and notes about them.

    The list is empty if the collision shapes do not fit the object. They fit if their distance from the visible surface
    is at most 3 mm or 3 % of the object's size, and if they leave the hollow of the object open.
    """
    stated = placed.mesh.stated
    if stated is None or not stated.hulls:
        return [], ()
    if len(stated.hulls) > MOST_HULLS:
        return [], (f"{len(stated.hulls)} collision shapes in the file, more than {MOST_HULLS}: new shapes were made",)
    found = [hull_corners(points) for points in stated.hulls]
    hulls = [corners for corners in found if corners is not None]
    if not hulls:
        return [], ("the collision shapes of the file are flat: new shapes were made",)
    # Pieces that touch share a face inside the object. Enlarge them slightly, so that they overlap there.
    grown = [corners + 0.01 * (corners - corners.mean(axis=0)) for corners in hulls]
    fit = fit_of(grown, placed.solid)
    near = max(_CLOSE_M, _CLOSE_SHARE * float(np.ptp(placed.solid.points, axis=0).max()))
    farthest = max(fit.outside_m, fit.inside_m)
    if farthest > near:
        return [], (
            f"the collision shapes of the file are {1000 * farthest:.0f} mm off the surface: new shapes were made",
        )
    if placed.cavity is not None and filled_share(hulls, placed.solid, placed.cavity) > _MOST_FILLED:
        return [], ("the collision shapes of the file fill its hollow: new shapes were made",)
    return hulls, (f"{plural(len(hulls), 'collision shape')} of the file",)
