"""Whether an asset stands the way its kind does."""

from __future__ import annotations

import numpy as np

from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.check import Finding, at_least, at_most, check, not_applicable
from betterbench.sim.asset_checks.subject import Subject
from betterbench.sim.assets.importing.solid import mass_of_cells
from betterbench.sim.assets.importing.upright import footing

_CURE = "Give the axis of the file that points up with --up"


@check
def upright(subject: Subject) -> Finding:
    """Check the use of the kind: open at the top, tall, flat, not round about a horizontal axis, on its broader end."""
    kind = subject.kind
    if kind is None:
        return not_applicable("its kind is not known")
    findings = [
        rule(subject)
        for names, rule in (
            (limits.TALL_KINDS, _tall),
            (limits.FLAT_KINDS, _flat),
            (limits.ROUND_KINDS, _round),
            (limits.FOOTED_KINDS, _footed),
        )
        if kind.name in names
    ]
    if subject.is_open:
        findings.append(_open(subject))
    if not findings:
        return not_applicable(f"a {kind.name} has no upright pose of its own")
    return next((found for found in findings if found.fails), findings[0])


def _open(subject: Subject) -> Finding:
    cavity = subject.cavity
    share = 0.0 if cavity is None else cavity.depth_m / float(subject.size_m[2])
    broad = 0.0 if cavity is None else float(cavity.mask.sum() / np.isfinite(cavity.tops).sum())
    if broad < limits.OPEN_AREA_SHARE:
        share = 0.0
    said = f"a hollow that is open at the top takes {100 * share:.2g} % of its height"
    return at_least(share, limits.OPEN_DEPTH_SHARE, "share", said, f"A {_name(subject)} is open at the top. {_CURE}")


def _tall(subject: Subject) -> Finding:
    share = float(subject.size_m[2]) / subject.longest_m
    said = f"its height is {100 * share:.3g} % of its longest side"
    return at_least(share, limits.TALL_SHARE, "share", said, f"A {_name(subject)} stands. {_CURE}")


def _flat(subject: Subject) -> Finding:
    share = float(subject.size_m[2] / max(subject.size_m[:2].min(), 1e-9))
    said = f"its height is {100 * share:.3g} % of its smaller side"
    return at_most(share, limits.FLAT_SHARE, "share", said, f"A {_name(subject)} lies flat. {_CURE}")


def _round(subject: Subject) -> Finding:
    """An object that is round about an axis has two equal moments, and the third is about this axis."""
    _, inertia = mass_of_cells(subject.solid, 1.0)
    moments, axes = np.linalg.eigh(inertia)
    lower, upper = moments[1] / moments[0] - 1.0, moments[2] / moments[1] - 1.0
    if min(lower, upper) > limits.AXIS_TOLERANCE or max(lower, upper) < 2.0 * limits.AXIS_TOLERANCE:
        return at_most(0.0, 45.0, "degrees", "it is round about no axis, or about all", _CURE)
    axis = axes[:, 2] if lower < upper else axes[:, 0]
    lean = float(np.degrees(np.arccos(min(1.0, abs(axis[2])))))
    said = f"it is round about an axis {lean:.2g} degrees from the vertical"
    return at_most(lean, 45.0, "degrees", said, f"A {_name(subject)} stands on its base. {_CURE}")


def _footed(subject: Subject) -> Finding:
    solid = subject.solid
    foot, top = footing(solid), footing(solid, upside_down=True)
    ratio = top / max(foot, 1e-6)
    said = f"upside down it would stand {ratio:.2g} times as firmly"
    return at_most(ratio, limits.FOOTING_RATIO, "ratio", said, f"A {_name(subject)} stands on its broader end. {_CURE}")


def _name(subject: Subject) -> str:
    return "" if subject.kind is None else subject.kind.name
