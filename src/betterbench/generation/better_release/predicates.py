"""Evaluation of the relations of the BeTTER release in an initial scene.

The release evaluates relations on the axis-aligned boxes of its assets, but the task files do not contain the sizes of
these assets. Relations that depend on sizes are therefore estimated from the library assets that represent the objects.
A relation remains undecided if no asset represents one of its objects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from betterbench.generation.better_release.files import ReleasePose, ReleasePredicate
from betterbench.geometry import Vector, angle_between, normalize

# Thresholds of the release, src/task/conditions/schema.py at commit 9d75971.
NEAR_M = 0.35
TOUCHING_M = 0.01
IN_SHARE = 0.5
OVERLAP_SHARE = 0.3
ON_HEIGHT_M = 0.1
SIDE_TOLERANCE_M = 0.02
VERTICAL_M = 0.1
AXIS_RAD = 0.1745

Box = tuple[Vector, Vector]
"""Minimum and maximum corner of an axis-aligned box [m]."""

SYNONYMS = {"left": "left_of", "right": "right_of", "front": "front_of", "back": "behind", "top": "on"}
"""Aliases that the release allows for relations."""


def box_of(pose: ReleasePose, size_m: Vector) -> Box:
    """Return the axis-aligned box of an object at its position.

    The rotation is ignored. Both horizontal sides have the length of the object's shorter side, so the box is a lower
    estimate of the size.
    """
    side = min(size_m[:2])
    x, y, z = pose.position
    return (x - 0.5 * side, y - 0.5 * side, z), (x + 0.5 * side, y + 0.5 * side, z + size_m[2])


def holds_at_start(
    predicate: ReleasePredicate, poses: Mapping[str, ReleasePose], sizes_m: Mapping[str, Vector]
) -> bool | None:
    """Return whether a predicate holds in the initial scene, or None if this cannot be decided.

    Args:
        predicate: Predicate of the release.
        poses: Initial poses by object.
        sizes_m: Sizes of the matched assets by object [m].
    """
    subject, target = poses.get(predicate.subject_id), poses.get(predicate.target_id)
    if subject is None or target is None:
        return None
    relation = SYNONYMS.get(predicate.relation, predicate.relation)
    apart = tuple(a - b for a, b in zip(subject.position, target.position, strict=True))
    match relation:
        case "near":
            return math.hypot(*apart) <= NEAR_M
        case "front_of":
            return apart[0] > 0.0
        case "behind":
            return apart[0] < 0.0
        case "vertical_align":
            return math.hypot(*apart[:2]) < VERTICAL_M
        case "axis_align_z":
            return angle_between(normalize(subject.rotation), normalize(target.rotation)) < AXIS_RAD or None
    if predicate.subject_id not in sizes_m or predicate.target_id not in sizes_m:
        return None
    a = box_of(subject, sizes_m[predicate.subject_id])
    return _of_boxes(relation, apart[2], a, box_of(target, sizes_m[predicate.target_id]))


def _of_boxes(relation: str, rise_m: float, a: Box, b: Box) -> bool | None:
    shared = [max(0.0, min(a[1][i], b[1][i]) - max(a[0][i], b[0][i])) for i in range(3)]
    extents = [a[1][i] - a[0][i] for i in range(3)]
    above = shared[0] * shared[1] / (extents[0] * extents[1]) >= OVERLAP_SHARE
    match relation:
        case "in":
            return math.prod(shared) / math.prod(extents) >= IN_SHARE
        case "on":
            return 0.0 <= rise_m <= ON_HEIGHT_M and above
        case "above":
            return a[0][2] > b[1][2] and above
        case "left_of":
            return a[0][1] >= b[1][1] - SIDE_TOLERANCE_M
        case "right_of":
            return a[1][1] <= b[0][1] + SIDE_TOLERANCE_M
        case "touching":
            gaps = [max(0.0, a[0][i] - b[1][i], b[0][i] - a[1][i]) for i in range(3)]
            return math.hypot(*gaps) < TOUCHING_M
    return None
