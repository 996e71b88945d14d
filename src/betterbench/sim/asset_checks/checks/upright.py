"""Check that an asset has the upright pose of its kind."""

from __future__ import annotations

import numpy as np

from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.check import Finding, at_least, at_most, check, not_applicable
from betterbench.sim.asset_checks.subject import Subject
from betterbench.sim.assets.importing.cavity import cavity_of
from betterbench.sim.assets.importing.kinds import FLAT_SHARE, TALL_SHARE
from betterbench.sim.assets.importing.solid import solid_of
from betterbench.sim.assets.importing.upright import end_areas, footing

_AXIS_ERROR_DEGREES = 6.0
"""Maximum angle between the axis of a round object and the nearest principal axis of its surface points [degrees]."""
_CURE = "Give the axis of the file that points up with --up"


@check
def upright(subject: Subject) -> Finding:
    """Check that the asset's pose fits its kind.

    For example, a bottle must stand, and a container must be open at the top.
    """
    kind = subject.kind
    if kind is None:
        return not_applicable("its kind is not known")
    rules = (
        (kind.is_tall, _tall),
        (kind.is_flat, _flat),
        (kind.name in limits.ROUND_KINDS, _round),
        (kind.name in limits.ROUND_KINDS, _leaning),
        (kind.name in limits.FOOTED_KINDS, _footed),
        (kind.name in limits.NARROW_TOP_KINDS, _narrow_top),
        (kind.is_open or kind.name in limits.HOLLOW_TOP_KINDS, _hollow_top),
    )
    findings = [rule(subject) for applies, rule in rules if applies]
    if subject.is_open:
        findings.append(_open(subject))
    if not findings:
        return not_applicable(f"a {kind.name} has no upright pose")
    return next((found for found in findings if found.fails), findings[0])


def _open(subject: Subject) -> Finding:
    cavity = subject.cavity
    share = 0.0 if cavity is None else cavity.depth_m / float(subject.size_m[2])
    broad = 0.0 if cavity is None else float(cavity.mask.sum() / np.isfinite(cavity.tops).sum())
    is_neck = subject.kind is not None and subject.kind.is_tall and share >= limits.NECK_DEPTH_SHARE
    if broad < (limits.NECK_AREA_SHARE if is_neck else limits.OPEN_AREA_SHARE):
        share = 0.0
    said = f"a hollow that is open at the top takes {100 * share:.2g} % of its height"
    return at_least(
        share, limits.OPEN_DEPTH_SHARE, "share", said, f"A {_name(subject)} should be open at the top. {_CURE}"
    )


def _tall(subject: Subject) -> Finding:
    share = float(subject.size_m[2]) / subject.longest_m
    said = f"its height is {100 * share:.3g} % of its longest side"
    return at_least(share, TALL_SHARE, "share", said, f"A {_name(subject)} should stand upright. {_CURE}")


def _flat(subject: Subject) -> Finding:
    share = float(subject.size_m[2] / max(subject.size_m[:2].min(), 1e-9))
    said = f"its height is {100 * share:.3g} % of its smaller side"
    return at_most(share, FLAT_SHARE, "share", said, f"A {_name(subject)} should lie flat. {_CURE}")


