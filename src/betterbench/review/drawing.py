"""Rulers that the review page draws around the object, and the HTML of its panel."""

from __future__ import annotations

import numpy as np

from betterbench.geometry import Pose, Vector
from betterbench.quoting import markup_text
from betterbench.review.desk import ReviewDesk
from betterbench.review.panel import decision_sign, panel_foot, panel_head
from betterbench.sim.asset_checks.opening import gripper_opening_m, needed_opening_m
from betterbench.sim.assets import Asset, Grasp
from betterbench.sim.assets.importing.review import Verdict
from betterbench.sim.assets.importing.review.changes import said

TICK_M, LONG_TICK_M = 0.004, 0.008
HULL_COLORS = (
    (31, 119, 180), (255, 127, 14), (44, 160, 44), (214, 39, 40), (148, 103, 189),
    (140, 86, 75), (227, 119, 194), (188, 189, 34), (23, 190, 207),
)  # fmt: skip
"""Colors of collision hulls, used in turn (Tableau 10 without gray)."""


def ruler(size: Vector) -> np.ndarray:
    """Return the lines of a ruler in the plane z = 0 for a bounding box, as (n, 2, 3) segments [m].

    The ruler has a tick at every centimeter, and every fifth tick is longer. The ticks are on the two bottom edges that
    face +x and -y, and on the vertical edge between them.
    """
    x, y, z = size
    a, b = 0.5 * x, 0.5 * y
    lines: list[object] = list(box_edges((a, b, 0.5 * z)) + np.array([0.0, 0.0, 0.5 * z], dtype=np.float32))
    for k in range(1, int(100 * y) + 1):
        lines.append(((a, -b + 0.01 * k, 0.0), (a + _tick(k), -b + 0.01 * k, 0.0)))
    for k in range(1, int(100 * x) + 1):
        lines.append(((a - 0.01 * k, -b, 0.0), (a - 0.01 * k, -b - _tick(k), 0.0)))
    for k in range(1, int(100 * z) + 1):
        lines.append(((a, -b, 0.01 * k), (a, -b - _tick(k), 0.01 * k)))
    return np.array(lines, dtype=np.float32)


def box_edges(half_size: Vector) -> np.ndarray:
    """Return the edges of a box around the origin, as a (12, 2, 3) array of segments [m]."""
    x, y, z = half_size
    corners = [(sx * x, sy * y, sz * z) for sz in (-1, 1) for sx in (-1, 1) for sy in (-1, 1)]
    pairs = [(i, j) for i in range(8) for j in range(i + 1, 8) if (i ^ j).bit_count() == 1]
    return np.array([(corners[i], corners[j]) for i, j in pairs], dtype=np.float32)


def _tick(number: int) -> float:
    return LONG_TICK_M if number % 5 == 0 else TICK_M


def ruler_labels(size: Vector) -> list[tuple[str, Vector]]:
    """Return the labels for the width, depth and height of a box, each with its position [m]."""
    x, y, z = size
    off = 0.018
    return [
        (f"{100 * y:.1f} cm", (0.5 * x + off, 0.0, 0.0)),
        (f"{100 * x:.1f} cm", (0.0, -0.5 * y - off, 0.0)),
        (f"{100 * z:.1f} cm", (0.5 * x, 0.5 * y + off, 0.5 * z)),
    ]


def turned_about_middle(asset: Asset, pose: Pose) -> Pose:
    """Return the pose of an asset after a rotation about the center of its bounding box.

    The height is chosen so that the lowest visible point of the rotated asset is at z = 0.
    """
    middle = (0.0, 0.0, 0.5 * asset.size_m[2])
    x, y, z = Pose((0.0, 0.0, 0.0), pose.quaternion).apply([-v for v in middle])
    placed = Pose((x, y, z + middle[2]), pose.quaternion)
    lowest = min(placed.apply(v)[2] for part in asset.visual for v in part.vertices.tolist())
    return placed.translated(z=-lowest)


# ------------------------------------------------------------------------------------------------------------ panel


def head(desk: ReviewDesk) -> str:
    """Return the upper part of the panel as HTML: the progress, the current object, and facts about it."""
    return panel_head(
        desk.at_hand.name,
        desk.history.verdict,
        _facts(desk),
        author=desk.author,
        index=desk.index,
        judged=desk.judged,
        total=len(desk.queue),
    )


def _facts(desk: ReviewDesk) -> list[tuple[str, str]]:
    state, asset = desk.state, desk.asset
    if state is None or asset is None:
        return [("cannot be imported", desk.at_hand.problem)]
    kind, fit = state.imported.kind, state.imported.fit
    size = " × ".join(f"{100 * v:.1f}" for v in asset.size_m)
    usual = "unknown" if kind is None else f"{kind.name}, {100 * kind.low_m:.0f}–{100 * kind.high_m:.0f} cm"
    mass = f"{1000 * asset.mass_kg:.0f} g"
    if kind is not None:
        mass += f" (usual for its kind: {1000 * kind.mass_at(max(asset.size_m)):.0f} g)"
    shapes = f"{len(asset.collision)} hulls, {1000 * fit.outside_m:.1f} mm out, {1000 * fit.inside_m:.1f} mm in"
    frames = ", ".join(region.name for region in asset.regions) or "none"
    return [
        ("name", state.name),
        ("kind", usual),
        ("size", f"{size} cm"),
        ("mass", mass),
        ("collision", shapes),
        ("grasps", str(len(asset.grasps))),
        ("frames", frames),
        ("license", asset.license),
    ]


def foot(desk: ReviewDesk) -> str:
    """Return the lower part of the panel as HTML: the edit in progress, the last message, and the latest decisions."""
    edit = None if desk.edit is None else said(desk.edit)
    decisions = [(decision_sign(r.decision), _said(r.decision), r.author) for _, r in desk.history.reviews[-6:]]
    return panel_foot(_at_hand(desk), edit, desk.message, decisions, is_problem=desk.is_problem)


def _at_hand(desk: ReviewDesk) -> str:
    if desk.mode == "grasp":
        grasp = desk.grasp
        return "no grasp" if grasp is None else f"grasp {markup_text(grasp.name)}, {_opening(desk, grasp)}"
    if desk.mode == "frame":
        return "no frame" if desk.region is None else f"frame {markup_text(desk.region.name)}"
    return "pose" if desk.mode == "pose" else "support plane"


def _opening(desk: ReviewDesk, grasp: Grasp) -> str:
    """Describe the declared width of a grasp, and the gripper opening that it requires."""
    stated, jaw = f"{1000 * grasp.width_m:.0f} mm wide", gripper_opening_m()
    solid = desk.solid
    needed = None if solid is None else needed_opening_m(solid, grasp)
    if needed is None:
        return f"{stated}; there is nothing between the pads"
    fits = "" if needed <= jaw else " — too wide"
    return f"{stated}; needs an opening of {1000 * needed:.0f} of {1000 * jaw:.0f} mm{fits}"


def _said(decision: object) -> str:
    if isinstance(decision, Verdict):
        return f"{decision.verdict}{f': {decision.reason}' if decision.reason else ''}"
    return said(decision)  # type: ignore[arg-type]  # a history contains no undo
