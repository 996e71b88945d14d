"""Checks that compare the collision shape of an asset with its visual shape."""

from __future__ import annotations

from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.check import Finding, at_least, at_most, check, not_applicable
from betterbench.sim.asset_checks.subject import Subject

_CURE = "Add or move collision parts. For an imported mesh, first close holes and remove inner surfaces"


@check
def collision_outside(subject: Subject) -> Finding:
    """Check that the collision parts do not extend beyond the visible surface."""
    found = 1000.0 * subject.distances.outside_m
    limit = max(limits.OUTSIDE_MM, 1000.0 * limits.OUTSIDE_SHARE * subject.middle_m)
    return at_most(found, limit, "mm", f"collision shape up to {found:.2g} mm away from the visible surface", _CURE)


@check
def collision_inside(subject: Subject) -> Finding:
    """Check that the collision parts cover nearly the whole visible surface."""
    found = 1000.0 * subject.distances.inside_m
    limit = 1000.0 * subject.inside_limit_m
    return at_most(found, limit, "mm", f"visible surface up to {found:.2g} mm away from the collision shape", _CURE)


@check
def collision_complete(subject: Subject) -> Finding:
    """Check that no visible part of the asset, such as a handle, lacks collision parts."""
    share = subject.distances.bare_share
    said = (
        f"the largest visible part farther than {1000.0 * subject.inside_limit_m:.2g} mm from the collision parts has "
        f"{100 * share:.2g} % of the convex volume"
    )
    return at_most(share, limits.BARE_SHARE, "share", said, _CURE)


@check
def opening_free(subject: Subject) -> Finding:
    """Check that the collision parts of a container leave its hollow open."""
    if not subject.holds:
        return not_applicable("it is not a container")
    if subject.cavity is None:
        return Finding(0.0, limits.OPENING_SHARE, "share", True, "no hollow was found in this container", _CURE)
    touched = subject.touched_cavity
    share = 0.0 if touched is None else touched.volume_m3 / subject.cavity.volume_m3
    said = f"collision parts leave {100 * share:.3g} % of its hollow"
    return at_least(share, limits.OPENING_SHARE, "share", said, _CURE)
