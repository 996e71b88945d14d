"""Checks that an asset stays at rest when it is put on a table in its upright pose."""

from __future__ import annotations

from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.check import Finding, at_most, check
from betterbench.sim.asset_checks.subject import Subject

_CURE = "Give the axis that points up with --up, or flatten its base in a mesh editor"


@check
def rest_tilt(subject: Subject) -> Finding:
    """Check that the asset does not tip over when it is put on a table."""
    found = subject.rest.tilt_degrees
    is_ball = float(subject.size_m.min()) > limits.ROUND_SHARE * subject.longest_m
    limit = limits.ROUND_TILT_DEGREES if is_ball and not subject.is_open else limits.TILT_DEGREES
    if subject.kind is not None and subject.kind.stands:
        limit = limits.STANDING_TILT_DEGREES
    return at_most(found, limit, "degrees", f"tips by {found:.2g} degrees until it rests", _CURE)


@check
def rest_drift(subject: Subject) -> Finding:
    """Check that the asset does not drift while it rests on a table."""
    found = subject.rest.drift_mm
    said = f"moves {found:.2g} mm in {limits.WATCH_S:g} s"
    return at_most(found, limits.DRIFT_MM, "mm", said, _CURE)


@check
def rest_jitter(subject: Subject) -> Finding:
    """Check that the asset does not jitter while it rests on a table."""
    found = subject.rest.jitter_mm_s
    said = f"its surface moves at {found:.2g} mm/s at rest"
    return at_most(
        found, limits.JITTER_MM_S, "mm/s", said, "Give its mass with --mass-kg, and check its collision parts"
    )


@check
def rest_depth(subject: Subject) -> Finding:
    """Check that the asset neither sinks into the table nor floats above it while it is at rest."""
    cure = "Its collision parts do not end at its visible surface; import it again"
    vertices, faces = subject.surface
    lowest = min(float(corners[:, 2].min()) for corners in subject.hulls)
    below = 1000.0 * (float(vertices[faces.ravel(), 2].min()) - lowest)
    if below > limits.SINK_MM:  # the simulation may not show this, because the object can lean
        said = f"its collision parts reach {below:.2g} mm below its visible surface"
        return Finding(below, limits.SINK_MM, "mm", True, said, cure)
    found = subject.rest.lowest_mm
    said = f"lowest point {abs(found):.2g} mm {'above' if found > 0.0 else 'in'} the table"
    return at_most(abs(found), limits.SINK_MM, "mm", said, cure)