def _round(subject: Subject) -> Finding:
    """Check that a round object does not lie on its side.

    The check compares how much the object's width varies around a vertical axis and around a horizontal axis. The width
    of a cylinder, for example, is the same in all directions perpendicular to its axis.
    """
    points = subject.solid.points[:: max(1, len(subject.solid.points) // 4_000)]
    vertical = _uneven(points, np.array([0.0, 0.0, 1.0]))
    turns = np.pi * np.arange(12) / 12.0
    lying = min(_uneven(points, np.array([np.cos(t), np.sin(t), 0.0])) for t in turns)
    # An object that is round about both axes is a ball. An object that is round only about a horizontal axis lies on
    # its side.
    ratio = vertical / lying if lying < limits.ROUND_RATIO else 1.0
    across = [f"{100 * (each - 1):.2g} %" for each in (vertical, lying)]
    said = f"its widths across the vertical differ by {across[0]}, across a horizontal axis by {across[1]}"
    return at_most(ratio, limits.LYING_RATIO, "ratio", said, f"A {_name(subject)} should stand on its base. {_CURE}")


def _leaning(subject: Subject) -> Finding:
    """Check that the axis of a round object does not lean.

    The check compares how much the object's width varies around the vertical axis and around the object's own axis.
    """
    points = subject.solid.points[:: max(1, len(subject.solid.points) // 4_000)]
    directions = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    near = directions[int(np.argmax(np.abs(directions[:, 2])))]
    sides = directions[np.argsort(np.abs(directions[:, 2]))[:2]]
    steps = np.radians(np.arange(-_AXIS_ERROR_DEGREES, _AXIS_ERROR_DEGREES + 1.0, 2.0))
    axes = [near + np.tan(a) * sides[0] + np.tan(b) * sides[1] for a in steps for b in steps]
    even = [_uneven(points, axis / np.linalg.norm(axis)) for axis in axes]
    axis = axes[int(np.argmin(even))]
    lean = float(np.degrees(np.arccos(min(1.0, abs(axis[2]) / np.linalg.norm(axis)))))
    is_leaning = min(even) < limits.ROUND_RATIO and _uneven(points, np.array([0.0, 0.0, 1.0])) > limits.LYING_RATIO
    found = lean if is_leaning else 0.0
    said = f"its axis leans by {found:.2g} degrees"
    cure = f"A {_name(subject)} should stand on its base. Look for a part below its base, or turn it in a mesh editor"
    return at_most(found, limits.STANDING_TILT_DEGREES, "degrees", said, cure)


def _uneven(points: np.ndarray, axis: np.ndarray) -> float:
    """Return the ratio of the largest to the smallest width of an object, over twelve directions around an axis."""
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first = first / np.linalg.norm(first)
    second = np.cross(axis, first)
    turns = np.pi * np.arange(12) / 12.0
    directions = np.outer(np.cos(turns), first) + np.outer(np.sin(turns), second)
    widths = np.ptp(points @ directions.T, axis=0)
    return float(widths.max() / widths.min())


def _footed(subject: Subject) -> Finding:
    solid = subject.solid
    foot, top = footing(solid), footing(solid, upside_down=True)
    ratio = top / max(foot, 1e-6)
    said = f"it would be {ratio:.2g} times as stable upside down"
    return at_most(
        ratio, limits.FOOTING_RATIO, "ratio", said, f"A {_name(subject)} should stand on its broader end. {_CURE}"
    )


def _narrow_top(subject: Subject) -> Finding:
    bottom, top = end_areas(subject.solid, limits.END_SHARE)
    ratio = top / max(bottom, 1e-9)
    said = f"its upper end has {100 * ratio:.3g} % of the area of its lower end"
    cure = f"A {_name(subject)} should be narrower at the top. {_CURE}"
    return at_most(ratio, limits.END_AREA_RATIO, "ratio", said, cure)


def _hollow_top(subject: Subject) -> Finding:
    """Check that the hollow on the upper side of the object holds more than the hollow on its lower side.

    Because it only compares the two volumes, the check also works for filled bowls and for plates without a rim.
    """
    vertices, faces = subject.surface
    above, below = subject.cavity, cavity_of(solid_of(vertices * (1.0, -1.0, -1.0), faces))
    up, down = (0.0 if hollow is None else 1e6 * hollow.volume_m3 for hollow in (above, below))
    said = f"its upper hollow holds {up:.3g} ml; upside down, its lower hollow would hold {down:.3g} ml"
    return at_least(up - down, 0.0, "ml", said, f"A {_name(subject)} should be hollow at the top. {_CURE}")


def _name(subject: Subject) -> str:
    return "" if subject.kind is None else subject.kind.name
