"""Checks that the mass properties of an asset match its shape, and that its friction is plausible."""

from __future__ import annotations

import numpy as np

from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.check import Finding, at_least, at_most, check
from betterbench.sim.asset_checks.subject import Subject
from betterbench.sim.assets.importing.measures import depth_in_hull
from betterbench.sim.assets.importing.solid import mass_of_cells

_CURE = "Give its mass with --mass-kg and let the importer distribute it"


@check
def center_of_mass(subject: Subject) -> Finding:
    """Check that the center of mass is inside the convex hull of the visible surface."""
    depth = 1000.0 * depth_in_hull(subject.asset.center_of_mass, subject.solid.points)
    said = f"center of mass {abs(depth):.3g} mm {'inside' if depth >= 0.0 else 'outside'} its convex hull"
    return at_least(depth, limits.CENTER_DEPTH_MM, "mm", said, _CURE)


@check
def inertia(subject: Subject) -> Finding:
    """Check that the principal moments of inertia are close to those of a uniform body with the visible shape."""
    ixx, iyy, izz, ixy, ixz, iyz = subject.asset.inertia
    own = np.linalg.eigvalsh(np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]))
    if not np.isfinite(own).all() or own[0] <= 0.0 or own[0] + own[1] < own[2] * (1.0 - 1e-6):
        said = "its principal moments of inertia are not physically possible"
        return Finding(None, None, "", True, said, _CURE)
    usual = np.linalg.eigvalsh(mass_of_cells(subject.solid, subject.asset.mass_kg)[1])
    ratio = float(np.exp(np.abs(np.log(own / usual)).max()))
    said = f"moments of inertia within a factor of {ratio:.2g} of a uniform body's"
    return at_most(ratio, limits.INERTIA_FACTOR, "ratio", said, _CURE)


@check
def friction(subject: Subject) -> Finding:
    """Check that the sliding friction of all collision parts is plausible.

    The finding reports the first value that is implausible.
    """
    values = [part.friction[0] for part in subject.asset.collision]
    usual = f"{limits.LEAST_FRICTION:g} to {limits.MOST_FRICTION:g}"
    cure = "Give a coefficient of two dry surfaces, such as 0.6"
    for value in values:
        if not limits.LEAST_FRICTION <= value <= limits.MOST_FRICTION:
            nearest = limits.MOST_FRICTION if value > limits.MOST_FRICTION else limits.LEAST_FRICTION
            return Finding(value, nearest, "ratio", True, f"sliding friction {value:.3g}, expected {usual}", cure)
    low, high = min(values), max(values)
    return Finding(
        high, limits.MOST_FRICTION, "ratio", False, f"sliding friction {low:.2g} to {high:.2g}, expected {usual}"
    )
